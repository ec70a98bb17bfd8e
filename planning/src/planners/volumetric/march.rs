//! Rays through the voxels, in steps that leap over what cannot stop them.

use super::grid::{BLOCK, FREE, HOLLOW, SOLID, SurfaceVoxel, VoxelGrid};
use crate::SensorConfig;

/// Steps of the rays in voxels.
const STEP: f32 = 0.75;
/// Positions along a ray are whole numbers of this part of a voxel.
const ONE_BITS: u32 = 20;
const ONE: f32 = (1 << ONE_BITS) as f32;
/// Blocks farther than this from what may stop a ray count as this far.
const FARTHEST: usize = 12;
/// The same for voxels.
const NEAREST: usize = 4;

/// What a ray meets, and how many voxels from the eye.
#[derive(Clone, Copy, Debug)]
pub(super) enum Hit<'a> {
    /// Free or empty space, or surface from behind; where it entered unknown space, if it did.
    Nothing { entered: Option<f32> },
    /// The membrane, in unknown space, in this voxel.
    Expected { index: usize, at: f32 },
    /// Surface from its front, with the cosine of the angle at which it is met.
    Known { hidden: bool, voxel: &'a SurfaceVoxel, cosine: f32, at: f32 },
}

/// How far rays may leap through a grid.
#[derive(Clone, Debug)]
pub(super) struct Leaps {
    /// Whether the space in front of all is free; else every ray is taken to start in unknown space.
    carves: bool,
    /// Steps that a ray in the voxel may take at once; 0: it must look. For rays in free space (unless all start in
    /// unknown space), then for those that have met unknown space, which only the membrane and the surface stop.
    steps: Vec<u8>,
    /// Where the latter begin.
    entered: usize,
    /// Blocks with something that may stop a ray or be unknown to it, by their first voxel.
    occupied: Vec<[usize; 3]>,
}

impl Leaps {
    /// `carves` is whether misses carve. Where they do not, nearly all space stays unknown, and where rays enter it
    /// means nothing: they start in it, and only what stops them counts.
    pub(super) fn new(grid: &VoxelGrid, carves: bool) -> Self {
        let blocks = grid.side / BLOCK;
        let mut stops = vec![0u8; grid.code.len()];
        let mut occupied = vec![false; blocks.pow(3)];
        let unknown = |&i: &u32| grid.code[i as usize] == HOLLOW;
        let all = || grid.unknown.iter().copied().chain(grid.surface.iter().map(|s| s.index));
        let stop = |i: &u32| grid.code[*i as usize] != FREE && (carves || !unknown(i));
        for i in all().filter(stop) {
            let at = grid.coordinates(i);
            occupied[(at[2] / BLOCK * blocks + at[1] / BLOCK) * blocks + at[0] / BLOCK] = true;
            stops[i as usize] = 1;
        }
        let corner = |b: usize| [b % blocks, b / blocks % blocks, b / (blocks * blocks)].map(|c| c * BLOCK);
        let occupied = (0..occupied.len()).filter(|&b| occupied[b]).map(corner).collect();
        let mut steps = if carves { leaps(stops.clone(), grid.side) } else { Vec::new() };
        let entered = steps.len();
        all().filter(unknown).for_each(|i| stops[i as usize] = 0);
        steps.append(&mut leaps(stops, grid.side));
        Self { carves, steps, entered, occupied }
    }

    /// Memory held, bytes.
    pub(super) fn memory(&self) -> usize {
        self.steps.len() + size_of_val(&self.occupied[..])
    }
}

/// A grid, and how rays move through it.
pub(super) struct Marcher<'a> {
    grid: &'a VoxelGrid,
    leaps: &'a Leaps,
    sensor: Limits,
}

/// What the sensor measures: from how near to how far, voxels, and the least cosine to the normal.
#[derive(Clone, Copy, Debug)]
struct Limits {
    range: [f32; 2],
    cosine: f32,
}

impl<'a> Marcher<'a> {
    /// Rays of a sensor.
    pub(super) fn new(grid: &'a VoxelGrid, leaps: &'a Leaps, sensor: &SensorConfig) -> Self {
        let range = sensor.range().map(|metres| (metres / grid.voxel) as f32);
        Self { grid, leaps, sensor: Limits { range, cosine: sensor.least_cosine() as f32 } }
    }

