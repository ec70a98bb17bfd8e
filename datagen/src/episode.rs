//! The one loop of scanning and planning, for data generation, validation in training, and evaluation alike.

use crate::pose_error::{PoseError, PoseErrorConfig};
use crate::scene::{RenderConfig, RenderScratch, Scene};
use geometry::coverage::matched_surface;
use geometry::metrics::{SurfaceDistances, surface_distances, views_to};
use geometry::rng::stream;
use geometry::{
    Misses, PastScan, PinholeCamera, Planner, PointCloud, RankedView, ScanState, Seen, View, VoxelOrigin, coverage,
    estimate_normals, mean_spacing, orient_normals_along, orient_normals_toward, overlap,
};
use nalgebra::{Point3, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

/// Neighbours of a scan's normals.
const NORMAL_NEIGHBORS: usize = 20;

/// What the accumulated cloud consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accumulate {
    /// The points measured, averaged in voxels that stay where they are.
    #[default]
    Measured,
    /// As published: the reference points matched so far. Planners then see samples of the true surface.
    Matched,
}

impl Accumulate {
    /// Where the voxels lie that average the cloud.
    pub fn voxel_origin(self) -> VoxelOrigin {
        match self {
            Accumulate::Measured => VoxelOrigin::World,
            Accumulate::Matched => VoxelOrigin::CloudMinimum,
        }
    }

    /// The cloud with a scan added, and the share of the reference that it covers then.
    pub(crate) fn add(
        self,
        cloud: &PointCloud,
        scan: &PointCloud,
        reference: &[Point3<f64>],
        grid_size: f64,
        tolerance: f64,
    ) -> (PointCloud, f64) {
        let mut merged = cloud.clone();
        merged.merge(scan);
        let merged = merged.voxel_downsample(grid_size, self.voxel_origin());
        match self {
            Accumulate::Measured => {
                let covered = coverage(&merged.points, reference, tolerance);
                (merged, covered)
            }
            Accumulate::Matched => {
                let matched = matched_surface(&merged, reference, tolerance);
                let covered = matched.len() as f64 / reference.len().max(1) as f64;
                (matched, covered)
            }
        }
    }
}

/// The simulated camera's image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImageConfig {
    /// Columns (1280).
    pub width: u32,
    /// Rows (720).
    pub height: u32,
    /// Vertical field of view (70).
    pub fov_y_deg: f64,
}

impl Default for ImageConfig {
    fn default() -> Self {
        Self { width: 1280, height: 720, fov_y_deg: 70.0 }
    }
}

impl ImageConfig {
    /// Square pixels, principal point in the centre.
    pub fn camera(&self) -> PinholeCamera {
        PinholeCamera::from_fov_y(self.width, self.height, self.fov_y_deg.to_radians())
    }
}

/// Settings of an episode (docs/method.md, 'Setting').
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeConfig {
    /// The camera.
    pub image: ImageConfig,
    /// How it measures.
    pub render: RenderConfig,
    /// Errors of the camera's pose and of its registration; absent: none.
    pub pose_error: Option<PoseErrorConfig>,
    /// Distance from target to camera, metres (1.2).
    pub working_distance_m: f64,
    /// Distance of the first camera from the origin, metres; absent: the working distance.
    pub initial_distance_m: Option<f64>,
    /// Draw the first view in whole degrees, as published. Off by default.
    pub initial_whole_degrees: bool,
    /// Distance under which two points count as the same surface, metres (0.002).
    pub tolerance_m: f64,
    /// Next views after the first scan (15).
    pub num_views: usize,
    /// What the cloud consists of.
    pub accumulate: Accumulate,
    /// End at full coverage, as published. Off by default.
    pub stop_at_full_coverage: bool,
    /// A first scan with fewer points is void (50).
    pub min_first_points: usize,
    /// A first scan that covers less is void (0.05).
    pub min_first_coverage: f64,
    /// First views tried before the object is given up (100).
    pub max_draws: usize,
}

