//! The model-based search BENBV: every candidate view is scanned in the simulator and scored.

use crate::episode::EpisodeConfig;
use crate::scene::{RenderConfig, RenderScratch, Scene};
use geometry::cloud::Voxels;
use geometry::coverage::share_within;
use geometry::neighbors::GrowingNeighborhoods;
use geometry::{NeighborGrid, PinholeCamera, PointCloud, View, ViewScore, score_view};
use nalgebra::Point3;
use planning::Accumulate;
use planning::accumulate::reference_surface;
use planning::candidates::candidate_views;
use planning::planner::checked;
use planning::{CandidateConfig, CandidateView, PlanError, Planner, RankedView, ScanState};
use rand_chacha::ChaCha8Rng;

/// Settings of the search.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SearchConfig {
    /// The candidate views.
    pub candidates: CandidateConfig,
    /// How the search imagines a scan: the simulator, without noise.
    pub render: RenderConfig,
    /// What the cloud consists of.
    pub accumulate: Accumulate,
    /// Score the mean of four images, shifted by a quarter pixel each way, for the one that the scan will take: the
    /// search then knows the object, but not where on it the pixels fall. Off by default.
    pub shifted: bool,
}

impl SearchConfig {
    /// As published.
    pub fn paper() -> Self {
        Self::of(&EpisodeConfig::paper(), CandidateConfig::paper())
    }

    /// The search that imagines what the episode's simulator will measure, but for its noise.
    pub fn of(episode: &EpisodeConfig, candidates: CandidateConfig) -> Self {
        let render = RenderConfig { noise: None, ..episode.render.clone() };
        Self { candidates, render, accumulate: episode.accumulate, shifted: false }
    }
}

/// The candidates of a decision with their scores.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScoredViews {
    /// In the order of the greedy traversal.
    pub candidates: Vec<CandidateView>,
    /// One per candidate.
    pub scores: Vec<ViewScore>,
    /// Coverage before the decision.
    pub current_coverage: f64,
}

/// The policy `benbv`: knows the object. `samples` are its 60,000 surface samples, not yet averaged.
pub struct SearchPlanner<'a> {
    scene: &'a Scene,
    samples: &'a [Point3<f64>],
    config: SearchConfig,
    reference: Vec<Point3<f64>>,
    grid_size: f64,
    neighborhoods: GrowingNeighborhoods,
    last: ScoredViews,
}

impl<'a> SearchPlanner<'a> {
    /// A search in this scene.
    pub fn new(scene: &'a Scene, samples: &'a [Point3<f64>], config: SearchConfig) -> Self {
        Self {
            scene,
            samples,
            config,
            reference: Vec::new(),
            grid_size: 0.0,
            neighborhoods: GrowingNeighborhoods::default(),
            last: ScoredViews::default(),
        }
    }

    /// The candidates of the last decision and their scores.
    pub fn last_decision(&self) -> &ScoredViews {
        &self.last
    }
}

impl Planner for SearchPlanner<'_> {
    fn name(&self) -> &str {
        "benbv"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        if self.reference.is_empty() || self.grid_size != state.grid_size {
            self.reference = reference_surface(self.samples, state.grid_size, self.config.accumulate);
            self.grid_size = state.grid_size;
        }
        let candidates = &self.config.candidates;
        let grid = state.grid();
        let neighborhoods = self.neighborhoods.update(&grid, &state.cloud.points, candidates.boundary.neighbors);
        let candidates = candidate_views(&state.cloud, neighborhoods, state.working_distance, candidates, rng);
        let views: Vec<View> = candidates.iter().map(|c| c.view).collect();
        let (current_coverage, scores) = score_views(self.scene, &self.reference, state, &grid, &views, &self.config);
        self.last = ScoredViews { candidates, scores, current_coverage };
        checked("benbv", self.last.ranked(), PlanError::NoBoundary)
    }

    fn reset(&mut self) {
        self.reference.clear();
        self.neighborhoods = GrowingNeighborhoods::default();
        self.last = ScoredViews::default();
    }
}

impl ScoredViews {
    /// Views by falling score; ties keep the order of the candidates.
    pub fn ranked(&self) -> Vec<RankedView> {
        let mut ranked: Vec<RankedView> = self
            .candidates
            .iter()
            .zip(&self.scores)
            .map(|(candidate, score)| RankedView {
                gain: Some(score.coverage - self.current_coverage),
                overlap: score.overlap,
                ..RankedView::scored(candidate.view, score.score)
            })
            .collect();
        ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
        ranked
    }
}

/// Shifts of the image in pixels: none.
const UNSHIFTED: [[f64; 2]; 1] = [[0.0, 0.0]];
/// A quarter pixel each way.
const SHIFTED: [[f64; 2]; 4] = [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]];

