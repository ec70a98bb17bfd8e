//! Where patches and their vertices come on the screen.

use super::patches::{LANES, MAX_VERTICES, Patch, Patches};
use geometry::PinholeCamera;
use nalgebra::Isometry3;

/// Beyond this many pixels from the principal point f32 screen coordinates are too coarse.
pub(super) const MAX_OFFSET: f32 = 16_384.0;

/// Where local coordinates come on the screen.
#[derive(Clone, Debug, Default)]
pub(super) struct Screen {
    /// Rows: focal length times x, focal length times y, depth.
    pub(super) matrix: [[f32; 4]; 3],
    pub(super) focal: [f32; 2],
    pub(super) fraction: [f32; 2],
    pub(super) low: [i32; 2],
    pub(super) size: [f32; 2],
}

/// What holds a patch on the screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScreenBox {
    pub(super) first: [u32; 2],
    pub(super) last: [u32; 2],
    pub(super) nearest: f32,
    pub(super) farthest: f32,
}

/// Vertices of a patch on the screen; `cell` packs column and row.
#[derive(Clone, Debug)]
pub(super) struct Corners {
    pub(super) u: [f32; MAX_VERTICES],
    pub(super) v: [f32; MAX_VERTICES],
    pub(super) inverse_depth: [f32; MAX_VERTICES],
    pub(super) cell: [u32; MAX_VERTICES],
}

impl Default for Corners {
    fn default() -> Self {
        let zeros = [0.0; MAX_VERTICES];
        Self { u: zeros, v: zeros, inverse_depth: zeros, cell: [0; MAX_VERTICES] }
    }
}

impl Screen {
    pub(super) fn new(camera: &PinholeCamera, camera_from_local: &Isometry3<f64>) -> Self {
        let pose = camera_from_local.to_homogeneous();
        let focal = [camera.fx, camera.fy, 1.0];
        let principal = [camera.cx, camera.cy];
        Self {
            matrix: std::array::from_fn(|i| std::array::from_fn(|j| (pose[(i, j)] * focal[i]) as f32)),
            focal: [camera.fx as f32, camera.fy as f32],
            fraction: principal.map(|c| (c - c.floor()) as f32),
            low: principal.map(|c| -(c.floor() as i32) - 1),
            size: [camera.width, camera.height].map(|s| s.min(65_534) as f32),
        }
    }

    /// From a patch's sphere; `None` if that tells too little.
    pub(super) fn sphere_box(&self, patch: &Patch, near: f32) -> Option<ScreenBox> {
        let [x, y, z] = patch.center;
        let [u, v, depth] = self.matrix.map(|m| m[0] * x + m[1] * y + m[2] * z + m[3]);
        // 1e-5 of the distance for rounding.
        let radius = patch.radius + 1e-5 * depth.abs();
        let (nearest, farthest) = (depth - radius, depth + radius);
        if !(nearest >= near && nearest > radius) {
            return None;
        }
        let extent = [u, v].map(|c| c / depth);
        let reach = [0, 1].map(|k| {
            let slope = extent[k] / self.focal[k];
            self.focal[k].abs() * radius * (1.0 + slope * slope).sqrt() / nearest + 0.01
        });
        let low = [0, 1].map(|k| extent[k] + self.fraction[k] - reach[k]);
        let high = [0, 1].map(|k| extent[k] + self.fraction[k] + reach[k]);
        self.screen_box(low, high, nearest, farthest)
    }

    /// From a patch's vertices; `None` if it cannot be rasterised.
    pub(super) fn vertex_box(&self, mesh: &Patches, patch: &Patch, near: f32) -> Option<ScreenBox> {
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for i in patch.vertices.clone() {
            let [x, y, z] = mesh.xyz.each_ref().map(|axis| axis[i]);
            let [u, v, depth] = self.matrix.map(|m| m[0] * x + m[1] * y + m[2] * z + m[3]);
            let at = [u / depth + self.fraction[0], v / depth + self.fraction[1], depth];
            low = [0, 1, 2].map(|k| low[k].min(at[k]));
            high = [0, 1, 2].map(|k| high[k].max(at[k]));
        }
        let (nearest, farthest) = (low[2] * (1.0 - 1e-5), high[2] * (1.0 + 1e-5));
        let margin = 0.01;
        let found = self.screen_box(
            [low[0] - margin, low[1] - margin],
            [high[0] + margin, high[1] + margin],
            nearest,
            farthest,
        )?;
        (low[2] >= near && low[2] > 0.0).then_some(found)
    }

