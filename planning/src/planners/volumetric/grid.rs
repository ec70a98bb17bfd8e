//! Voxels that past scans found free or on the surface.
//!
//! Flat arrays with the voxels' coordinates x fastest, each axis padded by free voxels so that no neighbour needs a
//! bounds test.

use super::membrane::Membrane;
use crate::{NoReturn, PastScan, Plane, Seen};
use geometry::{DepthImage, PinholeCamera, PointCloud};
use nalgebra::{Isometry3, Point3, Vector3};

/// Voxels along an axis are this many at most: 2 million voxels, 20 MB.
const MAX_SIDE: usize = 124;
/// Edge of a block in voxels.
pub(super) const BLOCK: usize = 4;

/// Seen through.
pub(super) const FREE: u8 = 0;
/// Never seen, and expected to be empty.
pub(super) const HOLLOW: u8 = 1;
/// Never seen, and expected inside the object.
pub(super) const SOLID: u8 = 2;
/// Holds measured points.
pub(super) const SURFACE: u8 = 3;

/// A cube of voxels.
#[derive(Clone, Debug)]
pub(super) struct VoxelGrid {
    /// Edge of a voxel, metres.
    pub(super) voxel: f64,
    /// Voxels along each axis with the padding; a multiple of [`BLOCK`].
    pub(super) side: usize,
    /// Voxels along each axis without it.
    inner: usize,
    /// Corner of the padded cube.
    low: Point3<f64>,
    /// [`FREE`], [`HOLLOW`], [`SOLID`] or [`SURFACE`].
    pub(super) code: Vec<u8>,
    pub(super) membrane: Membrane,
    /// Place of a surface voxel in `surface`, of a solid one in `expected` where the membrane passes.
    pub(super) slot: Vec<u32>,
    /// Voxels never seen, rising.
    pub(super) unknown: Vec<u32>,
    /// Surface voxels, as they came.
    pub(super) surface: Vec<SurfaceVoxel>,
    /// Where the membrane passes.
    pub(super) expected: Vec<ExpectedVoxel>,
    /// Surface voxels that hold the back of what was measured in them too ([`super::backs`]).
    pub(super) backs: Vec<ExpectedVoxel>,
}

/// A voxel through which the membrane passes: solid, beside empty space. Also a voxel of the surface that holds its back.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExpectedVoxel {
    pub(super) index: u32,
    /// Of unit length, towards the empty side; zero where the membrane does not tell.
    pub(super) normal: [f32; 3],
    /// Share that a view is believed to measure ([`super::belief`]).
    pub(super) belief: f32,
}

impl ExpectedVoxel {
    pub(super) fn new(index: u32, outward: [f32; 3]) -> Self {
        let length = outward.iter().map(|x| x * x).sum::<f32>().sqrt();
        let normal = if length > 1e-4 { outward.map(|x| x / length) } else { [0.0; 3] };
        Self { index, normal, belief: 1.0 }
    }

    /// Area of the membrane in it, squares of a voxel: one voxel is passed in each column along the largest component of
    /// the normal.
    pub(super) fn area(&self) -> f64 {
        let most = self.normal.iter().fold(0f32, |m, x| m.max(x.abs()));
        if most > 0.0 { f64::from(most).recip() } else { 1.0 }
    }
}

/// What is known of a surface voxel.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceVoxel {
    pub(super) index: u32,
    /// Sum of the normals of the cloud's points in it; of those around it where it has none.
    pub(super) normal: [f32; 3],
    /// Share of the surface in it that the cloud covers within the tolerance.
    pub(super) covered: f32,
    /// Whether normals of the cloud's points in it oppose that: both sides of a thin part were measured.
    pub(super) both_sides: bool,
}

/// The middle of the first voxel in the frame of a camera, and the steps to the next along each axis, metres.
pub(super) struct Projection {
    pub(super) corner: [f32; 3],
    pub(super) axes: [[f32; 3]; 3],
}