impl Default for EpisodeConfig {
    fn default() -> Self {
        Self {
            image: ImageConfig::default(),
            render: RenderConfig::default(),
            pose_error: None,
            working_distance_m: 1.2,
            initial_distance_m: None,
            initial_whole_degrees: false,
            tolerance_m: 0.002,
            num_views: 15,
            accumulate: Accumulate::Measured,
            stop_at_full_coverage: false,
            min_first_points: 50,
            min_first_coverage: 0.05,
            max_draws: 100,
        }
    }
}

impl EpisodeConfig {
    /// As published: shifted scans, culled back faces, matched surface samples as the cloud, end at full coverage.
    pub fn paper() -> Self {
        Self {
            render: RenderConfig::paper(),
            accumulate: Accumulate::Matched,
            initial_whole_degrees: true,
            stop_at_full_coverage: true,
            ..Self::default()
        }
    }
}

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// All next views were taken.
    AllViews,
    /// Everything was covered.
    FullCoverage,
    /// The policy had no view to offer.
    NoView,
}

/// What happened. Equal for equal input and random stream, but for `decision_seconds`.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Episode {
    /// Views scanned from: the first, then the next views.
    pub views: Vec<View>,
    /// Coverage after each of `views`.
    pub coverages: Vec<f64>,
    /// Overlap of each next view's scan with the cloud before it; `None` for an empty scan.
    pub overlaps: Vec<Option<f64>>,
    /// Points of each scan.
    pub scan_points: Vec<usize>,
    /// Voxel edge of the cloud, metres.
    pub grid_size: f64,
    /// Points of the voxel-averaged reference surface.
    pub num_reference: usize,
    /// Chamfer and Hausdorff distance between the final cloud and the reference, metres.
    pub distances: SurfaceDistances,
    /// First views that were void before this one.
    pub void_draws: usize,
    /// Why it ended.
    pub end: End,
    /// Wall time of each decision, seconds: not an output that repeats.
    #[serde(skip)]
    pub decision_seconds: Vec<f64>,
    /// The final cloud.
    #[serde(skip)]
    pub cloud: PointCloud,
}

impl PartialEq for Episode {
    fn eq(&self, other: &Self) -> bool {
        let outcome = |e: &Self| (e.grid_size, e.num_reference, e.distances, e.void_draws, e.end);
        outcome(self) == outcome(other)
            && self.views == other.views
            && self.coverages == other.coverages
            && self.overlaps == other.overlaps
            && self.scan_points == other.scan_points
            && self.cloud == other.cloud
    }
}

impl Episode {
    /// Coverage after the last view.
    pub fn final_coverage(&self) -> f64 {
        self.coverages.last().copied().unwrap_or(0.0)
    }

    /// Views until the coverage first reaches `level`, the first scan being view 1; `None` if it never does.
    pub fn views_to(&self, level: f64) -> Option<usize> {
        views_to(&self.coverages, level)
    }

    /// Coverage after `index` next views; the last one where the episode ended before.
    pub fn coverage_after(&self, index: usize) -> f64 {
        self.coverages.get(index).copied().unwrap_or_else(|| self.final_coverage())
    }
}

/// No first view was any good.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "none of {draws} first views gave a usable scan: the best had {points} points (wanted {min_points}) and covered \
     {:.1} % of the surface (wanted {:.1} %); is the object of the expected size (0.2 m) and in view at this distance?",
    100.0 * coverage, 100.0 * min_coverage
)]
pub struct VoidEpisode {
    /// First views tried.
    pub draws: usize,
    /// Most points of a scan.
    pub points: usize,
    /// Points wanted.
    pub min_points: usize,
    /// Largest coverage of a scan.
    pub coverage: f64,
    /// Coverage wanted.
    pub min_coverage: f64,
}

/// A decision as it was taken.
pub struct Decision<'a> {
    /// 0 for the first next view.
    pub index: usize,
    /// What the policy saw.
    pub state: &'a ScanState,
    /// What it answered, best first. Empty: the episode ends.
    pub ranked: &'a [RankedView],
    /// The voxel-averaged reference surface.
    pub reference: &'a [Point3<f64>],
    /// Coverage before the view.
    pub current_coverage: f64,
}

