//! `farthest`: the boundary candidate seen from the direction farthest from all past cameras.
//!
//! No learning, no voxels; a strong yardstick (planner, sections 0 and 1: 'least angle to past cameras').

use geometry::{CandidateConfig, Planner, RankedView, ScanState, candidate_views_among};
use nalgebra::{Point3, Vector3};
use rand_chacha::ChaCha8Rng;

/// Ranks boundary candidates by the angle, about the mean of the cloud's points, between their camera and the
/// nearest past camera. Where no past camera is known the mean normal stands for it: a surface is seen
/// from the side its normals point to.
#[derive(Clone, Debug)]
pub struct FarthestPlanner {
    /// Which candidates are offered.
    pub candidates: CandidateConfig,
}

impl Planner for FarthestPlanner {
    fn name(&self) -> &str {
        "farthest"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        // Not the middle of the bounding box: that does not turn with the cloud.
        let sum: Vector3<f64> = state.cloud.points.iter().map(|p| p.coords).sum();
        let middle = Point3::from(sum / state.cloud.len().max(1) as f64);
        let toward = |p: Point3<f64>| (p - middle).try_normalize(0.0);
        let mut past: Vec<Vector3<f64>> = state
            .scans
            .iter()
            .filter_map(|scan| toward(Point3::from(scan.world_from_camera.translation.vector)))
            .collect();
        if past.is_empty() {
            past.extend(state.cloud.normals.iter().sum::<Vector3<f64>>().try_normalize(0.0));
        }
        let near = state.neighborhoods(self.candidates.boundary.neighbors);
        let candidates = candidate_views_among(&state.cloud, &near, state.working_distance, &self.candidates, rng);
        let mut ranked: Vec<RankedView> = candidates
            .into_iter()
            .map(|candidate| {
                let nearest = toward(candidate.view.position)
                    .map(|d| past.iter().map(|p| p.angle(&d)).fold(std::f64::consts::PI, f64::min));
                let score = nearest.unwrap_or(0.0) / std::f64::consts::PI;
                RankedView { view: candidate.view, score, gain: None, overlap: None }
            })
            .collect();
        ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
        ranked
    }
}
