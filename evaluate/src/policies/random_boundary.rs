//! Random Boundary: one of BENBV's candidate views, at random.

use planning::planner::checked;
use planning::{CandidateConfig, PlanError, Planner, RankedView, ScanState, candidate_views};
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Uniform among the candidates of each decision; repeats are possible.
pub struct RandomBoundaryPlanner {
    candidates: CandidateConfig,
}

impl RandomBoundaryPlanner {
    /// With the candidates of this configuration.
    pub fn new(candidates: CandidateConfig) -> Self {
        Self { candidates }
    }
}

impl Planner for RandomBoundaryPlanner {
    fn name(&self) -> &str {
        "random-boundary"
    }

    /// Empty if the cloud has no boundary.
    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let near = state.neighborhoods(self.candidates.boundary.neighbors);
        let mut candidates = candidate_views(&state.cloud, &near, state.working_distance, &self.candidates, rng);
        candidates.shuffle(rng);
        let views = candidates.into_iter().map(|c| RankedView::scored(c.view, 0.0)).collect();
        checked("random-boundary", views, PlanError::NoBoundary)
    }
}
