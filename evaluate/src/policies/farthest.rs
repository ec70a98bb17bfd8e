//! Farthest View: the view with the largest least angle to all past cameras (planner.md, section 0): simple, strong,
//! and it needs no cloud.

use super::sphere::view_at;
use super::{Radius, ranked};
use geometry::{CandidateConfig, Planner, RankedView, ScanState, View, candidate_views};
use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;

/// Where its views come from.
pub enum FarthestAmong {
    /// Directions from the origin, at a radius.
    Sphere(Vec<Vector3<f64>>, Radius),
    /// BENBV's candidates.
    Candidates(CandidateConfig),
}

/// Ranks views by the least angle, seen from the origin, between their camera and any past one.
pub struct FarthestPlanner {
    name: String,
    among: FarthestAmong,
}

impl FarthestPlanner {
    /// Among these views.
    pub fn new(name: &str, among: FarthestAmong) -> Self {
        Self { name: name.to_owned(), among }
    }
}

impl Planner for FarthestPlanner {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        let views: Vec<View> = match &self.among {
            FarthestAmong::Sphere(directions, radius) => {
                let radius = radius.metres(state);
                directions.iter().map(|d| view_at(d, radius)).collect()
            }
            FarthestAmong::Candidates(config) => {
                candidate_views(&state.cloud, state.working_distance, config, rng).into_iter().map(|c| c.view).collect()
            }
        };
        let direction = |p: &Point3<f64>| p.coords.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let past: Vec<Vector3<f64>> =
            state.scans.iter().map(|s| direction(&Point3::from(s.world_from_camera.translation.vector))).collect();
        let mut list: Vec<RankedView> = views
            .into_iter()
            .map(|view| {
                let d = direction(&view.position);
                let nearest = past.iter().map(|p| p.dot(&d)).fold(-1.0, f64::max);
                ranked(view, nearest.clamp(-1.0, 1.0).acos())
            })
            .collect();
        list.sort_by(|a, b| b.score.total_cmp(&a.score));
        list
    }
}
