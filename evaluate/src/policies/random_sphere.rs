//! Random Sphere: whole degrees drawn anew for every view.

use super::sphere::{direction_deg, view_at};
use planning::{PlanError, Planner, RankedView, ScanState};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Draws offered per decision, so that constraints may pass over some.
const DRAWS: usize = 64;

/// Polar angle and azimuth uniform in whole degrees: denser at the poles, as published.
pub struct RandomSpherePlanner {
    name: String,
    radius: super::Radius,
}

impl RandomSpherePlanner {
    /// On the sphere of this radius.
    pub fn new(name: &str, radius: super::Radius) -> Self {
        Self { name: name.to_owned(), radius }
    }
}

impl Planner for RandomSpherePlanner {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let radius = self.radius.metres(state);
        let views = (0..DRAWS)
            .map(|_| {
                let (polar, azimuth) = (rng.random_range(0..180), rng.random_range(0..360));
                RankedView::scored(view_at(&direction_deg(f64::from(polar), f64::from(azimuth)), radius), 0.0)
            })
            .collect();
        Ok(views)
    }
}