/// Scans an object: a first view, then those of the policy. `samples` are the 60,000 surface samples, not yet
/// averaged. Draws of the first view come from `rng` before all others, so that policies given equal streams start
/// from equal views.
pub fn run_episode<P: Planner + ?Sized>(
    scene: &Scene,
    samples: &[Point3<f64>],
    planner: &mut P,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
) -> Result<Episode, VoidEpisode> {
    run_episode_with(scene, samples, planner, config, rng, |_, _| {})
}

/// [`run_episode`], showing every decision to `observe` together with the policy, after it decided and before its
/// view is scanned.
pub fn run_episode_with<P: Planner + ?Sized>(
    scene: &Scene,
    samples: &[Point3<f64>],
    planner: &mut P,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
    mut observe: impl FnMut(&P, &Decision),
) -> Result<Episode, VoidEpisode> {
    planner.reset();
    let mut config = config.clone();
    let noise_key: u64 = rng.r#gen();
    if let Some(noise) = &mut config.render.noise {
        noise.seed ^= noise_key;
    }
    let pose_error = config.pose_error.clone().map(|c| PoseError::new(c, stream(noise_key, "pose")));
    let mut simulator = Simulator { scene, config: &config, scratch: RenderScratch::default(), pose_error };
    let Start { view, first, void_draws } = first_scan(&mut simulator, samples, rng)?;
    let FirstScan { points, past, mut state, reference, mut current } = first;
    let mut episode = Episode {
        views: vec![view],
        coverages: vec![current],
        overlaps: Vec::new(),
        scan_points: vec![points],
        grid_size: state.grid_size,
        num_reference: reference.len(),
        distances: SurfaceDistances::default(),
        void_draws,
        end: End::AllViews,
        decision_seconds: Vec::new(),
        cloud: PointCloud::default(),
    };
    state.scans.push(past);
    for index in 0..config.num_views {
        if config.stop_at_full_coverage && current >= 1.0 {
            episode.end = End::FullCoverage;
            break;
        }
        let clock = Instant::now();
        let ranked = planner.rank_views(&state, rng);
        episode.decision_seconds.push(clock.elapsed().as_secs_f64());
        observe(
            planner,
            &Decision { index, state: &state, ranked: &ranked, reference: &reference, current_coverage: current },
        );
        let Some(view) = ranked.first().map(|r| r.view) else {
            episode.end = End::NoView;
            break;
        };
        let (past, scan) = simulator.scan(&view);
        episode.overlaps.push(overlap(&scan.points, &state.cloud.points, config.tolerance_m));
        if !scan.is_empty() {
            let grid_size = state.grid_size;
            (state.cloud, current) =
                config.accumulate.add(&state.cloud, &scan, &reference, grid_size, config.tolerance_m);
        }
        state.scans.push(past);
        state.num_scans += 1;
        episode.views.push(view);
        episode.coverages.push(current);
        episode.scan_points.push(scan.len());
    }
    episode.distances = surface_distances(&state.cloud.points, &reference);
    episode.cloud = state.cloud;
    Ok(episode)
}

/// The camera in its scene.
struct Simulator<'a> {
    scene: &'a Scene,
    config: &'a EpisodeConfig,
    scratch: RenderScratch,
    pose_error: Option<PoseError>,
}

impl Simulator<'_> {
    /// What the camera sees from a view, as evidence and as a cloud with normals. Nothing from a degenerate view.
    fn scan(&mut self, view: &View) -> (PastScan, PointCloud) {
        let camera = self.config.image.camera();
        let commanded = view.world_from_camera();
        let (actual, world_from_camera) = match &mut self.pose_error {
            Some(error) => error.poses(&commanded),
            None => (commanded, commanded),
        };
        let depth = if view.is_valid() {
            self.scene.render(&camera, &actual, &self.config.render, &mut self.scratch).clone()
        } else {
            geometry::DepthImage::default()
        };
        let points = depth.to_points(&camera, &world_from_camera);
        let mut cloud = PointCloud { normals: estimate_normals(&points, NORMAL_NEIGHBORS), points };
        match self.config.accumulate {
            Accumulate::Measured => orient_normals_toward(&mut cloud, &world_from_camera.translation.vector.into()),
            Accumulate::Matched => orient_normals_along(&mut cloud, &view.direction()),
        }
        (PastScan { world_from_camera, seen: Seen::Depth { camera, depth, misses: Misses::Free } }, cloud)
    }
}