impl VoxelGrid {
    pub(super) fn new(center: &Point3<f64>, half: f64, voxel: f64) -> Self {
        let voxel = voxel.max(2.0 * half / MAX_SIDE as f64);
        let inner = ((2.0 * half / voxel).ceil() as usize).clamp(2, MAX_SIDE);
        let side = (inner + 2).next_multiple_of(BLOCK);
        let n = side.pow(3);
        let low = center - Vector3::repeat((inner + 2) as f64 * voxel / 2.0);
        let mut grid = Self {
            voxel,
            side,
            inner,
            low,
            code: vec![FREE; n],
            membrane: Membrane::new(side),
            slot: vec![u32::MAX; n],
            unknown: Vec::with_capacity(inner.pow(3)),
            surface: Vec::new(),
            expected: Vec::new(),
            backs: Vec::new(),
        };
        for z in 1..=inner {
            for y in 1..=inner {
                let row = (z * side + y) * side;
                grid.code[row + 1..=row + inner].fill(HOLLOW);
                grid.unknown.extend((row + 1..=row + inner).map(|i| i as u32));
            }
        }
        grid
    }

    /// Bytes held.
    pub(super) fn memory(&self) -> usize {
        9 * self.code.len()
            + 4 * self.unknown.capacity()
            + size_of::<SurfaceVoxel>() * self.surface.capacity()
            + size_of::<ExpectedVoxel>() * (self.expected.capacity() + self.backs.capacity())
    }

    /// A point in voxel coordinates: voxel (x, y, z) reaches from there to one more.
    pub(super) fn local(&self, p: &Point3<f64>) -> [f32; 3] {
        [0, 1, 2].map(|k| ((p[k] - self.low[k]) / self.voxel) as f32)
    }

    /// The voxel that holds a point; `None` outside of the cube.
    pub(super) fn index(&self, p: &Point3<f64>) -> Option<usize> {
        self.index_at(&self.local(p))
    }

    fn index_at(&self, c: &[f32; 3]) -> Option<usize> {
        let end = (self.inner + 1) as f32;
        if !c.iter().all(|&x| x >= 1.0 && x < end) {
            return None;
        }
        Some((c[2] as usize * self.side + c[1] as usize) * self.side + c[0] as usize)
    }

    /// Place in `surface` of the voxel at these voxel coordinates; `None` for other voxels.
    pub(super) fn slot_at(&self, c: &[f32; 3]) -> Option<usize> {
        let i = self.index_at(c)?;
        (self.code[i] == SURFACE).then(|| self.slot[i] as usize)
    }

    /// Coordinates of a voxel.
    pub(super) fn coordinates(&self, index: u32) -> [usize; 3] {
        let (i, s) = (index as usize, self.side);
        [i % s, i / s % s, i / (s * s)]
    }

    /// The middle of a voxel, world frame, metres.
    pub(super) fn middle(&self, index: u32) -> Point3<f64> {
        let at = self.coordinates(index);
        self.low + Vector3::from_fn(|k, _| (at[k] as f64 + 0.5) * self.voxel)
    }

    /// Whether all these points lie in the cube, a few voxels from its faces.
    pub(super) fn holds(&self, points: &[Point3<f64>]) -> bool {
        let (first, last) = (3.0, (self.inner - 1) as f32);
        points.iter().all(|p| self.local(p).iter().all(|&x| (x >= first && x < last) || !x.is_finite()))
    }

    /// What a surface voxel holds; `None` in other voxels.
    pub(super) fn surface_at(&self, index: usize) -> Option<&SurfaceVoxel> {
        self.surface.get(self.slot[index] as usize)
    }

    /// Area of the membrane, or of backs, square metres.
    pub(super) fn area_of(&self, expected: &[ExpectedVoxel]) -> f64 {
        self.voxel * self.voxel * expected.iter().map(ExpectedVoxel::area).sum::<f64>()
    }

