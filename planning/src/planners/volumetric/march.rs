//! Rays through the voxels, in steps that leap over what cannot stop them.

use super::grid::{BLOCK, FREE, HOLLOW, SOLID, SurfaceVoxel, VoxelGrid};
use crate::SensorConfig;

/// Steps of the rays in voxels.
const STEP: f32 = 0.75;
/// Edge of the cells that leaps are known for, voxels.
const CELL: usize = BLOCK / 2;
/// Positions along a ray are whole numbers of this part of a voxel.
const ONE_BITS: u32 = 20;
const ONE: f32 = (1 << ONE_BITS) as f32;
/// Blocks farther than this from what may stop a ray count as this far.
const FARTHEST: u8 = 12;

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

/// A grid with cells that know how far they are from what may stop a ray.
pub(super) struct Marcher<'a> {
    grid: &'a VoxelGrid,
    /// Whether the space in front of all is free; else every ray is taken to start in unknown space.
    carves: bool,
    /// Cells along an axis.
    cells: usize,
    /// Steps that a ray in the cell may take at once; 0: it must look at every voxel. First for rays in free space,
    /// then for those that have met unknown space, which only the membrane and the surface stop.
    leaps: [Vec<u8>; 2],
    /// Blocks with something that may stop a ray or be unknown to it, by their first voxel.
    occupied: Vec<[usize; 3]>,
    sensor: Limits,
}

/// What the sensor measures: from how near to how far, voxels, and the least cosine to the normal.
#[derive(Clone, Copy, Debug)]
struct Limits {
    range: [f32; 2],
    cosine: f32,
}

impl<'a> Marcher<'a> {
    /// `carves` is whether misses carve. Where they do not, nearly all space stays unknown, and where rays enter it
    /// means nothing: they start in it, and only what stops them counts.
    pub(super) fn new(grid: &'a VoxelGrid, carves: bool) -> Self {
        let (blocks, cells) = (grid.side / BLOCK, grid.side / CELL);
        let mut stops = [vec![0u8; cells.pow(3)], vec![0u8; cells.pow(3)]];
        let mut occupied = vec![false; blocks.pow(3)];
        let counts = |&i: &u32| carves || grid.code[i as usize] != HOLLOW;
        for i in grid.unknown.iter().copied().chain(grid.surface.iter().map(|s| s.index)).filter(counts) {
            let at = grid.coordinates(i);
            let within = |edge: usize, count: usize| (at[2] / edge * count + at[1] / edge) * count + at[0] / edge;
            occupied[within(BLOCK, blocks)] = true;
            let cell = within(CELL, cells);
            stops[0][cell] = 1;
            stops[1][cell] |= u8::from(grid.code[i as usize] != HOLLOW);
        }
        let corner = |b: usize| [b % blocks, b / blocks % blocks, b / (blocks * blocks)].map(|c| c * BLOCK);
        let occupied = (0..occupied.len()).filter(|&b| occupied[b]).map(corner).collect();
        let sensor = Limits { range: [0.0, f32::INFINITY], cosine: 0.0 };
        Self { grid, carves, cells, leaps: stops.map(|stops| leaps(stops, cells)), occupied, sensor }
    }

    /// For a sensor with limits.
    pub(super) fn of_sensor(self, sensor: &SensorConfig) -> Self {
        let range = sensor.range().map(|metres| (metres / self.grid.voxel) as f32);
        Self { sensor: Limits { range, cosine: sensor.least_cosine() as f32 }, ..self }
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
        &self.occupied
    }

