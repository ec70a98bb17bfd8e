//! Depth images by z-buffer rasterising. Own code: at the sizes that scanning needs it is several times faster than
//! any hierarchy of boxes (parry, obvhs and bvh measured), because most triangles of a scanned mesh are smaller
//! than a pixel and miss all pixel centres. Patches of triangles are drawn from the nearest to the farthest, and
//! those that lie behind what is drawn already are left out: it changes no image.

use super::patches::{MAX_TRIANGLES, Patches};
use super::screen::{Corners, MAX_OFFSET, Screen, ScreenBox, place_corners};
use super::triangle::{Staged, large, nearer};
use geometry::{DepthImage, Mesh, PinholeCamera};
use nalgebra::Isometry3;

/// Patches are sorted by depth into this many bins.
const BINS: usize = 64;

/// A mesh that can be rasterised.
#[derive(Debug)]
pub(super) struct RasterMesh {
    mesh: Patches,
}

/// Where the patches come on the screen, and buffers. Screen coordinates are in pixels relative to the whole part
/// of the principal point; a *cell* is the pixel left of and above a place, clamped to the image, and counted from
/// the column and row before the image.
#[derive(Clone, Debug, Default)]
pub(super) struct Projection {
    screen: Screen,
    boxes: Vec<ScreenBox>,
    /// Patches from the nearest to the farthest.
    order: Vec<u32>,
    /// First column and row, last column and row of cells.
    cells: [[u32; 2]; 2],
    farthest: f32,
    corners: Box<Corners>,
    staged: Box<Staged>,
}

impl RasterMesh {
    pub(super) fn new(mesh: &Mesh) -> Self {
        Self { mesh: Patches::new(mesh) }
    }

    /// Finds the patches' places. False if some vertex is nearer than `near`, or so far outside the image that
    /// rasterising would be inexact: then the projection is of no use.
    pub(super) fn project(
        &self,
        camera: &PinholeCamera,
        world_from_camera: &Isometry3<f64>,
        near: f32,
        out: &mut Projection,
    ) -> bool {
        let screen = Screen::new(camera, &(world_from_camera.inverse() * translation(&self.mesh)));
        out.boxes.clear();
        let (mut first, mut last) = ([u32::MAX; 2], [0; 2]);
        let (mut nearest, mut farthest) = (f32::MAX, 0f32);
        for patch in &self.mesh.patches {
            let found = screen.sphere_box(patch, near).or_else(|| screen.vertex_box(&self.mesh, patch, near));
            let Some(found) = found else { return false };
            first = [0, 1].map(|k| first[k].min(found.first[k]));
            last = [0, 1].map(|k| last[k].max(found.last[k]));
            (nearest, farthest) = (nearest.min(found.nearest), farthest.max(found.farthest));
            out.boxes.push(found);
        }
        out.cells = [first.map(|x| if x == u32::MAX { 0 } else { x }), last];
        out.farthest = farthest;
        sort_by_depth(&out.boxes, nearest, farthest, &mut out.order);
        let in_range = screen.low.iter().all(|&l| l.abs() <= MAX_OFFSET as i32);
        out.screen = screen;
        in_range && camera.width.max(camera.height) < 65_534
    }

    /// Draws the projected mesh into the window that it fills; with `cull`, only triangles seen from the front.
    pub(super) fn draw(&self, projection: &mut Projection, cull: bool, image: &mut DepthImage) {
        let [column0, row0, columns, rows] = projection.window();
        image.origin = [column0, row0];
        image.size = [columns, rows];
        image.depth.clear();
        image.depth.resize((columns * rows) as usize, 0.0);
        if !image.depth.is_empty() {
            draw_best(&self.mesh, projection, cull, image);
        }
    }
}

impl Projection {
    /// The part of the image that the patches fill: first column, first row, columns, rows.
    pub(super) fn window(&self) -> [u32; 4] {
        // The pixels after the smallest cell up to the largest one; cell 0 is the column before the image.
        let [[u0, v0], [u1, v1]] = self.cells;
        [u0, v0, u1 - u0, v1 - v0]
    }