    /// Takes in what a scan saw: free space along its rays, surface at their ends. `misses` is what pixels without a return
    /// are taken to mean.
    pub(super) fn carve(&mut self, scan: &PastScan, misses: NoReturn) {
        match &scan.seen {
            Seen::Depth { camera, depth, .. } => {
                self.carve_depth(&scan.world_from_camera, camera, depth, misses);
                depth.for_each_point(camera, &scan.world_from_camera, |p| self.mark_surface(&p));
            }
            Seen::Points(points) => {
                self.carve_rays(&Point3::from(scan.world_from_camera.translation.vector), points);
                points.iter().for_each(|p| self.mark_surface(p));
            }
        }
        self.forget_known();
    }

    /// The object does not reach below what it stands on.
    pub(super) fn carve_below(&mut self, plane: &Plane) {
        for k in 0..self.unknown.len() {
            let i = self.unknown[k];
            if plane.height(&self.middle(i)) < 0.0 {
                Self::free(&mut self.code, &mut self.membrane, i as usize);
            }
        }
        self.forget_known();
    }

    /// Drops from the unknown voxels those that are known by now.
    pub(super) fn forget_known(&mut self) {
        let code = &self.code;
        self.unknown.retain(|&i| matches!(code[i as usize], HOLLOW | SOLID));
    }

    fn mark_surface(&mut self, p: &Point3<f64>) {
        let Some(i) = self.index(p) else { return };
        if self.code[i] != SURFACE {
            self.code[i] = SURFACE;
            self.membrane.set(i, 0.5);
            self.slot[i] = self.surface.len() as u32;
            self.surface.push(SurfaceVoxel { index: i as u32, normal: [0.0; 3], covered: 1.0, both_sides: false });
        }
    }

    pub(super) fn free(code: &mut [u8], membrane: &mut Membrane, i: usize) {
        if matches!(code[i], HOLLOW | SOLID) {
            code[i] = FREE;
            membrane.set(i, 0.0);
        }
    }

    /// Where a camera has the middles of the voxels.
    pub(super) fn projection(&self, camera_from_world: &Isometry3<f64>) -> Projection {
        let rotation = camera_from_world.rotation.to_rotation_matrix();
        let corner = camera_from_world * (self.low + Vector3::repeat(0.5 * self.voxel));
        let axis = |a: usize| [0, 1, 2].map(|k| (rotation[(k, a)] * self.voxel) as f32);
        Projection { corner: [0, 1, 2].map(|k| corner[k] as f32), axes: [axis(0), axis(1), axis(2)] }
    }