    /// Whether the sensor measures what a ray meets at this distance (voxels), at an angle of this cosine.
    pub(super) fn measures(&self, at: f32, cosine: f32) -> bool {
        let [near, far] = self.sensor.range;
        at >= near && at <= far && cosine >= self.sensor.cosine
    }

    pub(super) fn grid(&self) -> &VoxelGrid {
        self.grid
    }

    pub(super) fn occupied(&self) -> &[[usize; 3]] {
        &self.leaps.occupied
    }

    /// Follows rays of unit direction from `near` to `far` (voxels from the eye): side by side, so that one waits for memory
    /// while others move.
    #[inline(always)]
    pub(super) fn follow<const N: usize>(
        &self,
        eye: &[f32; 3],
        rays: &[[f32; 3]; N],
        near: f32,
        far: f32,
    ) -> [Hit<'a>; N] {
        let (grid, leaps) = (self.grid, self.leaps);
        let first = (near / STEP) as i32;
        let entered = (!leaps.carves).then_some(first as f32 * STEP);
        let mut hits = [Hit::Nothing { entered }; N];
        let mut moving = rays.map(|ray| Moving::new(grid.side, eye, &ray, first, far));
        loop {
            // Those that stand before something stay there; those past their ends move on to no effect.
            let mut any = true;
            while any {
                any = false;
                for ray in &mut moving {
                    let leap = i32::from(leaps.steps[ray.table + ray.index(grid.side)]);
                    ray.left -= leap;
                    ray.at = [0, 1, 2].map(|k| ray.at[k].wrapping_add(ray.step[k] * leap));
                    any |= (leap > 0) & (ray.left >= 0);
                }
            }
            for ((moving, hit), ray) in moving.iter_mut().zip(&mut hits).zip(rays).filter(|((m, _), _)| m.left >= 0) {
                let index = moving.index(grid.side);
                let at = (moving.last - moving.left) as f32 * STEP;
                if let (HOLLOW, Hit::Nothing { entered }) = (grid.code[index], &mut *hit) {
                    *entered = entered.or(Some(at));
                    moving.table = leaps.entered;
                    any = true;
                    continue;
                }
                moving.left = -1;
                if grid.code[index] == SOLID {
                    *hit = Hit::Expected { index, at };
                } else if let Some(voxel) = grid.surface_at(index) {
                    let n = &voxel.normal;
                    let facing = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2];
                    if facing < 0.0 {
                        let cosine = -facing / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                        let hidden = matches!(hit, Hit::Nothing { entered: Some(_) });
                        *hit = Hit::Known { hidden, voxel, cosine, at };
                    }
                }
            }
            if !any {
                return hits;
            }
        }
    }
}

/// A ray on its way.
#[derive(Clone, Copy)]
struct Moving {
    /// Position and steps in fixed point.
    at: [i32; 3],
    step: [i32; 3],
    /// Steps to its end, which is this many from the eye.
    left: i32,
    last: i32,
    /// Where the leaps begin that it goes by.
    table: usize,
}

impl Moving {
    /// All rays of a view step at the same distances, from the `first` step on, but for what is outside of the grid.
    #[inline(always)]
    fn new(side: usize, eye: &[f32; 3], ray: &[f32; 3], first: i32, far: f32) -> Self {
        // More than the rounding of steps adds up to, voxels.
        const MARGIN: f32 = 0.01;
        let side = side as f32 + MARGIN;
        let (mut from, mut to) = (0f32, f32::INFINITY);
        for k in 0..3 {
            let per_voxel = if ray[k].abs() < 1e-9 { 1e9 } else { ray[k].recip() };
            let (low, high) = ((-MARGIN - eye[k]) * per_voxel, (side - eye[k]) * per_voxel);
            from = from.max(low.min(high));
            to = to.min(low.max(high));
        }
        let last = ((far / STEP) as i32).min(((to / STEP) as i32).saturating_add(1));
        let skipped = ((from / STEP) as i32).saturating_sub(first).max(0);
        let step = ray.map(|r| (r * (STEP * ONE)) as i32);
        let start = [0, 1, 2].map(|k| ((eye[k] + ray[k] * (first as f32 * STEP)) * ONE) as i32);
        let at = [0, 1, 2].map(|k| start[k].wrapping_add(step[k].wrapping_mul(skipped)));
        Self { at, step, left: last.saturating_sub(first).saturating_sub(skipped).max(-1), last, table: 0 }
    }

