//! Random views of a fixed set around the object, each once: Random U-Sphere over a latitude-longitude grid,
//! Random-33 over PC-NBV's views.

use super::Radius;
use super::sphere::{nearest_direction, view_at};
use nalgebra::{Point3, Vector3};
use planning::planner::checked;
use planning::{PlanError, Planner, RankedView, ScanState};
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Uniform among the directions not yet used. The one nearest to the first camera counts as used.
pub struct RandomSetPlanner {
    name: String,
    radius: Radius,
    directions: Vec<Vector3<f64>>,
    used: Vec<bool>,
    /// Scans whose views are marked.
    marked: usize,
}

impl RandomSetPlanner {
    /// Over these directions, on the sphere of this radius.
    pub fn new(name: &str, directions: Vec<Vector3<f64>>, radius: Radius) -> Self {
        Self { name: name.to_owned(), radius, used: vec![false; directions.len()], directions, marked: 0 }
    }
}

impl Planner for RandomSetPlanner {
    fn name(&self) -> &str {
        &self.name
    }

    /// Empty once every view was used.
    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        for scan in state.scans.iter().skip(self.marked) {
            let position = Point3::from(scan.world_from_camera.translation.vector);
            if let Some(i) = nearest_direction(&self.directions, &position) {
                self.used[i] = true;
            }
        }
        self.marked = state.scans.len();
        let mut unused: Vec<usize> = (0..self.directions.len()).filter(|&i| !self.used[i]).collect();
        unused.shuffle(rng);
        let radius = self.radius.metres(state);
        let views = unused.into_iter().map(|i| RankedView::scored(view_at(&self.directions[i], radius), 0.0)).collect();
        checked(&self.name, views, PlanError::no_view(&self.name, "every view of the set was used"))
    }

    fn reset(&mut self) {
        self.used.fill(false);
        self.marked = 0;
    }
}
