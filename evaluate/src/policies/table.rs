//! An object on a table: nothing is reachable below the table's top, whatever the policy prefers.

use planning::planner::checked;
use planning::{PlanError, Planner, RankedView, ScanState};
use rand_chacha::ChaCha8Rng;

/// Passes over views whose camera stands below a height.
pub struct AboveTable<'a> {
    inner: Box<dyn Planner + Send + 'a>,
    least_z: f64,
}

impl<'a> AboveTable<'a> {
    /// The policy's views with the camera at least this high, metres.
    pub fn new(inner: Box<dyn Planner + Send + 'a>, least_z: f64) -> Self {
        Self { inner, least_z }
    }
}

impl Planner for AboveTable<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let mut views = self.inner.rank_views(state, rng)?;
        views.retain(|r| r.view.position.z >= self.least_z);
        let none = PlanError::no_view(self.name(), "all of its views are below the table top");
        checked(self.name(), views, none)
    }

    fn reset(&mut self) {
        self.inner.reset();
    }
}
