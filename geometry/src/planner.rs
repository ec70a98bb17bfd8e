//! What a policy may see, and what it answers.

use crate::neighbors::{NeighborGrid, Neighborhoods};
use crate::{DepthImage, PinholeCamera, PointCloud, View};
use nalgebra::{Isometry3, Point3, Vector3};
use rand_chacha::ChaCha8Rng;
use std::borrow::Cow;

/// What a pixel without a return says about its ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Misses {
    /// Nothing there up to the camera's range: the ray is free space.
    Free,
    /// The sensor may have failed there: the ray stays unknown.
    #[default]
    Unknown,
}

/// What one past scan saw.
#[derive(Clone, Debug, PartialEq)]
pub enum Seen {
    /// A depth image.
    Depth {
        /// Intrinsics of the image.
        camera: PinholeCamera,
        /// The image.
        depth: DepthImage,
        /// What its pixels without a return mean.
        misses: Misses,
    },
    /// Only points (world frame): free space is known along the rays to them, and no further.
    Points(Vec<Point3<f64>>),
}

/// One scan done so far.
#[derive(Clone, Debug, PartialEq)]
pub struct PastScan {
    /// The camera pose.
    pub world_from_camera: Isometry3<f64>,
    /// What it saw.
    pub seen: Seen,
}

/// All that a policy may see: what was measured, from where, and the user's settings. Never ground truth
/// (invariant 5).
#[derive(Clone, Debug, Default)]
pub struct ScanState {
    /// The accumulated cloud, world frame, normals towards the cameras.
    pub cloud: PointCloud,
    /// The scans so far, oldest first. Empty, or shorter than `num_scans`, where only clouds are known.
    pub scans: Vec<PastScan>,
    /// Number of scans in `cloud`, at least 1 (the network's view order is this minus one).
    pub num_scans: usize,
    /// Voxel edge of the accumulated cloud, metres: the mean nearest-neighbour distance of the first scan.
    pub grid_size: f64,
    /// Distance from target to camera that the next view shall have, metres (docs/method.md: 1.2).
    pub working_distance: f64,
    /// Distance under which two points count as the same surface, metres (docs/method.md: 0.002).
    pub tolerance: f64,
    /// Camera that will take the next scan.
    pub camera: PinholeCamera,
    /// Neighbourhoods of the cloud's points, where whoever made it knows them already.
    pub near: Option<Neighborhoods>,
}

impl ScanState {
    /// The neighbourhoods of `k` points, found anew where they are not known.
    pub fn neighborhoods(&self, k: usize) -> Cow<'_, Neighborhoods> {
        let points = &self.cloud.points;
        let known = self.near.as_ref().filter(|near| near.len() == points.len() && near.k() == k.min(points.len()));
        known.map_or_else(
            || Cow::Owned(NeighborGrid::new(points, 2.0 * self.grid_size).neighborhoods(points.len(), k)),
            Cow::Borrowed,
        )
    }
}

/// A candidate for the next view, made at a boundary point of the cloud (docs/method.md, 'Boundary and candidate
/// views').
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CandidateView {
    /// Target (the boundary point) and camera position.
    pub view: View,
    /// Density at the target: 1 / (mean distance to 30 nearest neighbours + 1e-6), not yet divided by the
    /// maximum over the candidates.
    pub density: f64,
}

impl CandidateView {
    /// Unit vector from the target to the camera.
    pub fn direction(&self) -> Vector3<f64> {
        self.view.direction()
    }
}

/// Input of the network, before it becomes tensors: the accumulated cloud, the ordered candidates, and the
/// number of scans done minus one.
#[derive(Clone, Debug)]
pub struct Observation<'a> {
    /// The accumulated cloud with normals, not resampled.
    pub cloud: &'a PointCloud,
    /// Candidates in the order of the greedy traversal.
    pub candidates: &'a [CandidateView],
    /// Number of scans done minus one: 0 for the first decision.
    pub view_order: usize,
    /// Working distance in metres (the `cloud` normalisation scales it).
    pub working_distance: f64,
}

/// A view with what its policy expects of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankedView {
    /// The view.
    pub view: View,
    /// The policy's own score, larger is better.
    pub score: f64,
    /// Expected new surface as a share of the whole surface, where the policy predicts it.
    pub gain: Option<f64>,
    /// Expected overlap of the scan with the cloud, where the policy predicts it.
    pub overlap: Option<f64>,
}

/// A next-best-view policy.
pub trait Planner {
    /// Name on the command line.
    fn name(&self) -> &str;

    /// Views in falling order of preference; empty when the policy has none to offer. The first is taken by
    /// the episode loop; a robot's constraints may pass over some.
    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView>;

    /// Forget what was remembered of the current object: a new episode starts.
    fn reset(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_neighborhoods_are_taken_where_they_fit() {
        let points: Vec<_> = (0..50).map(|i| Point3::new(f64::from(i * i), 0.0, 0.0)).collect();
        let find = |k| NeighborGrid::new(&points, 0.0).neighborhoods(50, k);
        let cloud = PointCloud { points: points.clone(), ..Default::default() };
        let mut state = ScanState { cloud, near: Some(find(30)), ..Default::default() };
        let known = |state: &ScanState, k| matches!(state.neighborhoods(k), Cow::Borrowed(_));
        assert!(known(&state, 30) && !known(&state, 20), "as many as asked for");
        state.near = Some(find(50));
        assert!(known(&state, 60), "or all there are");
        state.cloud.points.pop();
        assert!(!known(&state, 50), "of another cloud");
        assert_eq!(state.neighborhoods(30).len(), 49);
        assert_eq!(state.neighborhoods(30).ids(7), find(30).ids(7), "found anew");
    }
}