/// The state after a usable first scan.
struct FirstScan {
    points: usize,
    past: PastScan,
    state: ScanState,
    reference: Vec<Point3<f64>>,
    current: f64,
}

struct Start {
    view: View,
    first: FirstScan,
    void_draws: usize,
}

fn first_scan(simulator: &mut Simulator, samples: &[Point3<f64>], rng: &mut ChaCha8Rng) -> Result<Start, VoidEpisode> {
    let config = simulator.config;
    let (mut most_points, mut best_coverage) = (0, 0f64);
    for void_draws in 0..config.max_draws {
        let view = initial_view(config, rng);
        if let Some(error) = &mut simulator.pose_error {
            error.restart();
        }
        let (past, scan) = simulator.scan(&view);
        most_points = most_points.max(scan.len());
        if scan.len() < config.min_first_points.max(2) {
            continue;
        }
        let grid_size = mean_spacing(&scan.points);
        let reference = reference_surface(samples, grid_size, config.accumulate);
        let (cloud, current) = first_cloud(config.accumulate, &scan, &reference, grid_size, config.tolerance_m);
        best_coverage = best_coverage.max(current);
        // As published: a scan with more points than the reference is void too.
        if current < config.min_first_coverage || scan.len() > reference.len() {
            continue;
        }
        let state = ScanState {
            cloud,
            scans: Vec::new(),
            num_scans: 1,
            grid_size,
            working_distance: config.working_distance_m,
            tolerance: config.tolerance_m,
            camera: config.image.camera(),
            near: None,
        };
        return Ok(Start {
            view,
            first: FirstScan { points: scan.len(), past, state, reference, current },
            void_draws,
        });
    }
    Err(VoidEpisode {
        draws: config.max_draws,
        points: most_points,
        min_points: config.min_first_points,
        coverage: best_coverage,
        min_coverage: config.min_first_coverage,
    })
}

/// The first scan as a cloud: measured, thinned like all later ones; matched, without thinning, as published.
fn first_cloud(
    accumulate: Accumulate,
    scan: &PointCloud,
    reference: &[Point3<f64>],
    grid_size: f64,
    tolerance: f64,
) -> (PointCloud, f64) {
    match accumulate {
        Accumulate::Measured => {
            accumulate.add(&PointCloud { points: vec![], normals: vec![] }, scan, reference, grid_size, tolerance)
        }
        Accumulate::Matched => {
            let matched = matched_surface(scan, reference, tolerance);
            let covered = matched.len() as f64 / reference.len().max(1) as f64;
            (matched, covered)
        }
    }
}

/// The surface samples averaged in voxels of the grid size: what coverage is a share of.
pub fn reference_surface(samples: &[Point3<f64>], grid_size: f64, accumulate: Accumulate) -> Vec<Point3<f64>> {
    let cloud = PointCloud { points: samples.to_vec(), normals: Vec::new() };
    cloud.voxel_downsample(grid_size, accumulate.voxel_origin()).points
}

/// The first view: camera on the upper half of a sphere around the origin, polar angle uniform in [0, 90) degrees,
/// azimuth in [0, 360), looking at the origin.
pub fn initial_view(config: &EpisodeConfig, rng: &mut ChaCha8Rng) -> View {
    let (polar, azimuth) = if config.initial_whole_degrees {
        (f64::from(rng.gen_range(0..90)), f64::from(rng.gen_range(0..360)))
    } else {
        (rng.gen_range(0.0..90.0), rng.gen_range(0.0..360.0))
    };
    let (polar, azimuth) = (f64::to_radians(polar), f64::to_radians(azimuth));
    let direction = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let distance = config.initial_distance_m.unwrap_or(config.working_distance_m);
    View { target: Point3::origin(), position: Point3::from(distance * direction) }
}

#[cfg(test)]
mod tests;