    /// Follows a ray of unit direction from `near` to `far` (voxels from the eye).
    #[inline(always)]
    pub(super) fn follow(&self, eye: &[f32; 3], ray: &[f32; 3], near: f32, far: f32) -> Hit<'a> {
        let grid = self.grid;
        let side = grid.side;
        // All rays of a view step at the same distances; from the first on in fixed point.
        let first = (near / STEP) as i32;
        let mut left = (far / STEP) as i32 - first;
        let mut at = [0, 1, 2].map(|k| ((eye[k] + ray[k] * (first as f32 * STEP)) * ONE) as i32);
        let step = ray.map(|r| (r * (STEP * ONE)) as i32);
        let all = first + left;
        let at_step = |left: i32| (all - left) as f32 * STEP;
        let mut entered = (!self.carves).then(|| at_step(left));
        let mut leaps = &self.leaps[usize::from(!self.carves)];
        while left >= 0 {
            let [x, y, z] = at.map(|a| (a >> ONE_BITS) as u32 as usize);
            let leap = if x.max(y).max(z) < side {
                let leap = leaps[((z / CELL) * self.cells + y / CELL) * self.cells + x / CELL];
                if leap == 0 {
                    let i = (z * side + y) * side + x;
                    match grid.code[i] {
                        FREE => {}
                        HOLLOW => {
                            entered = entered.or(Some(at_step(left)));
                            leaps = &self.leaps[1];
                        }
                        SOLID => return Hit::Expected { index: i, at: at_step(left) },
                        _ => {
                            let Some(voxel) = grid.surface_at(i) else { break };
                            let n = &voxel.normal;
                            let facing = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2];
                            if facing < 0.0 {
                                let cosine = -facing / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                                return Hit::Known { hidden: entered.is_some(), voxel, cosine, at: at_step(left) };
                            }
                            break;
                        }
                    }
                }
                i32::from(leap.max(1))
            } else {
                1
            };
            left -= leap;
            at = [0, 1, 2].map(|k| at[k].wrapping_add(step[k] * leap));
        }
        Hit::Nothing { entered }
    }
}

/// Steps that lead no farther than to the next cell that stops, from the distances of cells and of blocks.
fn leaps(stops: Vec<u8>, cells: usize) -> Vec<u8> {
    let blocks = cells / 2;
    let block_of = |i: usize| (i / (cells * cells) / 2 * blocks + i / cells % cells / 2) * blocks + i % cells / 2;
    let mut block_stops = vec![0; blocks.pow(3)];
    for (i, _) in stops.iter().enumerate().filter(|(_, s)| **s > 0) {
        block_stops[block_of(i)] = 1;
    }
    let far = distances(block_stops, blocks, FARTHEST);
    // Blocks that are two or more away tell more than three cells do.
    let mut steps = distances(stops, cells, 3);
    for (row, steps) in steps.chunks_exact_mut(cells).enumerate() {
        let far = &far[block_of(row * cells)..][..blocks];
        for (near, &far) in steps.chunks_exact_mut(2).zip(far) {
            for d in near.iter_mut().filter(|d| **d > 0) {
                let free = (usize::from(*d - 1) * CELL).max(usize::from(far.max(1) - 1) * BLOCK);
                *d = (free as f32 / STEP) as u8 + 1;
            }
        }
    }
    steps
}

/// Distance of each from the next that stops, the largest of the three axes, as far as `farthest`: found by growing
/// those that stop, one at a time.
fn distances(stops: Vec<u8>, side: usize, farthest: u8) -> Vec<u8> {
    let mut reached = stops;
    let mut distance = vec![0u8; reached.len()];
    for _ in 0..farthest {
        distance.iter_mut().zip(&reached).for_each(|(d, &r)| *d += 1 - r);
        for pitch in [1, side, side * side] {
            grow(&mut reached, pitch, side);
        }
    }
    distance
}

/// Marks what is beside something marked, along the axis of this pitch.
fn grow(marked: &mut [u8], pitch: usize, side: usize) {
    let before = marked.to_vec();
    let run = pitch * side;
    for (marked, before) in marked.chunks_exact_mut(run).zip(before.chunks_exact(run)) {
        marked[pitch..].iter_mut().zip(before).for_each(|(m, &b)| *m |= b);
        marked.iter_mut().zip(&before[pitch..]).for_each(|(m, &b)| *m |= b);
    }
}
