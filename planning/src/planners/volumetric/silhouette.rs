//! Which part of a scan's image is background, where its misses do not say so: what lies outside of the outline of all
//! that it measured. A dropout inside of the outline stays unknown, and so does what was measured and is not believed.

use super::grid::{Projection, VoxelGrid};
use crate::scan::veil::pitch;
use crate::{PastScan, Seen};
use geometry::PinholeCamera;
use nalgebra::{Isometry3, Point3};

/// Cells by which an outline may err where parts are thinner than its cells.
const DEEP: usize = 3;
/// Cells along an axis of the coarse image at most.
const MAX_CELLS: usize = 512;

/// The coarse image of a scan.
#[derive(Clone, Debug)]
pub(super) struct Silhouette {
    camera_from_world: Isometry3<f64>,
    /// Cells per unit of x / z and y / z.
    scale: f64,
    /// Coordinates of the first cell's corner.
    corner: [f64; 2],
    size: [usize; 2],
    background: Vec<bool>,
    /// The part of it that is farther from the outline than pixels err.
    deep: Vec<bool>,
    /// The camera's image in x / z, y / z; absent where it is not known: everything beyond the points is background then.
    image: Option<[[f64; 2]; 2]>,
    /// Whether the scan left something out ([`PastScan::hides`]): wherever that lies, there is no background.
    veiled: bool,
}

impl Silhouette {
    /// The outline of what a scan measured: by the pixel in a depth image; of points in cells as wide as they are apart, half
    /// a `voxel` at least, and kept a cell away from them. `None` where nothing was measured.
    pub(super) fn of(scan: &PastScan, voxel: f64) -> Option<Self> {
        let camera_from_world = scan.world_from_camera.inverse();
        let mut directions = Vec::new();
        let mut depths = Vec::new();
        let mut add = |p: &Point3<f64>| {
            let p = camera_from_world * p;
            if p.z > 0.0 && p.iter().all(|x| x.is_finite()) {
                directions.push([p.x / p.z, p.y / p.z]);
                depths.push(p.z);
            }
        };
        let image = match &scan.seen {
            Seen::Depth { camera, depth, .. } => {
                depth.for_each_point(camera, &scan.world_from_camera, |p| add(&p));
                Some(corners(camera))
            }
            Seen::Points(points) => {
                points.iter().for_each(&mut add);
                None
            }
        };
        let middle = depths.len() / 2;
        let (_, &mut depth, _) =
            depths.get_mut(middle).is_some().then(|| depths.select_nth_unstable_by(middle, f64::total_cmp))?;
        let low = |k: usize| directions.iter().map(|d| d[k]).fold(f64::INFINITY, f64::min);
        let high = |k: usize| directions.iter().map(|d| d[k]).fold(f64::NEG_INFINITY, f64::max);
        let [from, to] = [[low(0), low(1)], [high(0), high(1)]];
        let widest = (to[0] - from[0]).max(to[1] - from[1]).max(f64::MIN_POSITIVE);
        // A gap between neighbouring points is no background. An image has no gaps, and its pixels lie in the middles of cells: on
        // their borders, rounding would leave some empty.
        let (cell, margin, half) = match &scan.seen {
            Seen::Depth { camera, .. } => (camera.fx.min(camera.fy).recip(), 0, 0.5),
            Seen::Points(_) => ((0.5 * voxel / depth).max(pitch(&directions, from, to)), 1, 0.0),
        };
        let cell = cell.max(widest / MAX_CELLS as f64);
        let edge = (margin + DEEP + 2) as f64 + half;
        let scale = 1.0 / cell;
        let corner = [from[0] - edge * cell, from[1] - edge * cell];
        let size = [0, 1].map(|k| ((to[k] - from[k]) * scale + 2.0 * edge).ceil().max(1.0) as usize);
        let mut measured = vec![false; size[0] * size[1]];
        for d in &directions {
            let [x, y] = [0, 1].map(|k| (((d[k] - corner[k]) * scale) as usize).min(size[k] - 1));
            measured[y * size[0] + x] = true;
        }
        let near = (0..margin).fold(measured, |cells, _| widened(&cells, size));
        let background = outside(&near, size);
        let around = (0..DEEP).fold(near, |cells, _| widened(&cells, size));
        let deep = outside(&around, size);
        Some(Self { camera_from_world, scale, corner, size, background, deep, image, veiled: scan.hides_any() })
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        self.background.len() + self.deep.len()
    }

