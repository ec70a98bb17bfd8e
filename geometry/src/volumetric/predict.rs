//! What a view would see, by marching through the voxels.

use super::grid::{BLOCK, FREE, HOLLOW, SOLID, VoxelGrid};
use crate::neighbors::Neighborhoods;
use crate::{PinholeCamera, PointCloud, View};
use nalgebra::{Point3, Vector3};

/// Steps of the rays in voxels.
const STEP: f32 = 0.75;

impl VoxelGrid {
    /// Estimates which share of the surface in each surface voxel the cloud covers within the tolerance: from eight
    /// samples in the tangent plane around each point of the cloud. `near` are the neighbours of its points.
    pub(super) fn estimate_covered(&mut self, cloud: &PointCloud, near: &Neighborhoods, tolerance: f64) {
        let radius = 1.1 * tolerance;
        let circle = [0, 1, 2, 3, 4, 5, 6, 7].map(|k| (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos());
        let mut counts = vec![[0u32; 2]; self.surface.len()];
        let (reach2, tolerance2) = (((radius + tolerance).powi(2)) as f32, (tolerance * tolerance) as f32);
        let mut around: Vec<[f32; 3]> = Vec::new();
        for (i, (p, n)) in cloud.points.iter().zip(&cloud.normals).enumerate() {
            let Some(n) = n.try_normalize(0.0) else { continue };
            around.clear();
            for (&j, _) in near.ids(i).iter().zip(near.distances2(i)).take_while(|&(_, &d2)| d2 < reach2) {
                let d = cloud.points[j as usize] - p;
                around.push([d.x as f32, d.y as f32, d.z as f32]);
            }
            let any = if n.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
            let a = n.cross(&any).normalize();
            let b = n.cross(&a);
            for (sin, cos) in circle {
                let offset = (a * cos + b * sin) * radius;
                let Some(slot) = self.index(&(p + offset)).and_then(|i| self.slot_of(i)) else { continue };
                let [x, y, z] = [offset.x as f32, offset.y as f32, offset.z as f32];
                let covers = |q: &[f32; 3]| (q[0] - x).powi(2) + (q[1] - y).powi(2) + (q[2] - z).powi(2) < tolerance2;
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

/// Blocks of voxels and how far each is from the next one that is not wholly free, so that rays leap over free space.
pub(super) struct Leaps<'a> {
    grid: &'a VoxelGrid,
    blocks: usize,
    /// Steps that a ray in the block may take at once; 0: the block is not free.
    steps: Vec<u16>,
    /// Smallest and largest corner of what is not free, voxel coordinates.
    low: [f32; 3],
    high: [f32; 3],
}

impl<'a> Leaps<'a> {
    pub(super) fn new(grid: &'a VoxelGrid) -> Self {
        let blocks = grid.side / BLOCK;
        let far = u8::MAX;
        let mut distance = vec![far; blocks.pow(3)];
        let (mut low, mut high) = ([f32::MAX; 3], [0f32; 3]);
        for i in grid.unknown.iter().copied().chain(grid.surface.iter().map(|s| s.index)) {
            let cell = grid.coordinates(i);
            for k in 0..3 {
                low[k] = low[k].min(cell[k] as f32);
                high[k] = high[k].max((cell[k] + 1) as f32);
            }
            let [x, y, z] = cell.map(|c| c / BLOCK);
            distance[(z * blocks + y) * blocks + x] = 0;
        }
        spread(&mut distance, blocks);
        let steps_of = |d: u8| match d {
            0 => 0,
            d => (((usize::from(d) - 1) * BLOCK) as f32 / STEP).floor().max(1.0) as u16,
        };
        Self { grid, blocks, steps: distance.into_iter().map(steps_of).collect(), low, high }
    }

    /// Follows every `stride`-th pixel of every `stride`-th row of a view.
    pub(super) fn forecast(&self, camera: &PinholeCamera, view: &View, stride: u32) -> Forecast {
        let mut counts = [0u32; 4];
        let mut covered = 0f64;
        if !view.is_valid() || self.low[0] >= self.high[0] {
            return Forecast::default();
        }
        let pose = view.world_from_camera();
        let rotation = pose.rotation.to_rotation_matrix();
        let eye = self.grid.local(&view.position);
        let [columns, rows] = self.window(camera, &eye, &rotation);
        for row in rows.step_by(stride as usize) {
            for column in columns.clone().step_by(stride as usize) {
                let ray = rotation * camera.unproject(f64::from(column), f64::from(row), 1.0).coords.normalize();
                match self.follow(&eye, &[ray.x as f32, ray.y as f32, ray.z as f32]) {
                    Hit::Nothing { hidden } => counts[0] += u32::from(hidden),
                    Hit::Expected => {
                        counts[0] += 1;
                        counts[1] += 1;
                    }
                    Hit::Known { hidden, covered: share } => {
                        counts[0] += u32::from(hidden);
                        counts[if hidden { 3 } else { 2 }] += 1;
                        covered += f64::from(share);
                    }
                }
            }
        }
        let pixels = f64::from(stride * stride);
        let [hidden, expected, known, known_behind] = counts.map(|c| f64::from(c) * pixels);
        Forecast { hidden, expected, known, known_behind, covered: covered * pixels }
    }

    /// Columns and rows of the image that may show something that is not free.
    fn window(
        &self,
        camera: &PinholeCamera,
        eye: &[f32; 3],
        rotation: &nalgebra::Rotation3<f64>,
    ) -> [std::ops::Range<u32>; 2] {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for corner in 0..8 {
            let d = Vector3::from_fn(|k, _| {
                f64::from(if corner >> k & 1 == 0 { self.low[k] } else { self.high[k] } - eye[k])
            });
            let p = rotation.inverse() * d;
            // A corner beside or behind the camera: it may stand among the voxels.
            if p.z < 1.0 {
                return [0..camera.width, 0..camera.height];
            }
            let pixel = camera.project(&Point3::from(p));
            (low, high) = ([0, 1].map(|k| low[k].min(pixel[k])), [0, 1].map(|k| high[k].max(pixel[k])));
        }
        let range =
            |k: usize, size: u32| low[k].ceil().max(0.0) as u32..((high[k].floor() + 1.0).max(0.0) as u32).min(size);
        [range(0, camera.width), range(1, camera.height)]
    }

    /// Follows a ray through what is not free.
    fn follow(&self, eye: &[f32; 3], ray: &[f32; 3]) -> Hit {
        let (mut enter, mut leave) = (0f32, f32::MAX);
        for k in 0..3 {
            let inverse = 1.0 / ray[k];
            let (a, b) = ((self.low[k] - eye[k]) * inverse, (self.high[k] - eye[k]) * inverse);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        let grid = self.grid;
        let (side, blocks) = (grid.side, self.blocks);
        let mut hidden = false;
        let start = enter + 0.5 * STEP;
        let mut n = 0u32;
        loop {
            let t = start + n as f32 * STEP;
            if t >= leave || t.is_nan() {
                return Hit::Nothing { hidden };
            }
            let [x, y, z] = [0, 1, 2].map(|k| ((eye[k] + ray[k] * t).max(0.0) as usize).min(side - 1));
            let leap = self.steps[(z / BLOCK * blocks + y / BLOCK) * blocks + x / BLOCK];
            if leap > 0 {
                n += u32::from(leap);
                continue;
            }
            n += 1;
            let i = (z * side + y) * side + x;
            match grid.code[i] {
                FREE => {}
                HOLLOW => hidden = true,
                SOLID => return Hit::Expected,
                _ => {
                    let Some(s) = grid.surface_at(i) else { return Hit::Nothing { hidden } };
                    let facing = s.normal[0] * ray[0] + s.normal[1] * ray[1] + s.normal[2] * ray[2] < 0.0;
                    return if facing { Hit::Known { hidden, covered: s.covered } } else { Hit::Nothing { hidden } };
                }
            }
        }
    }
}

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hit {
    /// Free or empty space, or surface from behind.
    Nothing { hidden: bool },
    /// The membrane, in unknown space.
    Expected,
    /// Surface from its front, and the covered share there.
    Known { hidden: bool, covered: f32 },
}

/// Distance of each block from the next at 0, the largest of the three axes counting: two passes.
fn spread(distance: &mut [u8], side: usize) {
    let visit = |distance: &mut [u8], i: usize, forward: bool| {
        let (x, y, z) = ((i % side) as isize, (i / side % side) as isize, (i / (side * side)) as isize);
        let mut least = distance[i];
        for k in 0..13 {
            let k = if forward { k } else { 26 - k };
            let at = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
            if at.iter().all(|&a| a >= 0 && a < side as isize) {
                let j = ((at[2] * side as isize + at[1]) * side as isize + at[0]) as usize;
                least = least.min(distance[j].saturating_add(1));
            }
        }
        distance[i] = least;
    };
    (0..distance.len()).for_each(|i| visit(distance, i, true));
    (0..distance.len()).rev().for_each(|i| visit(distance, i, false));
}
