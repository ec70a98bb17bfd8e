//! Planning without a model: space carved by past scans, the surface expected in what is left unknown, and the gain
//! and overlap that a view can expect of both.

mod grid;
mod predict;

use crate::coverage::overlap_response;
use crate::{Angles, CandidateConfig, Misses, Planner, RankedView, ScanState, Seen, candidate_views};
use grid::VoxelGrid;
use nalgebra::Point3;
use predict::{Forecast, SampledSurface, forecast};
use rand_chacha::ChaCha8Rng;

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
    /// Coverage at which gain and overlap weigh the same (0.65).
    pub weight_center: f64,
    /// Views with a smaller expected overlap come after all others (0: none).
    pub min_overlap: f64,
    /// Voxel edge in pixels at the working distance (1.7: 4 mm at 1.2 m); grows where memory would not do.
    pub voxel_px: f64,
    /// The workspace; absent: taken from the first cloud.
    pub workspace: Option<Workspace>,
}

impl Default for VolumetricConfig {
    fn default() -> Self {
        Self {
            candidates: CandidateConfig { angles: Angles::All, ..CandidateConfig::default() },
            gain_only: false,
            weight_center: 0.65,
            min_overlap: 0.0,
            voxel_px: 1.7,
            workspace: None,
        }
    }
}

/// The policy `volumetric`. It needs past scans with camera poses, and has no view to offer where there is none.
#[derive(Clone, Debug, Default)]
pub struct VolumetricPlanner {
    config: VolumetricConfig,
    grid: Option<VoxelGrid>,
    carved: usize,
}

impl VolumetricPlanner {
    /// A planner that has seen nothing yet.
    pub fn new(config: VolumetricConfig) -> Self {
        Self { config, grid: None, carved: 0 }
    }

    fn new_grid(&self, state: &ScanState) -> VoxelGrid {
        let (low, high) = state.cloud.bounding_box();
        let workspace = self.config.workspace.unwrap_or(Workspace {
            center_m: nalgebra::center(&low, &high).into(),
            // The object may reach behind what was seen as far as it is wide.
            half_m: (1.1 * (high - low).norm()).max(1e-3),
        });
        let voxel = self.config.voxel_px * state.camera.pixel_size(state.working_distance);
        VoxelGrid::new(&Point3::from(workspace.center_m), workspace.half_m, voxel)
    }

    fn score(&self, forecast: &Forecast, state: &ScanState, expected_points: f64, carves: bool) -> RankedView {
        // Hidden pixels bound the gain from above; they mean nothing where misses do not carve.
        let new = if carves { (forecast.hidden + forecast.expected) / 2.0 } else { forecast.expected };
        let gain = new / expected_points;
        let covered = state.cloud.len() as f64 / expected_points;
        let overlap = forecast.overlap();
        let weight = 1.0 / (1.0 + (-10.0 * (covered - self.config.weight_center)).exp());
        let score = if self.config.gain_only {
            gain
        } else {
            weight * (covered + gain) + (1.0 - weight) * overlap.map_or(0.0, overlap_response)
        };
        RankedView { view: forecast.view, score, gain: Some(gain), overlap }
    }
}

impl Planner for VolumetricPlanner {
    fn name(&self) -> &str {
        "volumetric"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        if state.scans.is_empty() || state.cloud.is_empty() || !state.cloud.has_normals() {
            return Vec::new();
        }
        let mut grid = match self.grid.take() {
            Some(grid) if self.carved <= state.scans.len() => grid,
            _ => {
                self.carved = 0;
                self.new_grid(state)
            }
        };
        for scan in &state.scans[self.carved..] {
            grid.carve(scan);
        }
        self.carved = state.scans.len();
        grid.set_cloud(&state.cloud);
        grid.relax();
        let carves = state.scans.iter().all(|s| matches!(&s.seen, Seen::Depth { misses: Misses::Free, .. }));
        let per_voxel = (grid.voxel / state.grid_size.max(1e-9)).powi(2);
        let expected_points = state.cloud.len() as f64 + 0.8 * grid.expected_surface() as f64 * per_voxel;
        let surface = SampledSurface::new(&grid, &state.cloud, state.tolerance);
        let candidates = candidate_views(&state.cloud, state.working_distance, &self.config.candidates, rng);
        let mut ranked: Vec<RankedView> = candidates
            .iter()
            .map(|c| self.score(&forecast(&grid, &surface, &state.camera, c.view), state, expected_points, carves))
            .collect();
        let low = |r: &RankedView| r.overlap.unwrap_or(0.0) < self.config.min_overlap;
        ranked.sort_by(|a, b| low(a).cmp(&low(b)).then(b.score.total_cmp(&a.score)));
        self.grid = Some(grid);
        ranked
    }

    fn reset(&mut self) {
        self.grid = None;
        self.carved = 0;
    }
}

#[cfg(test)]
mod tests;