/// Coverage before the scan, and what each view would bring. `reference` is the voxel-averaged surface, `grid` that of the
/// state's cloud.
///
/// With [`Accumulate::Averaged`] the coverage after a view is that of the cloud and the raw scan together, which is
/// 0.1 to 0.2 points above that of the voxel-averaged cloud; with [`Accumulate::Matched`] the scan is merged and
/// averaged for every view, as published.
pub fn score_views(
    scene: &Scene,
    reference: &[Point3<f64>],
    state: &ScanState,
    grid: &NeighborGrid,
    views: &[View],
    config: &SearchConfig,
) -> (f64, Vec<ViewScore>) {
    let tolerance = state.tolerance;
    let total = reference.len().max(1) as f64;
    let uncovered: Vec<Point3<f64>> = match config.accumulate {
        Accumulate::Thinned | Accumulate::Averaged => {
            reference.iter().copied().filter(|p| !grid.any_within(p, tolerance)).collect()
        }
        Accumulate::Matched => Vec::new(),
    };
    let current = match config.accumulate {
        Accumulate::Thinned | Accumulate::Averaged => 1.0 - uncovered.len() as f64 / total,
        Accumulate::Matched => state.cloud.len() as f64 / total,
    };
    let uncovered_grid = NeighborGrid::new(&uncovered, 2.0 * tolerance);
    let mut newly_covered = vec![0; uncovered.len()];
    let mut images = 0;
    let matched = match config.accumulate {
        Accumulate::Thinned | Accumulate::Averaged => Vec::new(),
        Accumulate::Matched => matched_indices(reference, &state.cloud.points),
    };
    let mut merged = state.cloud.points.clone();
    let mut scratch = RenderScratch::default();
    let mut scan = PointCloud::default();
    let shifts: &[[f64; 2]] = if config.shifted { &SHIFTED } else { &UNSHIFTED };
    let mut look = |view: &View, shift: &[f64; 2]| {
        images += 1;
        scan.points.clear();
        if view.is_valid() {
            let camera =
                PinholeCamera { cx: state.camera.cx + shift[0], cy: state.camera.cy + shift[1], ..state.camera };
            let world_from_camera = view.world_from_camera();
            let image = scene.render(&camera, &world_from_camera, &config.render, &mut scratch);
            image.for_each_point(&camera, &world_from_camera, |p| scan.points.push(p));
        }
        let overlap = share_within(&scan.points, grid, tolerance);
        let coverage = match config.accumulate {
            Accumulate::Thinned | Accumulate::Averaged => {
                let mut gained = 0;
                for p in &scan.points {
                    uncovered_grid.for_each_within(p, tolerance, |j| {
                        gained += usize::from(newly_covered[j] != images);
                        newly_covered[j] = images;
                    });
                }
                1.0 - (uncovered.len() - gained) as f64 / total
            }
            Accumulate::Matched if scan.is_empty() => current,
            Accumulate::Matched => {
                merged.truncate(state.cloud.len());
                merged.extend_from_slice(&scan.points);
                let voxels = Voxels::new(&merged, state.grid_size, config.accumulate.voxel_origin());
                let means = voxels.means(merged.iter().map(|p| p.coords));
                let means: Vec<Point3<f64>> = means.into_iter().map(Point3::from).collect();
                let grid = NeighborGrid::new(&means, 2.0 * tolerance);
                // The mean of its own voxel covers nearly every point that is in the cloud.
                let own_mean = |own: &Option<usize>| means.get(voxels.number[(*own)?] as usize);
                let covered = reference.iter().zip(&matched).filter(|&(p, own)| {
                    own_mean(own).is_some_and(|mean| grid.is_within(p, mean, tolerance))
                        || grid.any_within(p, tolerance)
                });
                covered.count() as f64 / total
            }
        };
        (coverage, overlap)
    };
    let scores = views.iter().map(|view| {
        let seen: Vec<(f64, Option<f64>)> = shifts.iter().map(|shift| look(view, shift)).collect();
        let overlaps: Vec<f64> = seen.iter().filter_map(|s| s.1).collect();
        let mean = |sum: f64, count: usize| sum / count as f64;
        let coverage = mean(seen.iter().map(|s| s.0).sum(), seen.len());
        let overlap = (!overlaps.is_empty()).then(|| mean(overlaps.iter().sum(), overlaps.len()));
        score_view(coverage, overlap, current)
    });
    (current, scores.collect())
}

/// Per reference point its index in a cloud of reference points in the same order.
fn matched_indices(reference: &[Point3<f64>], cloud: &[Point3<f64>]) -> Vec<Option<usize>> {
    let mut next = 0;
    let index = |p: &Point3<f64>| {
        let found = (cloud.get(next) == Some(p)).then_some(next);
        next += usize::from(found.is_some());
        found
    };
    reference.iter().map(index).collect()
}

#[cfg(test)]
mod tests;
