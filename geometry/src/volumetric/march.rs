//! Rays through the voxels, in steps that leap over what cannot stop them.

use super::grid::{BLOCK, FREE, HOLLOW, SOLID, VoxelGrid};

/// Steps of the rays in voxels.
const STEP: f32 = 0.75;
/// Blocks farther than this from what may stop a ray count as this far.
const FARTHEST: u8 = 12;

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hit {
    /// Free or empty space, or surface from behind.
    Nothing { hidden: bool },
    /// The membrane, in unknown space.
    Expected,
    /// Surface from its front, and the covered share there.
    Known { hidden: bool, covered: f32 },
}

/// A grid with blocks that know how far they are from what may stop a ray.
pub(super) struct Marcher<'a> {
    grid: &'a VoxelGrid,
    /// Blocks along an axis.
    blocks: usize,
    /// Steps that a ray in the block may take at once; 0: it must look at every voxel. First for rays in free space,
    /// then for those that have met unknown space, which only the membrane and the surface stop.
    leaps: [Vec<u8>; 2],
    /// Blocks that are not wholly free, by their first voxel.
    occupied: Vec<[usize; 3]>,
}

impl<'a> Marcher<'a> {
    pub(super) fn new(grid: &'a VoxelGrid) -> Self {
        let blocks = grid.side / BLOCK;
        let mut stops = [vec![0u8; blocks.pow(3)], vec![0u8; blocks.pow(3)]];
        for i in grid.unknown.iter().copied().chain(grid.surface.iter().map(|s| s.index)) {
            let [x, y, z] = grid.coordinates(i).map(|c| c / BLOCK);
            let block = (z * blocks + y) * blocks + x;
            stops[0][block] = 1;
            stops[1][block] |= u8::from(grid.code[i as usize] != HOLLOW);
        }
        let corner = |b: usize| [b % blocks, b / blocks % blocks, b / (blocks * blocks)].map(|c| c * BLOCK);
        let occupied = (0..stops[0].len()).filter(|&b| stops[0][b] > 0).map(corner).collect();
        Self { grid, blocks, leaps: stops.map(|stops| leaps(stops, blocks)), occupied }
    }

    pub(super) fn grid(&self) -> &VoxelGrid {
        self.grid
    }

    pub(super) fn occupied(&self) -> &[[usize; 3]] {
        &self.occupied
    }

    /// Follows a ray of unit direction from `near` to `far` (voxels from the eye).
    pub(super) fn follow(&self, eye: &[f32; 3], ray: &[f32; 3], near: f32, far: f32) -> Hit {
        let grid = self.grid;
        let (side, blocks) = (grid.side, self.blocks);
        let last = (side - 1) as f32;
        // All rays of a view step at the same distances.
        let mut n = (near / STEP).floor();
        let mut hidden = false;
        loop {
            let t = n * STEP;
            if t > far {
                return Hit::Nothing { hidden };
            }
            let [x, y, z] = [0, 1, 2].map(|k| (eye[k] + ray[k] * t).max(0.0).min(last) as usize);
            let leap = self.leaps[usize::from(hidden)][(z / BLOCK * blocks + y / BLOCK) * blocks + x / BLOCK];
            if leap > 0 {
                n += f32::from(leap);
                continue;
            }
            n += 1.0;
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

/// Steps that lead no farther than to the next block that stops, from its distance (the largest of the three axes
/// counts): found by growing the stopping blocks, one at a time.
fn leaps(stops: Vec<u8>, side: usize) -> Vec<u8> {
    let mut reached = stops;
    let mut distance = vec![0u8; reached.len()];
    for _ in 0..FARTHEST {
        distance.iter_mut().zip(&reached).for_each(|(d, &r)| *d += 1 - r);
        for pitch in [1, side, side * side] {
            grow(&mut reached, pitch, side);
        }
    }
    let steps = |d: u8| match usize::from(d) {
        0 => 0,
        d => (((d - 1) * BLOCK) as f32 / STEP).floor().max(1.0) as u8,
    };
    distance.into_iter().map(steps).collect()
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