    /// Unknown voxels whose middle is nearer than the depth of its pixel are free; on a miss all, if misses mean that.
    fn carve_depth(&mut self, pose: &Isometry3<f64>, camera: &PinholeCamera, depth: &DepthImage, misses: NoReturn) {
        let Projection { corner, axes } = self.projection(&pose.inverse());
        let margin = (0.75 * self.voxel) as f32;
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5].map(|x| x as f32);
        let (width, height) = (camera.width as f32, camera.height as f32);
        let [x0, y0] = depth.origin.map(|x| x as usize);
        let [columns, rows] = depth.size.map(|x| x as usize);
        let on_miss = misses == NoReturn::Free;
        for &i in &self.unknown {
            let cell = self.coordinates(i).map(|x| x as f32);
            let at = |k: usize| corner[k] + cell[0] * axes[0][k] + cell[1] * axes[1][k] + cell[2] * axes[2][k];
            let z = at(2);
            if z <= 0.0 {
                continue;
            }
            let inverse = 1.0 / z;
            let (u, v) = (fx * at(0) * inverse + cx, fy * at(1) * inverse + cy);
            if !(u >= 0.0 && v >= 0.0 && u < width && v < height) {
                continue;
            }
            let (column, row) = ((u as usize).wrapping_sub(x0), (v as usize).wrapping_sub(y0));
            let measured = if column < columns && row < rows { depth.depth[row * columns + column] } else { 0.0 };
            // Not a number: a miss is no free space where something was measured and not believed.
            if if measured > 0.0 { z < measured - margin } else { on_miss && !measured.is_nan() } {
                Self::free(&mut self.code, &mut self.membrane, i as usize);
            }
        }
    }

    /// Voxels on the rays from the camera to the points are free.
    fn carve_rays(&mut self, eye: &Point3<f64>, points: &[Point3<f64>]) {
        let margin = 0.75 * self.voxel;
        for p in points {
            let ray = p - eye;
            let length = ray.norm();
            if !(length > margin && length.is_finite()) {
                continue;
            }
            // Back from the point, as far as the ray is in the cube.
            let (mut first, mut end) = (margin, length);
            for k in 0..3 {
                let faces = [0.0, self.side as f64 * self.voxel].map(|x| (p[k] - self.low[k] - x) / ray[k] * length);
                first = first.max(faces[0].min(faces[1]));
                end = end.min(faces[0].max(faces[1]));
            }
            // In voxels, a half at a time.
            let (start, step) = ((p - self.low) / self.voxel, ray * (-0.5 / length));
            let [first, end] = [first, end].map(|back| (2.0 * (back - margin) / self.voxel).ceil().max(0.0) as usize);
            for k in first..end {
                let at = start + step * (1.5 + k as f64);
                if let Some(i) = self.index_at(&at.map(|x| x as f32).into()) {
                    Self::free(&mut self.code, &mut self.membrane, i);
                }
            }
        }
    }

    /// Takes the accumulated cloud: its voxels are surface, with its normals, and right behind it is the inside.
    pub(super) fn set_cloud(&mut self, cloud: &PointCloud) {
        for s in &mut self.surface {
            s.normal = [0.0; 3];
            s.both_sides = false;
        }
        for &i in &self.unknown {
            self.code[i as usize] = HOLLOW;
        }
        let normals = || cloud.normals.iter().map(|n| n.try_normalize(0.0));
        for (p, n) in cloud.points.iter().zip(normals()) {
            let (Some(n), Some(i)) = (n, self.index(p)) else { continue };
            self.mark_surface(p);
            let sum = &mut self.surface[self.slot[i] as usize].normal;
            sum.iter_mut().zip(n.iter()).for_each(|(sum, &n)| *sum += n as f32);
        }
        for (p, n) in cloud.points.iter().zip(normals()) {
            let Some(n) = n else { continue };
            if let Some(own) = self.index(p).map(|i| self.slot[i] as usize) {
                let sum = Vector3::from(self.surface[own].normal).cast::<f64>();
                self.surface[own].both_sides |= n.dot(&sum) < 0.0;
            }
            if let Some(i) = self.index(&(p - n * (1.5 * self.voxel)))
                && self.code[i] == HOLLOW
            {
                self.code[i] = SOLID;
                self.slot[i] = u32::MAX;
                self.membrane.set(i, 1.0);
            }
        }
        self.borrow_normals();
    }

    /// Voxels that a scan touched but whose points were averaged into others take the normals around them.
    fn borrow_normals(&mut self) {
        let bare = |s: &SurfaceVoxel| s.normal == [0.0; 3];
        let s = self.side;
        let borrowed: Vec<(usize, [f32; 3])> = (0..self.surface.len())
            .filter(|&k| bare(&self.surface[k]))
            .map(|k| {
                let low = self.surface[k].index as usize - (s * s + s + 1);
                let mut sum = [0.0; 3];
                for j in 0..27 {
                    let around = low + j % 3 + (j / 3 % 3) * s + (j / 9) * s * s;
                    if let Some(other) = self.surface_at(around) {
                        sum.iter_mut().zip(other.normal).for_each(|(sum, n)| *sum += n);
                    }
                }
                (k, sum)
            })
            .collect();
        for (k, normal) in borrowed {
            self.surface[k].normal = normal;
        }
    }
}