    fn screen_box(&self, low: [f32; 2], high: [f32; 2], nearest: f32, farthest: f32) -> Option<ScreenBox> {
        let cell = |x: f32, k: usize| {
            let first = self.low[k] as f32;
            (x.max(first).min(first + self.size[k]).floor() - first) as u32
        };
        low.iter().chain(&high).all(|x| x.abs() <= MAX_OFFSET).then(|| ScreenBox {
            first: [cell(low[0], 0), cell(low[1], 1)],
            last: [cell(high[0], 0), cell(high[1], 1)],
            nearest,
            farthest,
        })
    }
}

/// Projects the vertices of a patch.
#[inline(always)]
pub(super) fn place_corners(mesh: &Patches, patch: &Patch, screen: &Screen, out: &mut Corners) {
    let [m0, m1, m2] = screen.matrix;
    let low = [screen.low[0] as f32, screen.low[1] as f32];
    let [xs, ys, zs] = &mesh.xyz;
    let xs = xs[patch.vertices.clone()].as_chunks::<LANES>().0;
    let ys = ys[patch.vertices.clone()].as_chunks::<LANES>().0;
    let zs = zs[patch.vertices.clone()].as_chunks::<LANES>().0;
    let us = out.u.as_chunks_mut::<LANES>().0;
    let vs = out.v.as_chunks_mut::<LANES>().0;
    let ws = out.inverse_depth.as_chunks_mut::<LANES>().0;
    let cells = out.cell.as_chunks_mut::<LANES>().0;
    let vertices = xs.iter().zip(ys).zip(zs).zip(us.iter_mut().zip(vs).zip(ws.iter_mut().zip(cells)));
    for (((x, y), z), ((us, vs), (ws, cells))) in vertices {
        let depth: [f32; LANES] = std::array::from_fn(|l| m2[0] * x[l] + m2[1] * y[l] + m2[2] * z[l] + m2[3]);
        let w: [f32; LANES] = std::array::from_fn(|l| 1.0 / depth[l]);
        let u: [f32; LANES] =
            std::array::from_fn(|l| (m0[0] * x[l] + m0[1] * y[l] + m0[2] * z[l] + m0[3]) * w[l] + screen.fraction[0]);
        let v: [f32; LANES] =
            std::array::from_fn(|l| (m1[0] * x[l] + m1[1] * y[l] + m1[2] * z[l] + m1[3]) * w[l] + screen.fraction[1]);
        let cell = |x: f32, k: usize| {
            let (low, high) = (low[k], low[k] + screen.size[k]);
            whole(floor(select_min(select_max(x, low), high)) - low)
        };
        *cells = std::array::from_fn(|l| (cell(u[l], 0) << 16) | cell(v[l], 1));
        (*us, *vs, *ws) = (u, v, w);
    }
}

/// `f32::min` without its care for NaN, so that it becomes one instruction.
#[inline(always)]
fn select_min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `f32::max` without its care for NaN, so that it becomes one instruction.
#[inline(always)]
pub(super) fn select_max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Exact floor for |x| < 2^22, in instructions that every CPU has as vectors.
#[inline(always)]
fn floor(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0;
    let nearest = (x + ROUND) - ROUND;
    nearest - if nearest > x { 1.0 } else { 0.0 }
}

/// A whole f32 in 0..65,536 as integer.
#[inline(always)]
fn whole(x: f32) -> u32 {
    (x + 8_388_608.0).to_bits() & 0xffff
}
