//! Point clouds: merging, thinning, moving.

use nalgebra::{Isometry3, Point3, Vector3};

/// Positions, and normals for all of them or none. Normals point towards the side from which the surface
/// was seen; after [`PointCloud::voxel_downsample`] they are averages and not of unit length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in metres.
    pub points: Vec<Point3<f64>>,
    /// One per point, or empty.
    pub normals: Vec<Vector3<f64>>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Whether every point has a normal.
    pub fn has_normals(&self) -> bool {
        self.normals.len() == self.points.len()
    }

    /// Appends another cloud. Normals survive only if both clouds have them.
    pub fn merge(&mut self, other: &PointCloud) {
        let keep = self.has_normals() && other.has_normals();
        self.points.extend_from_slice(&other.points);
        if keep {
            self.normals.extend_from_slice(&other.normals);
        } else {
            self.normals.clear();
        }
    }

    /// The cloud moved by a rigid motion.
    pub fn transformed(&self, motion: &Isometry3<f64>) -> PointCloud {
        PointCloud {
            points: self.points.iter().map(|p| motion * p).collect(),
            normals: self.normals.iter().map(|n| motion * n).collect(),
        }
    }

    /// Smallest and largest corner of the axis-aligned bounding box; both the origin for an empty cloud.
    pub fn bounding_box(&self) -> (Point3<f64>, Point3<f64>) {
        bounding_box(&self.points)
    }
}

/// Smallest and largest corner of the points' bounding box; both the origin if there is no point.
pub(crate) fn bounding_box(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let Some(first) = points.first() else {
        return (Point3::origin(), Point3::origin());
    };
    points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)))
}