    /// A depth beyond which nothing lies.
    pub(super) fn farthest(&self) -> f32 {
        self.farthest
    }
}

fn translation(mesh: &Patches) -> nalgebra::Translation3<f64> {
    nalgebra::Translation3::from(mesh.origin.coords)
}

/// Sorts patches by the bin of their nearest depth; within a bin they keep their order.
fn sort_by_depth(boxes: &[ScreenBox], nearest: f32, farthest: f32, order: &mut Vec<u32>) {
    let per_depth = BINS as f32 / (farthest - nearest).max(f32::MIN_POSITIVE);
    let bin = |b: &ScreenBox| (((b.nearest - nearest) * per_depth) as usize).min(BINS - 1);
    let mut next = [0u32; BINS + 1];
    boxes.iter().for_each(|b| next[bin(b) + 1] += 1);
    for i in 1..=BINS {
        next[i] += next[i - 1];
    }
    order.clear();
    order.resize(boxes.len(), 0);
    for (i, b) in boxes.iter().enumerate() {
        let slot = &mut next[bin(b)];
        order[*slot as usize] = i as u32;
        *slot += 1;
    }
}

/// [`draw_all`] with the widest vector registers there are; the same bits with any.
fn draw_best(mesh: &Patches, projection: &mut Projection, cull: bool, image: &mut DepthImage) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2")]
        fn draw_avx2(mesh: &Patches, projection: &mut Projection, cull: bool, image: &mut DepthImage) {
            draw_all(mesh, projection, cull, image)
        }
        if std::is_x86_feature_detected!("avx2") {
            // SAFETY: the CPU has AVX2.
            return unsafe { draw_avx2(mesh, projection, cull, image) };
        }
    }
    draw_all(mesh, projection, cull, image)
}

#[inline(always)]
fn draw_all(mesh: &Patches, projection: &mut Projection, cull: bool, image: &mut DepthImage) {
    let Projection { screen, boxes, order, corners, staged, .. } = projection;
    for &i in order.iter() {
        if hidden(&boxes[i as usize], image) {
            continue;
        }
        let patch = &mesh.patches[i as usize];
        place_corners(mesh, patch, screen, corners);
        let triangles = &mesh.corners[patch.triangles.clone()];
        // First which of them and then those: the test stays free of mispredicted branches.
        let (mut chosen, mut count) = ([0u8; MAX_TRIANGLES], 0);
        for (i, t) in triangles.iter().enumerate() {
            let (a, b, c) = (corners.cell[t[0] as usize], corners.cell[t[1] as usize], corners.cell[t[2] as usize]);
            // A box without pixel centre in it: all corners share a column or a row of cells.
            let differ = (a ^ b) | (a ^ c);
            chosen[count % MAX_TRIANGLES] = i as u8;
            count += usize::from((differ > 0xffff) & (differ & 0xffff != 0));
        }
        for (slot, &i) in chosen[..count].iter().enumerate() {
            staged.put(slot, triangles[i as usize], corners, screen.low);
        }
        staged.first_pixels(count, cull);
        for slot in 0..count {
            let (first, last) = (staged.first[slot], staged.last[slot]);
            nearer(image, first, staged.drawn[slot]);
            if (last[0] - first[0]) * (last[1] - first[1]) > 1 {
                large(&staged.triangle(slot), [first, last], screen.low, cull, image);
            }
        }
    }
    for w in &mut image.depth {
        *w = if *w > 0.0 { 1.0 / *w } else { 0.0 };
    }
}

/// Whether something nearer has been drawn on all pixels of the box.
#[inline(always)]
fn hidden(b: &ScreenBox, image: &DepthImage) -> bool {
    let largest = 1.0 / b.nearest;
    let columns = (b.first[0] - image.origin[0]) as usize..(b.last[0] - image.origin[0]) as usize;
    (b.first[1] - image.origin[1]..b.last[1] - image.origin[1]).all(|row| {
        let start = (row * image.size[0]) as usize;
        image.depth[start + columns.start..start + columns.end].iter().all(|&w| w > largest)
    })
}
