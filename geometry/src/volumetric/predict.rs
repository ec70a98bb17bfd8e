//! What a view would see, by marching through the voxels.

use super::grid::VoxelGrid;
use super::march::{Hit, Marcher};
use super::tiles::{TILE, Tiles};
use crate::neighbors::Neighborhoods;
use crate::{PinholeCamera, PointCloud, View};
use nalgebra::Vector3;

impl VoxelGrid {
    /// Estimates which share of the surface in each surface voxel the cloud covers within the tolerance: from eight
    /// samples in the tangent plane around each point of the cloud. `near` are the neighbours of its points.
    pub(super) fn estimate_covered(&mut self, cloud: &PointCloud, near: &Neighborhoods, tolerance: f64) {
        let radius = 1.1 * tolerance;
        let reach2 = (radius + tolerance).powi(2) as f32;
        let [radius, tolerance] = [radius, tolerance].map(|x| (x / self.voxel) as f32);
        let circle = [0u8, 1, 2, 3, 4, 5, 6, 7].map(|k| (f32::from(k) * std::f32::consts::FRAC_PI_4).sin_cos());
        let mut counts = vec![[0u32; 2]; self.surface.len()];
        let points: Vec<[f32; 3]> = cloud.points.iter().map(|p| self.local(p)).collect();
        // What a neighbour at d must exceed for it to cover the sample at o: |d - o| < tolerance.
        let excess = radius * radius - tolerance * tolerance;
        let mut around: Vec<[f32; 4]> = Vec::new();
        for (i, n) in cloud.normals.iter().enumerate() {
            let Some(n) = n.try_normalize(0.0) else { continue };
            let p = points[i];
            around.clear();
            around.extend(near.ids(i).iter().zip(near.distances2(i)).take_while(|&(_, &d2)| d2 < reach2).map(
                |(&j, _)| {
                    let d = [0, 1, 2].map(|k| points[j as usize][k] - p[k]);
                    [d[0], d[1], d[2], 0.5 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + excess)]
                },
            ));
            let any = if n.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
            let a = n.cross(&any).normalize();
            let [a, b] = [a, n.cross(&a)].map(|v| v.cast::<f32>() * radius);
            for (sin, cos) in circle {
                let o = [0, 1, 2].map(|k| a[k] * cos + b[k] * sin);
                let Some(slot) = self.slot_at(&[0, 1, 2].map(|k| p[k] + o[k])) else { continue };
                let covers = |d: &[f32; 4]| d[0] * o[0] + d[1] * o[1] + d[2] * o[2] > d[3];
                counts[slot][0] += 1;
                counts[slot][1] += u32::from(around.iter().any(covers));
            }
        }
        for (s, [all, near]) in self.surface.iter_mut().zip(counts) {
            s.covered = if all == 0 { 1.0 } else { near as f32 / all as f32 };
        }
    }
}

/// Pixels that a view expects, by what they show.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Forecast {
    /// Rays that enter unknown space before they meet surface.
    pub(super) hidden: f64,
    /// Those of them that meet the membrane there.
    pub(super) expected: f64,
    /// Rays that meet surface seen from its front.
    pub(super) known: f64,
    /// The same behind unknown space.
    pub(super) known_behind: f64,
    /// Covered share of both.
    pub(super) covered: f64,
}

impl Forecast {
    /// Expected overlap; `None` where nothing is expected to be seen.
    pub(super) fn overlap(&self) -> Option<f64> {
        let seen = self.known + self.known_behind + self.expected;
        (seen > 0.0).then(|| (1.07 * self.covered / seen).min(1.0))
    }
}

/// Rays of a view at most, as long as each tile has one: an object of 0.2 m at 1.2 m takes some 4,000.
const MAX_RAYS: u32 = 16_000;

/// The stride, doubled while the tiles would take more than [`MAX_RAYS`]: where a scene fills the image, fewer do.
pub(super) fn bounded_stride(stride: u32, tiles: u32) -> u32 {
    let fits = |s: &u32| *s >= TILE || tiles * TILE.div_ceil(*s).pow(2) <= MAX_RAYS;
    (0..TILE).map(|k| stride << k).find(fits).unwrap_or(stride)
}

impl Marcher<'_> {
    /// Follows every `stride`-th pixel of every `stride`-th row of a view.
    pub(super) fn forecast(&self, camera: &PinholeCamera, view: &View, stride: u32) -> Forecast {
        if !view.is_valid() {
            return Forecast::default();
        }
        let rotation = view.world_from_camera().rotation.to_rotation_matrix().into_inner().cast::<f32>();
        let eye = self.grid().local(&view.position);
        let tiles = Tiles::new(camera, &eye, &rotation, self.occupied());
        let stride = bounded_stride(stride, tiles.spans().count() as u32);
        let [across, down] = [rotation.column(0) / camera.fx as f32, rotation.column(1) / camera.fy as f32];
        let (mut counts, mut covered) = ([0u32; 4], 0f32);
        for tile in tiles.spans() {
            for row in (tile.row..(tile.row + TILE).min(camera.height)).step_by(stride as usize) {
                let base = rotation.column(2) + down * (row as f32 - camera.cy as f32);
                for column in (tile.column..(tile.column + TILE).min(camera.width)).step_by(stride as usize) {
                    let ray = base + across * (column as f32 - camera.cx as f32);
                    let ray = ray / ray.norm();
                    match self.follow(&eye, &ray.into(), tile.near, tile.far) {
                        Hit::Nothing { hidden } => counts[0] += u32::from(hidden),
                        Hit::Expected => {
                            counts[0] += 1;
                            counts[1] += 1;
                        }
                        Hit::Known { hidden, covered: share } => {
                            counts[0] += u32::from(hidden);
                            counts[if hidden { 3 } else { 2 }] += 1;
                            covered += share;
                        }
                    }
                }
            }
        }
        let pixels = f64::from(stride * stride);
        let [hidden, expected, known, known_behind] = counts.map(|c| f64::from(c) * pixels);
        Forecast { hidden, expected, known, known_behind, covered: f64::from(covered) * pixels }
    }
}
