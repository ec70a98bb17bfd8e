//! The backs of parts that are thinner than a voxel: right behind a measured front is free space, so that the part ends in the voxel of its
//! front. No membrane passes there, and its back is missing all the same, until a scan has looked at it.

use super::grid::{ExpectedVoxel, FREE, SurfaceVoxel, VoxelGrid};
use super::holes::Spot;
use super::march::Marcher;
use crate::{CameraPose, ScanState};
use geometry::{PinholeCamera, View};
use nalgebra::{Isometry3, Point3, Vector3};

/// Where space must be free, voxels behind the middle of a front's (before it where less than 0). Rays that graze bumps, or pass beside points that
/// lie off their places, leave free space inside of what is thick as well: not as deep. Normals that point inwards have none before them.
const FREE_AT: [f64; 7] = [-1.5, -1.0, 1.0, 1.5, 2.0, 2.5, 3.0];
/// Views at backs, about, and backs that a view is asked about at most.
const CANDIDATES: usize = 16;
const RAYS: usize = 1_000;

/// The backs that no scan has looked at. None where cameras are estimated: what those leave free is too uncertain, and runs with clouds alone took
/// two views more to end with it.
pub(super) fn open_backs(marcher: &Marcher, state: &ScanState) -> Vec<ExpectedVoxel> {
    if state.scans.iter().any(|scan| matches!(scan.pose, CameraPose::Estimated(_))) {
        return Vec::new();
    }
    let grid = marcher.grid();
    let is_open = |back: &ExpectedVoxel| {
        let spot = Spot::of(grid, back, true);
        !state.scans.iter().any(|scan| spot.was_in_sight(marcher, scan))
    };
    grid.surface.iter().filter_map(|front| behind(grid, front, state)).filter(is_open).collect()
}

/// The back of this front, if it lies in the same voxel.
fn behind(grid: &VoxelGrid, front: &SurfaceVoxel, state: &ScanState) -> Option<ExpectedVoxel> {
    if front.both_sides {
        return None;
    }
    let normal = Vector3::from(front.normal).cast::<f64>().try_normalize(1e-6)?;
    let middle = grid.middle(front.index);
    let free = |voxels: &f64| {
        let at = middle - normal * (voxels * grid.voxel);
        // Below what the object stands on nothing was seen to be free.
        let above = state.support.as_ref().is_none_or(|plane| plane.height(&at) > grid.voxel);
        above && grid.index(&at).is_some_and(|i| i == front.index as usize || grid.code[i] == FREE)
    };
    FREE_AT.iter().all(free).then(|| ExpectedVoxel::new(front.index, front.normal.map(|x| -x)))
}

/// Views at some of the backs from straight behind.
pub(super) fn views(grid: &VoxelGrid, distance: f64) -> impl Iterator<Item = View> {
    grid.backs.iter().step_by(grid.backs.len().div_ceil(CANDIDATES).max(1)).map(move |back| {
        let Spot { point: target, normal, .. } = Spot::of(grid, back, true);
        View { target, position: target + distance * normal }
    })
}

impl Marcher<'_> {
    /// What a view sees of the backs: how much area it measures, square metres, and in how many pixels.
    pub(super) fn backs_in_view(&self, camera: &PinholeCamera, pose: &Isometry3<f64>) -> (f64, f64) {
        let eye = Point3::from(pose.translation.vector);
        let step = self.grid().backs.len().div_ceil(RAYS).max(1);
        let spots = self.grid().backs.iter().step_by(step).map(|back| Spot::of(self.grid(), back, true));
        let seen = spots.filter(|spot| spot.is_seen(self, camera, pose));
        let of = |spot: Spot| (spot.measured_area(&eye), spot.angle(&eye) * camera.fx * camera.fy);
        let (area, pixels) = seen.map(of).fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
        (step as f64 * area, step as f64 * pixels)
    }
}
