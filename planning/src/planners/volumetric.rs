//! Planning without a model: space carved by past scans, the surface expected in what is left unknown, and the gain
//! and overlap that a view can expect of both.

mod backs;
mod belief;
mod carved;
mod forecasts;
mod grid;
mod holes;
mod march;
mod membrane;
mod predict;
mod rank;
mod silhouette;
mod tiles;

use crate::candidates::candidate_views;
use crate::planner::checked;
use crate::{Angles, CandidateConfig, PastScan, PlanError, Planner, RankedView, ScanState};
use carved::Carved;
pub use forecasts::{Forecasts, Surface, ViewForecast};
use geometry::{PinholeCamera, View};
use grid::VoxelGrid;
pub use holes::{Allowed, ExpectedPoint, Hole, SeenPart, Unseen};
use march::{Leaps, Marcher};
use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use silhouette::Silhouette;
use std::sync::Arc;

/// A cube in which the object stands.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Middle of the cube, world frame, metres.
    pub center_m: [f64; 3],
    /// Half its edge, metres.
    pub half_m: f64,
}

/// Settings of the volumetric planner.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumetricConfig {
    /// The candidate views: 20 targets with all three tilts.
    pub candidates: CandidateConfig,
    /// Score by the expected gain alone, whatever the overlap. Off by default.
    pub gain_only: bool,
    /// Known surface over known and 0.41 of expected surface at which gain and overlap weigh the same (0.8: 62 % of the
    /// whole are known).
    pub weight_center: f64,
    /// Added to the score per half turn between a view and the nearest past one (0.08): late, when little is expected
    /// anywhere, what is still missing is rather seen from where no camera has been.
    pub novelty: f64,
    /// Views with a smaller expected overlap, within the tolerance and less what it may be missed by ([`crate::overlap::margin`]), come after
    /// all others, those with the most of it first (0: none). Where points are too far apart for that, six tenths of a scan of measured
    /// surface are enough.
    pub min_overlap: f64,
    /// Voxels are twice the tolerance wide, at least 1.25 pixels at the working distance and a spacing of the cloud, and at most this many of
    /// the coarser of the two (3.5). They grow where memory would not do. About one ray goes through each.
    pub voxel_px: f64,
    /// Take what lies outside of the outline of all that a scan measured for background, where its misses do not say so;
    /// no longer for a scan in whose background others see surface. On by default.
    pub presume_background: bool,
    /// The workspace; absent: around the cloud, again whenever that outgrows it.
    pub workspace: Option<Workspace>,
    /// A cube beyond which nothing was kept of any scan: the workspace, unless that around the cloud is much smaller. Not a setting.
    #[serde(skip)]
    pub bound: Option<Workspace>,
}

impl Default for VolumetricConfig {
    fn default() -> Self {
        Self {
            candidates: CandidateConfig { angles: Angles::All, ..CandidateConfig::default() },
            gain_only: false,
            weight_center: 0.8,
            novelty: 0.08,
            min_overlap: 0.0,
            voxel_px: 3.5,
            presume_background: true,
            workspace: None,
            bound: None,
        }
    }
}

/// A bound this many times as wide as the cube around the cloud would only make voxels coarse.
const BOUND: f64 = 1.5;
/// Voxels this many pixels wide have a point each where a surface was measured: through those without, the membrane passed as if nothing were
/// known there, and after four scans a fourth to a third of the surface was told to be missing where a seventh was (docs/log.md).
const GAPLESS: f64 = 1.25;
/// Share of the whole from which on the backs of thin parts are looked for: they have candidates, and count in the score. Fewer mostly lie within
/// the tolerance of their fronts, so that views at them gain nothing by it (docs/log.md).
const THIN: f64 = 0.25;

/// While this share of the whole or more is missing and no view at the boundary is expected to measure as large a part of that, views at what is
/// missing are looked at, too: the other side of a sheet is seen from none of the directions around its rim.
const MUCH: f64 = 0.1;
const LITTLE: f64 = 0.25;