    /// Whether a point (world frame) lies in front of or behind nothing but background of `scan`, whose outline this is.
    #[cfg(test)]
    pub(super) fn is_background(&self, scan: &PastScan, p: &Point3<f64>) -> bool {
        self.shows(scan, p, &self.background, 0)
    }

    /// The same, and too far from the outline for a pixel to have missed what is there.
    pub(super) fn is_deep_background(&self, scan: &PastScan, p: &Point3<f64>) -> bool {
        self.shows(scan, p, &self.deep, DEEP as i64)
    }

    fn shows(&self, scan: &PastScan, p: &Point3<f64>, cells: &[bool], around: i64) -> bool {
        let p = self.camera_from_world * p;
        if p.z <= 0.0 {
            return false;
        }
        let direction = [p.x, p.y].map(|x| x / p.z);
        let [x, y] = direction;
        if self.image.is_some_and(|[from, to]| !(x > from[0] && y > from[1] && x < to[0] && y < to[1])) {
            return false;
        }
        let [x, y] = [(x - self.corner[0]) * self.scale, (y - self.corner[1]) * self.scale];
        let inside = x >= 0.0 && y >= 0.0 && x < self.size[0] as f64 && y < self.size[1] as f64;
        let shown = !inside || cells[y as usize * self.size[0] + x as usize];
        shown && !(self.veiled && scan.hides(direction, p.z, around))
    }
}

/// Corners of the image in x / z, y / z.
fn corners(camera: &PinholeCamera) -> [[f64; 2]; 2] {
    let at = |u: f64, v: f64| [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy];
    [at(-0.5, -0.5), at(f64::from(camera.width) - 0.5, f64::from(camera.height) - 0.5)]
}

/// The cells and their eight neighbours.
fn widened(cells: &[bool], size: [usize; 2]) -> Vec<bool> {
    let mut out = vec![false; cells.len()];
    for y in 0..size[1] {
        for x in 0..size[0] {
            if cells[y * size[0] + x] {
                for v in y.saturating_sub(1)..=(y + 1).min(size[1] - 1) {
                    let row = v * size[0];
                    out[row + x.saturating_sub(1)..=row + (x + 1).min(size[0] - 1)].fill(true);
                }
            }
        }
    }
    out
}

/// The empty cells that are connected to the image's edge.
fn outside(cells: &[bool], size: [usize; 2]) -> Vec<bool> {
    let [w, h] = size;
    let mut out = vec![false; cells.len()];
    let rim = (0..w).flat_map(|x| [(x, 0), (x, h - 1)]).chain((0..h).flat_map(|y| [(0, y), (w - 1, y)]));
    let mut stack: Vec<(usize, usize)> = rim.collect();
    while let Some((x, y)) = stack.pop() {
        let i = y * w + x;
        if cells[i] || out[i] {
            continue;
        }
        out[i] = true;
        stack.extend(
            [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)]
                .into_iter()
                .filter(|&(x, y)| x < w && y < h),
        );
    }
    out
}

impl VoxelGrid {
    /// Unknown voxels that a scan, whose outline this is, shows in front of background are free.
    pub(super) fn carve_background(&mut self, silhouette: &Silhouette, scan: &PastScan) {
        let Projection { corner, axes } = self.projection(&silhouette.camera_from_world);
        let scale = silhouette.scale as f32;
        let [x0, y0] = silhouette.corner.map(|c| c as f32);
        let [width, height] = silhouette.size.map(|n| n as f32);
        let image = silhouette.image.map(|image| image.map(|at| at.map(|x| x as f32)));
        for &i in &self.unknown {
            let cell = self.coordinates(i).map(|x| x as f32);
            let at = |k: usize| corner[k] + cell[0] * axes[0][k] + cell[1] * axes[1][k] + cell[2] * axes[2][k];
            let z = at(2);
            if z <= 0.0 {
                continue;
            }
            let direction = [at(0) / z, at(1) / z];
            let [x, y] = direction;
            if image.is_some_and(|[from, to]| !(x > from[0] && y > from[1] && x < to[0] && y < to[1])) {
                continue;
            }
            let [x, y] = [(x - x0) * scale, (y - y0) * scale];
            let inside = x >= 0.0 && y >= 0.0 && x < width && y < height;
            let shown = !inside || silhouette.background[y as usize * silhouette.size[0] + x as usize];
            if shown && !(silhouette.veiled && scan.hides(direction.map(f64::from), f64::from(z), 0)) {
                Self::free(&mut self.code, &mut self.membrane, i as usize);
            }
        }
        self.forget_known();
    }
}
