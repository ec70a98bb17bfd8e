//! What a policy may see.

use crate::estimate::Trust;
use crate::pose::CameraRoll;
use crate::scan::Veil;
use crate::{Budget, Plane, SensorConfig};
use geometry::neighbors::{NeighborGrid, Neighborhoods};
use geometry::{DepthImage, PinholeCamera, PointCloud, View};
use nalgebra::{Isometry3, Point3};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

/// What a pixel without a return says about its ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoReturn {
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
        misses: NoReturn,
    },
    /// Only points (world frame): free space is known along the rays to them, and no further.
    Points(Vec<Point3<f64>>),
}

impl Seen {
    /// Whether this may be what the other saw, moved.
    pub(crate) fn is_as_large_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Depth { depth: a, .. }, Self::Depth { depth: b, .. }) => a == b,
            (Self::Points(a), Self::Points(b)) => a.len() == b.len(),
            _ => false,
        }
    }
}

/// One scan done so far.
#[derive(Clone, Debug, PartialEq)]
pub struct PastScan {
    /// The camera pose.
    pub world_from_camera: Isometry3<f64>,
    /// What it saw.
    pub seen: Seen,
    /// How its camera is known.
    pub pose: CameraPose,
    /// Of points: where others were left out. Of an image the pixels tell, which are not a number there.
    pub veil: Option<Arc<Veil>>,
}

/// How the camera of a scan is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum CameraPose {
    /// It was given.
    #[default]
    Given,
    /// Told by the cloud ([`crate::estimate`]).
    Estimated(Trust),
}

/// All that a policy may see: what was measured, from where, and the user's settings. Never ground truth
/// (invariant 5).
#[derive(Clone, Debug, Default)]
pub struct ScanState {
    /// The accumulated cloud, world frame, normals towards the cameras.
    pub cloud: PointCloud,
    /// The scans so far, oldest first. Empty, or shorter than `num_scans`, where only clouds are known.
    /// Shared: planners remember which of them they have taken in.
    pub scans: Vec<Arc<PastScan>>,
    /// Of each of these, the scan of the session that it is of, from 1: a line scanner's is several. Empty: each is one.
    pub of_scan: Vec<usize>,
    /// Number of scans in `cloud`, at least 1 (the network's view order is this minus one).
    pub num_scans: usize,
    /// Spacing of the accumulated cloud, metres: of one that is averaged the edge of its voxels, which is the mean
    /// nearest-neighbour distance of the first scan; of one that is thinned that distance, as it is now.
    pub grid_size: f64,
    /// Distance from target to camera that the next view shall have, metres (method: 1.2).
    pub working_distance: f64,
    /// Distance under which two points count as the same surface, metres (method: 0.002).
    pub tolerance: f64,
    /// Distance within which a point of the cloud stands for measured surface, metres: the tolerance, and more where the
    /// cloud was thinned to be sparser than what was measured.
    pub reach: f64,
    /// Camera that will take the next scan.
    pub camera: PinholeCamera,
    /// What that camera measures.
    pub sensor: SensorConfig,
    /// What the object stands on: it does not reach below.
    pub support: Option<Plane>,
    /// Poses that the next view is chosen from (`world_from_camera`); empty: views at the boundary of the cloud.
    pub given_views: Arc<[Isometry3<f64>]>,
    /// How the camera is turned about its optical axis at all other views.
    pub roll: CameraRoll,
    /// How long the decision may take: asked between views.
    pub budget: Budget,
    /// Neighbourhoods of the cloud's points, found when first asked for.
    pub near: OnceLock<Neighborhoods>,
}

impl ScanState {
    /// The number of the scan that the i-th of `scans` is of, from 1.
    pub fn number(&self, i: usize) -> usize {
        self.of_scan.get(i).copied().unwrap_or(i + 1)
    }

    /// Scans of which at least one camera is known.
    pub fn num_placed(&self) -> usize {
        (0..self.scans.len()).map(|i| self.number(i)).collect::<BTreeSet<_>>().len()
    }

    /// The given views as targets and positions: each looks at what is the working distance ahead of it.
    pub fn given(&self) -> Vec<View> {
        self.given_views.iter().map(|pose| View::from_pose(pose, self.working_distance)).collect()
    }

    /// The camera's pose at a view: of a given one, by its place in `given_views`, as it was given.
    pub fn pose(&self, view: &View, given: Option<usize>) -> Isometry3<f64> {
        let as_given = given.and_then(|i| self.given_views.get(i).copied());
        as_given.unwrap_or_else(|| self.roll.world_from_camera(view))
    }

    /// A grid over the points of the cloud.
    pub fn grid(&self) -> NeighborGrid {
        NeighborGrid::new(&self.cloud.points, 2.0 * self.grid_size)
    }

    /// The neighbourhoods of `k` points: those known already where they are of this cloud and size, else found now.
    pub fn neighborhoods(&self, k: usize) -> Cow<'_, Neighborhoods> {
        let points = &self.cloud.points;
        let find = || self.grid().neighborhoods_in_parallel(points.len(), k);
        let known = self.near.get_or_init(find);
        let fits = known.len() == points.len() && known.k() == k.min(points.len());
        if fits { Cow::Borrowed(known) } else { Cow::Owned(find()) }
    }
}

#[cfg(test)]
mod tests;