/// The policy `volumetric`. It needs past scans with camera poses, and has no view to offer where there is none.
///
/// ```
/// use geometry::{PointCloud, rng::stream};
/// use nalgebra::Point3;
/// use planning::{Planner, Scan, Session, SessionConfig, VolumetricConfig, VolumetricPlanner};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let points = (0..900).map(|i| Point3::new(0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30), 0.0)).collect();
/// let cloud = PointCloud { points, normals: Vec::new() };
/// let mut session = Session::new(SessionConfig::default(), None)?;
/// session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 1.2)) })?;
/// let mut planner = VolumetricPlanner::new(VolumetricConfig::default());
/// let ranked = planner.rank_views(session.state(), &mut stream(0, "example"))?;
/// assert!(ranked[0].score >= ranked[1].score);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, Default)]
pub struct VolumetricPlanner {
    config: VolumetricConfig,
    grid: Option<VoxelGrid>,
    carved: Vec<Carved>,
    /// Through the grid as it was at the last decision.
    leaps: Option<Leaps>,
    surface: Surface,
    /// Whether the grid's cube holds all that can come.
    bounded: bool,
    /// Scans at the last decision.
    placed: usize,
}

impl VolumetricPlanner {
    /// A planner that has seen nothing yet.
    pub fn new(config: VolumetricConfig) -> Self {
        Self { config, ..Self::default() }
    }

    /// The settings.
    pub fn config(&self) -> &VolumetricConfig {
        &self.config
    }

    /// The surface as it was estimated at the last decision.
    pub fn surface(&self) -> Surface {
        self.surface
    }

    /// Memory held, bytes.
    pub fn memory(&self) -> usize {
        let silhouettes = self.carved.iter().filter_map(|c| c.silhouette.as_deref()).map(Silhouette::memory);
        let leaps = self.leaps.as_ref().map_or(0, Leaps::memory);
        silhouettes.sum::<usize>() + leaps + self.grid.as_ref().map_or(0, VoxelGrid::memory)
    }

    fn new_grid(&mut self, state: &ScanState) -> VoxelGrid {
        let mut given = self.config.workspace;
        let workspace = given.unwrap_or_else(|| {
            let (low, high) = state.cloud.bounding_box();
            let (middle, diagonal) = (nalgebra::center(&low, &high), (high - low).norm());
            // The object reaches behind what was seen, about as far as it is wide.
            let away = |s: &PastScan| middle - Point3::from(s.world_from_camera.translation.vector);
            let directions = state.scans.iter().map(|s| away(s).try_normalize(0.0).unwrap_or_default());
            let mean = directions.sum::<Vector3<f64>>() / state.scans.len().max(1) as f64;
            let around = Workspace { center_m: (middle + mean * (0.2 * diagonal)).into(), half_m: 0.75 * diagonal };
            given = self.config.bound.filter(|bound| bound.half_m < BOUND * around.half_m);
            given.unwrap_or(around)
        });
        self.bounded = given.is_some();
        let pixel = state.camera.pixel_size(state.working_distance);
        let spacing = pixel.max(state.grid_size);
        let least = (GAPLESS * pixel).max(spacing).max(2.0 * state.tolerance);
        let voxel = least.min(self.config.voxel_px * spacing).max(f64::MIN_POSITIVE);
        VoxelGrid::new(&Point3::from(workspace.center_m), workspace.half_m.max(voxel), voxel)
    }