    /// Its voxel; the first one stands for what is outside.
    #[inline(always)]
    fn index(&self, side: usize) -> usize {
        let [x, y, z] = self.at.map(|a| (a >> ONE_BITS) as u32 as usize);
        if x.max(y).max(z) < side { (z * side + y) * side + x } else { 0 }
    }
}

/// Steps that lead no farther than to the next voxel that stops, from the distances of voxels and of blocks.
fn leaps(stops: Vec<u8>, side: usize) -> Vec<u8> {
    let blocks = side / BLOCK;
    let mut block_stops = vec![0; blocks.pow(3)];
    for (row, stops) in stops.chunks_exact(side).enumerate() {
        let (y, z) = (row % side / BLOCK, row / side / BLOCK);
        let blocks = &mut block_stops[(z * blocks + y) * blocks..][..blocks];
        for (block, stops) in blocks.iter_mut().zip(stops.chunks_exact(BLOCK)) {
            *block |= stops.iter().fold(0, |any, s| any | s);
        }
    }
    // Steps to what is so many voxels away, where the ray may stand anywhere in its own.
    let steps = |free: usize| (free as f32 / STEP) as u8 + 1;
    // Blocks that are two or more away tell more than a few voxels do.
    let far =
        grown(block_stops, blocks, FARTHEST, |distance| if distance > 1 { steps((distance - 1) * BLOCK) } else { 0 });
    let mut near = grown(stops, side, NEAREST, |distance| steps(distance - 1));
    for (row, near) in near.chunks_exact_mut(side).enumerate() {
        let (y, z) = (row % side / BLOCK, row / side / BLOCK);
        for (near, &far) in near.chunks_exact_mut(BLOCK).zip(&far[(z * blocks + y) * blocks..][..blocks]) {
            near.iter_mut().for_each(|n| *n = (*n).max(far));
        }
    }
    // Of the padding; from outside of the grid, one step at a time.
    near[0] = 1;
    near
}

/// What `worth` says of the distance of each from the next that stops, the largest of the three axes, as far as `farthest`,
/// and 0 of those that stop: found by growing those that stop, one at a time. Rows touch the next here, which makes distances shorter
/// than they are, never longer.
fn grown(mut reached: Vec<u8>, side: usize, farthest: usize, worth: impl Fn(usize) -> u8) -> Vec<u8> {
    let mut value = vec![0u8; reached.len()];
    let mut next = vec![0u8; reached.len()];
    let mut told = 0;
    for distance in 1..=farthest {
        let more = worth(distance) - told;
        told += more;
        value.iter_mut().zip(&reached).for_each(|(v, &r)| *v += more * (1 - r));
        if distance < farthest {
            for pitch in [1, side, side * side] {
                grow(&reached, &mut next, pitch);
                std::mem::swap(&mut reached, &mut next);
            }
        }
    }
    value
}

/// Marks what is marked, and what is beside it along the axis of this pitch.
fn grow(marked: &[u8], grown: &mut [u8], pitch: usize) {
    let count = marked.len();
    if let Some(between) = count.checked_sub(2 * pitch) {
        let (before, here, after) = (&marked[..between], &marked[pitch..][..between], &marked[2 * pitch..]);
        for (((g, b), h), a) in grown[pitch..].iter_mut().zip(before).zip(here).zip(after) {
            *g = b | h | a;
        }
    }
    for i in (0..pitch).chain(count - pitch..count) {
        grown[i] = marked[i] | marked.get(i + pitch).unwrap_or(&0) | marked.get(i.wrapping_sub(pitch)).unwrap_or(&0);
    }
}
