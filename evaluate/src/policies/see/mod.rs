//! SEE, the Surface Edge Explorer in its SEE++ generation (Border and Gammell, IJRR 2024): density classes of
//! points instead of a mesh or voxels, views proposed at the edges of the seen surface, turned out of occlusion ahead
//! of time, chosen by a graph of which view sees which edge. Exact neighbours, fixed order and no clock replace the
//! published octree, threads and time-limited solver, so that runs repeat.

mod controller;
mod frontier;
mod graph;
mod grid;
mod optimise;
mod params;
mod state;
#[cfg(test)]
mod tests;
mod visibility;

pub use params::SeeConfig;

use geometry::View;
use nalgebra::Point3;
use params::SeeParams;
use planning::planner::checked;
use planning::{PastScan, PlanError, Planner, RankedView, ScanState, Seen};
use rand_chacha::ChaCha8Rng;
use state::Surface;

/// SEE as a policy. Offers nothing when no frontier is left, or when the scans' poses are not known; fails where a density
/// that is set leaves too few points to tell edges by.
pub struct SeePlanner {
    name: String,
    config: SeeConfig,
    drive: Drive,
    surface: Option<Surface>,
    /// Scans already taken in.
    seen: usize,
}

/// How the benchmark calls SEE.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drive {
    /// The newest scan with its camera.
    Correct,
    /// As published.
    Paper,
}

impl SeePlanner {
    /// Driven as its authors meant it: each new scan with the position it was taken from.
    pub fn new(name: &str, config: SeeConfig) -> Self {
        Self { name: name.to_owned(), config, drive: Drive::Correct, surface: None, seen: 0 }
    }

    /// Driven as the published benchmark did: the accumulated cloud instead of the scan, the last *target* as the
    /// sensor's position, and the last proposal repeated when no frontier is left.
    pub fn paper() -> Self {
        Self { drive: Drive::Paper, ..Self::new("see:paper", SeeConfig::paper()) }
    }

    fn surface(&mut self, state: &ScanState, scan: &[Point3<f64>]) -> Result<&mut Surface, PlanError> {
        let surface = match self.surface.take() {
            Some(surface) => surface,
            None => SeeParams::resolve(&self.config, scan, state.grid_size, state.working_distance)
                .map(Surface::new)
                .ok_or_else(|| self.unusable(state.grid_size))?,
        };
        Ok(self.surface.insert(surface))
    }

    /// Why there are no parameters: a density that is set is at fault, one that was derived is the first scan's.
    fn unusable(&self, spacing: f64) -> PlanError {
        let (density, radius) = (self.config.density_per_m3, self.config.radius(spacing));
        if density > 0.0 && radius > 0.0 {
            let why = format!(
                "see.density_per_m3 = {density} asks for fewer than 3 points per ball of {radius:.4} m: set a higher density \
                 or a larger see.radius_m, or 0, which derives it from the first scan"
            );
            return PlanError::failed(&self.name, why);
        }
        PlanError::no_view(&self.name, "the first scan is too sparse to tell its edges")
    }

    fn rank_correct(&mut self, state: &ScanState) -> Result<Vec<RankedView>, PlanError> {
        let unseen = self.seen.min(state.scans.len());
        self.seen = state.scans.len();
        for scan in &state.scans[unseen..] {
            let points = points_of(scan);
            let sensor = Point3::from(scan.world_from_camera.translation.vector);
            self.surface(state, &points)?.update(&points, sensor);
        }
        let Some(surface) = self.surface.as_ref().filter(|s| !s.done) else { return Ok(Vec::new()) };
        let Some(target) = surface.target else { return Ok(Vec::new()) };
        let rest = surface.frontiers_by_view(&surface.sensor, usize::MAX).into_iter().filter(|&i| i != target);
        Ok(std::iter::once(target).chain(rest).map(|i| ranked(surface.proposal(i), surface.graph.sees(i))).collect())
    }

    fn rank_paper(&mut self, state: &ScanState) -> Result<Vec<RankedView>, PlanError> {
        let sensor = match &self.surface {
            // The first call names the initial view's target, the origin, as the sensor.
            None => Point3::origin(),
            Some(surface) => {
                surface.next.map_or_else(Point3::origin, |view| rebuilt(&view, state.working_distance).target)
            }
        };
        self.surface(state, &state.cloud.points)?.update(&state.cloud.points, sensor);
        // Before any selection the published proposal is zeroed memory: a camera in its own target sees nothing.
        let zeros = View { target: Point3::origin(), position: Point3::origin() };
        let next =
            self.surface.as_ref().and_then(|s| s.next).map_or(zeros, |view| rebuilt(&view, state.working_distance));
        Ok(vec![ranked(next, 0)])
    }
}

/// The published harness puts the target at the working distance before the camera, wherever SEE meant it.
fn rebuilt(view: &View, working_distance: f64) -> View {
    View { target: view.position - working_distance * view.direction(), position: view.position }
}

fn ranked(view: View, sees: usize) -> RankedView {
    RankedView::scored(view, (sees + 1) as f64)
}

/// World points of a scan.
fn points_of(scan: &PastScan) -> Vec<Point3<f64>> {
    match &scan.seen {
        Seen::Depth { camera, depth, .. } => depth.to_points(camera, &scan.world_from_camera),
        Seen::Points(points) => points.clone(),
    }
}

impl Planner for SeePlanner {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, _rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        if state.scans.is_empty() {
            return Err(PlanError::lacks(&self.name, "the camera of no scan is known"));
        }
        let views = match self.drive {
            Drive::Correct => self.rank_correct(state),
            Drive::Paper => self.rank_paper(state),
        }?;
        checked(&self.name, views, PlanError::no_view(&self.name, "no frontier is left"))
    }

    fn reset(&mut self) {
        self.surface = None;
        self.seen = 0;
    }
}