    /// What the candidates of this state promise; without views where nothing can be said, and without those that there was
    /// no time for.
    pub fn forecast(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Forecasts {
        let cloud = &state.cloud;
        if state.scans.is_empty() || cloud.is_empty() || !cloud.has_normals() {
            return Forecasts::default();
        }
        self.placed = state.num_placed();
        let near = state.neighborhoods(self.config.candidates.boundary.neighbors);
        let mut candidates: Vec<(View, Option<usize>)> = if state.given_views.is_empty() {
            let own = candidate_views(cloud, &near, state.working_distance, &self.config.candidates, rng);
            own.iter().map(|c| (c.view, None)).collect()
        } else {
            state.given().into_iter().zip((0..).map(Some)).collect()
        };
        self.leaps = None;
        let mut grid = self.carved_grid(state);
        if state.budget.is_spent() {
            self.grid = Some(grid);
            return Forecasts::default();
        }
        grid.set_cloud(cloud);
        let known_m2 = grid.estimate_covered(cloud, &near, state.reach);
        grid.relax();
        let carves = self.carved.iter().all(Carved::carves);
        let trust = predict::trust(grid.voxel, state.tolerance);
        let leaps = Leaps::new(&grid, carves);
        grid.backs.clear();
        grid.backs = backs::open_backs(&Marcher::new(&grid, &leaps, &state.sensor), state);
        let beliefs = belief::beliefs(&Marcher::new(&grid, &leaps, &state.sensor), state);
        grid.expected.iter_mut().zip(beliefs).for_each(|(voxel, belief)| voxel.belief = belief);
        let (membrane_m2, backs_m2) = (grid.area_of(&grid.expected), grid.area_of(&grid.backs));
        self.surface = Surface { known_m2, expected_m2: membrane_m2 + backs_m2 };
        let total = (known_m2 + membrane_m2).max(f64::MIN_POSITIVE);
        let whole = total + backs_m2;
        let missing = self.surface.expected_m2 / whole;
        let swollen = predict::swollen(grid.voxel, whole);
        let thin = backs_m2 > THIN * whole;
        if thin && state.given_views.is_empty() {
            let at_backs = backs::views(&grid, state.working_distance);
            candidates.extend(at_backs.map(|view| (view, None)));
        }
        let marcher = Marcher::new(&grid, &leaps, &state.sensor);
        let stride = ray_stride(&state.camera, state.working_distance, grid.voxel);
        let look = |(view, given): &(View, Option<usize>)| {
            if state.budget.is_spent() {
                return None;
            }
            let pose = state.pose(view, *given);
            let seen = marcher.forecast(&state.camera, &pose, stride, state.tolerance);
            let area = seen.area;
            // What lies beyond bounds the gain from above; it means nothing where misses do not carve.
            let (backs, pixels) = marcher.backs_in_view(&state.camera, &pose);
            let told = if thin { seen.with_expected(pixels) } else { seen };
            let new = area.covered + if carves { 0.5 * area.beyond } else { 0.0 } + if thin { backs } else { 0.0 };
            let all = (seen.hidden + seen.known).max(1.0);
            Some(ViewForecast {
                view: *view,
                given: *given,
                gain: new / total,
                reported_gain: ((area.expected + backs) / (swollen * whole)).min(missing),
                overlap: seen.overlap(trust),
                reported_overlap: told.seen_again(trust),
                cautious_overlap: told.seen_again_at_least(trust, carves),
                dense: seen.dense(),
                novelty: novelty(view, &state.scans),
                known_m2: area.known,
                expected_m2: area.expected + backs,
                pixels: [seen.hidden, seen.expected, seen.known, seen.known_behind, seen.covered].map(|n| n / all),
            })
        };
        // Episodes side by side, on threads of rayon's, fill the cores already.
        let look_at = |candidates: &[_]| -> Vec<ViewForecast> {
            match rayon::current_thread_index() {
                Some(_) => candidates.iter().filter_map(look).collect(),
                None => candidates.par_iter().filter_map(look).collect(),
            }
        };
        let mut views = look_at(&candidates);
        let most = views.iter().map(|f| f.reported_gain).fold(0.0, f64::max);
        // Where there is no boundary the surface is closed: a run ends.
        let open = state.given_views.is_empty() && !views.is_empty();
        let elsewhere = open && missing > MUCH && most < LITTLE * missing;
        if elsewhere {
            let at_holes: Vec<_> = holes::views(&grid, state.working_distance).map(|view| (view, None)).collect();
            views.extend(look_at(&at_holes));
        }
        (self.grid, self.leaps) = (Some(grid), Some(leaps));
        Forecasts { views, surface: Surface { known_m2, expected_m2: membrane_m2 }, elsewhere }
    }
}

/// Pixels between rays that meet surface at this distance about a voxel apart.
fn ray_stride(camera: &PinholeCamera, distance: f64, voxel: f64) -> u32 {
    (voxel / camera.pixel_size(distance)).round().clamp(1.0, 64.0) as u32
}

/// Angle at the target between a view and the nearest past camera, in half turns.
fn novelty(view: &View, scans: &[Arc<PastScan>]) -> f64 {
    let direction = |eye: Point3<f64>| (eye - view.target).try_normalize(0.0).unwrap_or_default();
    let own = direction(view.position);
    let past = scans.iter().map(|s| direction(s.world_from_camera.translation.vector.into()).dot(&own));
    past.fold(-1.0, f64::max).clamp(-1.0, 1.0).acos() / std::f64::consts::PI
}

impl Planner for VolumetricPlanner {
    fn name(&self) -> &str {
        "volumetric"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let (known, all) = (state.num_placed(), state.num_scans);
        if known == 0 || known < all {
            return Err(PlanError::lacks("volumetric", format!("the cameras of {known} of {all} scans are known")));
        }
        let forecasts = self.forecast(state, rng);
        state.budget.allows(!forecasts.views.is_empty())?;
        checked("volumetric", self.rank(&forecasts), PlanError::NoBoundary)
    }

    fn reset(&mut self) {
        *self = Self::new(std::mem::take(&mut self.config));
    }
}

#[cfg(test)]
mod tests;
