//! `farthest`: the view seen from the direction farthest from all past cameras. No learning, no voxels; simple, strong,
//! and blind to overlap.

use crate::planner::checked;
use crate::{CandidateConfig, PlanError, Planner, RankedView, ScanState, candidate_views};
use geometry::View;
use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;

/// Where its views come from.
#[derive(Clone, Debug)]
enum Among {
    /// Around the centre, the working distance and this much away from it.
    Sphere(Vec<Vector3<f64>>, Distance),
    /// BENBV's candidates.
    Candidates(CandidateConfig),
}

/// Distance from the centre to cameras on a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distance {
    /// The working distance and this many metres.
    Beyond(f64),
    /// This many metres.
    Fixed(f64),
}

/// Ranks views by the least angle, about a centre, between their camera and any past one.
#[derive(Clone, Debug)]
pub struct FarthestPlanner {
    name: String,
    among: Among,
    center: Option<Point3<f64>>,
}

impl FarthestPlanner {
    /// Among BENBV's candidates, about `center`; about the mean of the cloud's points where the middle of the object is
    /// not known.
    pub fn among_candidates(name: &str, candidates: CandidateConfig, center: Option<Point3<f64>>) -> Self {
        Self { name: name.to_owned(), among: Among::Candidates(candidates), center }
    }

    /// Among these directions around `center`.
    pub fn on_sphere(name: &str, directions: Vec<Vector3<f64>>, distance: Distance, center: Point3<f64>) -> Self {
        Self { name: name.to_owned(), among: Among::Sphere(directions, distance), center: Some(center) }
    }
}

impl Planner for FarthestPlanner {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        // Not the middle of the bounding box: that does not turn with the cloud.
        let mean =
            || state.cloud.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / state.cloud.len().max(1) as f64;
        let center = self.center.unwrap_or_else(|| Point3::from(mean()));
        let toward = |p: Point3<f64>| (p - center).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let mut past: Vec<Vector3<f64>> =
            state.scans.iter().map(|s| toward(Point3::from(s.world_from_camera.translation.vector))).collect();
        if past.is_empty() {
            // A surface is seen from the side to which its normals point.
            past.extend(state.cloud.normals.iter().sum::<Vector3<f64>>().try_normalize(0.0));
        }
        let views: Vec<View> = match &self.among {
            _ if !state.given_views.is_empty() => state.given(),
            Among::Sphere(directions, distance) => {
                let radius = match distance {
                    Distance::Beyond(more) => state.working_distance + more,
                    Distance::Fixed(radius) => *radius,
                };
                directions.iter().map(|d| View { target: center, position: center + radius * d }).collect()
            }
            Among::Candidates(config) => {
                let near = state.neighborhoods(config.boundary.neighbors);
                let candidates = candidate_views(&state.cloud, &near, state.working_distance, config, rng);
                candidates.into_iter().map(|c| c.view).collect()
            }
        };
        let angle = |view: &View| {
            let d = toward(view.position);
            let nearest = past.iter().map(|p| p.dot(&d)).fold(-1.0, f64::max);
            nearest.clamp(-1.0, 1.0).acos() / std::f64::consts::PI
        };
        let are_given = !state.given_views.is_empty();
        let ranked = |(i, view)| RankedView { given: are_given.then_some(i), ..RankedView::scored(view, angle(&view)) };
        let mut ranked: Vec<RankedView> = views.into_iter().enumerate().map(ranked).collect();
        ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
        checked(&self.name, ranked, PlanError::NoBoundary)
    }
}
