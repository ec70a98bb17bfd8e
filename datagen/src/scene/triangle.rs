//! Triangles on the screen, drawn into an image of inverse depths.

use super::patches::{LANES, MAX_TRIANGLES};
use super::screen::{Corners, select_max};
use geometry::DepthImage;

/// Triangles of a patch with a pixel centre in their box, each value in a row of its own, so that the compiler can use
/// vector registers.
#[derive(Clone, Debug)]
pub(super) struct Staged {
    pub(super) u: [[f32; MAX_TRIANGLES]; 3],
    pub(super) v: [[f32; MAX_TRIANGLES]; 3],
    pub(super) inverse_depth: [[f32; MAX_TRIANGLES]; 3],
    /// First pixel of the box, relative to the whole part of the principal point.
    pub(super) x: [f32; MAX_TRIANGLES],
    pub(super) y: [f32; MAX_TRIANGLES],
    /// Inverse depth there; 0 where the triangle does not cover it.
    pub(super) drawn: [f32; MAX_TRIANGLES],
    /// First column and row of the box, and those after its last.
    pub(super) first: [[u32; 2]; MAX_TRIANGLES],
    pub(super) last: [[u32; 2]; MAX_TRIANGLES],
}

impl Default for Staged {
    fn default() -> Self {
        let (row, cells) = ([0.0; MAX_TRIANGLES], [[0; 2]; MAX_TRIANGLES]);
        let rows = [row; 3];
        Self { u: rows, v: rows, inverse_depth: rows, x: row, y: row, drawn: row, first: cells, last: cells }
    }
}

impl Staged {
    #[inline(always)]
    pub(super) fn put(&mut self, slot: usize, triangle: [u8; 3], corners: &Corners, low: [i32; 2]) {
        let slot = slot % MAX_TRIANGLES;
        for k in 0..3 {
            let i = triangle[k] as usize;
            self.u[k][slot] = corners.u[i];
            self.v[k][slot] = corners.v[i];
            self.inverse_depth[k][slot] = corners.inverse_depth[i];
        }
        let [a, b, c] = [triangle[0] as usize, triangle[1] as usize, triangle[2] as usize];
        let [a, b, c] = [corners.cell[a], corners.cell[b], corners.cell[c]];
        let (u, v) = ([a >> 16, b >> 16, c >> 16], [a & 0xffff, b & 0xffff, c & 0xffff]);
        let first = [u[0].min(u[1]).min(u[2]), v[0].min(v[1]).min(v[2])];
        let last = [u[0].max(u[1]).max(u[2]), v[0].max(v[1]).max(v[2])];
        (self.first[slot], self.last[slot]) = (first, last);
        // The pixel after the cell.
        (self.x[slot], self.y[slot]) = ((low[0] + first[0] as i32 + 1) as f32, (low[1] + first[1] as i32 + 1) as f32);
    }

    #[inline(always)]
    pub(super) fn triangle(&self, slot: usize) -> Triangle {
        let ([ua, ub, uc], [va, vb, vc]) = (&self.u, &self.v);
        let [wa, wb, wc] = &self.inverse_depth;
        let corner = |u: &[f32; MAX_TRIANGLES], v: &[f32; MAX_TRIANGLES], w: &[f32; MAX_TRIANGLES]| {
            [f64::from(u[slot]), f64::from(v[slot]), f64::from(w[slot])]
        };
        Triangle::new(corner(ua, va, wa), corner(ub, vb, wb), corner(uc, vc, wc))
    }

    /// Draws the first pixel of each box. Most boxes have but this one: no branch is worth predicting.
    #[inline(always)]
    pub(super) fn first_pixels(&mut self, count: usize, cull: bool) {
        for slot in 0..count.next_multiple_of(LANES).min(MAX_TRIANGLES) {
            let triangle = self.triangle(slot);
            let seen = (triangle.area < 0.0) | (!cull & (triangle.area > 0.0));
            let w = triangle.at(f64::from(self.x[slot]), f64::from(self.y[slot]));
            self.drawn[slot] = if seen { w } else { 0.0 };
        }
    }
}

/// The arithmetic of one triangle, in f64 on f32 values: products are exact, so that an edge has opposite values for
/// its two triangles and no crack opens between them.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    edges: [[f64; 3]; 3],
    area: f64,
    per_area: f64,
    inverse_depths: [f64; 3],
}

impl Triangle {
    #[inline(always)]
    fn new([ua, va, wa]: [f64; 3], [ub, vb, wb]: [f64; 3], [uc, vc, wc]: [f64; 3]) -> Self {
        // With v down, a triangle that is counter-clockwise in space has a negative area on the screen.
        let area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va);
        let sign = if area < 0.0 { -1.0 } else { 1.0 };
        let edge =
            |u0: f64, v0: f64, u1: f64, v1: f64| [sign * (v0 - v1), sign * (u1 - u0), sign * (u0 * v1 - u1 * v0)];
        let edges = [edge(ub, vb, uc, vc), edge(uc, vc, ua, va), edge(ua, va, ub, vb)];
        Self { edges, area, per_area: 1.0 / area.abs(), inverse_depths: [wa, wb, wc] }
    }

    /// Inverse depth at a place; 0 outside of the triangle. Without a branch: half of the places are outside.
    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> f32 {
        let [ea, eb, ec] = &self.edges;
        let fa = ea[0] * x + (ea[1] * y + ea[2]);
        let fb = eb[0] * x + (eb[1] * y + eb[2]);
        let fc = ec[0] * x + (ec[1] * y + ec[2]);
        let [wa, wb, wc] = self.inverse_depths;
        let w = (fa * wa + fb * wb + fc * wc) * self.per_area;
        // Clamped, because the weights of a sliver are inexact.
        let (low, high) = (least(least(wa, wb), wc), most(most(wa, wb), wc));
        let w = least(most(w, low), high);
        (if least(least(fa, fb), fc) >= 0.0 { w } else { 0.0 }) as f32
    }
}

/// Draws a triangle with several pixel centres in its box.
pub(super) fn large(
    triangle: &Triangle,
    [first, last]: [[u32; 2]; 2],
    low: [i32; 2],
    cull: bool,
    image: &mut DepthImage,
) {
    if triangle.area == 0.0 || (cull && triangle.area > 0.0) {
        return;
    }
    for row in first[1]..last[1] {
        // The pixel after cell `row`, relative to the principal point's whole part.
        let y = f64::from(low[1] + row as i32 + 1);
        for column in first[0]..last[0] {
            let x = f64::from(low[0] + column as i32 + 1);
            nearer(image, [column, row], triangle.at(x, y));
        }
    }
}

/// Draws a pixel: the image holds inverse depths, 0 where nothing is.
#[inline(always)]
pub(super) fn nearer(image: &mut DepthImage, [column, row]: [u32; 2], w: f32) {
    let pixel = &mut image.depth[((row - image.origin[1]) * image.size[0] + column - image.origin[0]) as usize];
    *pixel = select_max(*pixel, w);
}

#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline(always)]
fn most(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
