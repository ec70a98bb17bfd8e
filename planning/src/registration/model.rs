//! The cloud that scans are registered onto.

use super::icp::LIKE;
use super::{Frame, Icp, Information, Moving};
use crate::ScanState;
use geometry::{BoundaryConfig, NeighborGrid, PointCloud, boundary_points};
use nalgebra::{Isometry3, Point3, Vector3};

/// Tolerances that a pixel of the paper's camera is wide, 2.33 mm at 1.2 m: what a measured point counts for.
const PIXEL: f64 = 2.333 / 2.0;

/// A cloud, with what registration asks of it.
pub struct Model<'a> {
    /// Its points.
    pub cloud: &'a PointCloud,
    /// Its normals, of unit length.
    pub(super) normals: Vec<Vector3<f64>>,
    /// Which points are at the rim of what was measured: scans of what is beyond find them nearest, and wrongly.
    pub(super) rim: Vec<bool>,
    /// Mean distance of its points, metres.
    pub spacing: f64,
    /// Distance under which two points are the same surface, metres.
    pub tolerance: f64,
    grid: NeighborGrid,
}

/// How a scan lies on the cloud.
pub(super) struct Met {
    pub share: f64,
    pub like_normals: f64,
    /// Of the points that overlap with like normals.
    pub information: Information,
}

impl<'a> Model<'a> {
    /// The cloud of a session.
    pub fn of(state: &'a ScanState, kind: Icp) -> Self {
        let mut rim = vec![false; state.cloud.len()];
        if kind == Icp::Good {
            let boundary = BoundaryConfig::default();
            let near = state.neighborhoods(boundary.neighbors);
            boundary_points(&state.cloud, &near, &boundary).into_iter().for_each(|i| rim[i] = true);
        }
        Self::new(&state.cloud, rim, state.grid_size, state.tolerance)
    }

    /// A cloud with normals; `rim` has one entry per point.
    pub fn new(cloud: &'a PointCloud, rim: Vec<bool>, spacing: f64, tolerance: f64) -> Self {
        let unit = |n: &Vector3<f64>| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let mut normals: Vec<Vector3<f64>> = cloud.normals.iter().map(unit).collect();
        normals.resize(cloud.len(), Vector3::zeros());
        let grid = NeighborGrid::new(&cloud.points, 2.0 * spacing);
        Self { cloud, normals, rim, spacing, tolerance, grid }
    }

    /// The area that a measured point counts for, square metres.
    pub(super) fn pixel_area(&self) -> f64 {
        (PIXEL * self.tolerance).powi(2)
    }

    /// The nearest point within `reach`.
    pub(super) fn nearest(&self, p: &Point3<f64>, reach: f64) -> Option<usize> {
        let near = self.grid.nearest_within(p, reach.min(self.spacing));
        near.or_else(|| self.grid.nearest_within(p, reach)).map(|found| found.index)
    }

    /// How the scan lies on the cloud once it is moved.
    pub(super) fn met_by(&self, scan: &Moving, correction: &Isometry3<f64>, frame: &Frame) -> Met {
        let (mut near, mut alike, mut information) = (0usize, 0usize, Information::default());
        for (p, n) in scan.cloud.points.iter().zip(&scan.cloud.normals) {
            let p = correction * p;
            let Some(j) = self.nearest(&p, self.tolerance) else { continue };
            near += 1;
            let own = correction * n;
            if self.normals[j].dot(&own) > LIKE * own.norm() {
                alike += 1;
                information.add(&(p - frame.center), &self.normals[j], scan.footprint_m2, frame.radius);
            }
        }
        let share = |count: usize| count as f64 / scan.cloud.len().max(1) as f64;
        Met { share: share(near), like_normals: share(alike), information }
    }
}
