//! The membrane that closes the surface in the unknown: Laplace's equation, with the outside 0, the surface 0.5 and
//! the inside 1.

use super::grid::{ExpectedVoxel, FREE, HOLLOW, SOLID, VoxelGrid};

/// Sweeps per decision at most, and the over-relaxation.
const SWEEPS: usize = 40;
const OMEGA: f32 = 1.8;
/// A row rests while nothing in it or beside it moved by more than this in the last sweep.
const SETTLED: f32 = 1e-3;

/// A value per voxel: 0 in free ones, 0.5 in the surface, up to 1 inside.
#[derive(Clone, Debug)]
pub(super) struct Membrane {
    /// Voxels along each axis, an even number.
    side: usize,
    /// Voxel `i` is element `i / 2` of one of two colors, as on a chessboard: its six neighbours have the other color,
    /// so that voxels of one can be relaxed in any order, and neighbours in memory together.
    chi: [Vec<f32>; 2],
}

/// Unknown voxels of one color with nothing else between them in their row along x.
struct Run {
    row: usize,
    start: usize,
    len: usize,
    /// 1 where their x is odd, else 0.
    odd: usize,
}

impl Run {
    fn voxels(&self) -> impl Iterator<Item = usize> {
        (self.start..self.start + self.len).map(|j| 2 * j + self.odd)
    }
}

impl Membrane {
    pub(super) fn new(side: usize) -> Self {
        let half = vec![0.0; side.pow(3) / 2];
        Self { side, chi: [half.clone(), half] }
    }

    pub(super) fn set(&mut self, i: usize, value: f32) {
        let color = self.color(i);
        self.chi[color][i / 2] = value;
    }

    pub(super) fn get(&self, i: usize) -> f32 {
        self.chi[self.color(i)][i / 2]
    }

    fn color(&self, i: usize) -> usize {
        let row = i / self.side;
        (i + row + row / self.side) % 2
    }

    /// The voxels of a row from one to before another, by color.
    fn runs(&self, from: usize, to: usize) -> [Run; 2] {
        [0, 1].map(|color| {
            let odd = (from + self.color(from) + color) % 2;
            let start = (from + 1 - odd) / 2;
            Run { row: from / self.side, start, len: (to + 1 - odd) / 2 - start, odd }
        })
    }

    /// Relaxes these runs of one color. `moved` is by how much the voxels of each row, by color, did in their last
    /// sweep at most. False if all rest.
    fn sweep(&mut self, color: usize, runs: &[Run], moved: &mut [Vec<f32>; 2]) -> bool {
        let mut any = false;
        let side = self.side;
        let (row, plane) = (side / 2, side * side / 2);
        let (own, other) = by_color(&mut self.chi, color);
        let (own_moved, other_moved) = by_color(moved, color);
        for runs in runs.chunk_by(|a, b| a.row == b.row) {
            let r = runs[0].row;
            let near = [r, r - 1, r + 1, r - side, r + side].map(|r| other_moved[r]);
            if near.into_iter().fold(own_moved[r], f32::max) < SETTLED {
                own_moved[r] = 0.0;
                continue;
            }
            any = true;
            // Bits of positive numbers are ordered as the numbers are, without a thought for NaN.
            let mut most = 0;
            for &Run { start, len, odd, .. } in runs {
                let own = &mut own[start..start + len];
                let from = |j: usize| &other[j..j + len];
                let x = [start + odd - 1, start + odd].map(from);
                let y = [start - row, start + row].map(from);
                let z = [start - plane, start + plane].map(from);
                for k in 0..len {
                    let sum = (x[0][k] + x[1][k]) + (y[0][k] + y[1][k]) + (z[0][k] + z[1][k]);
                    let step = OMEGA * (sum * (1.0 / 6.0) - own[k]);
                    own[k] += step;
                    most = most.max(step.abs().to_bits() as i32);
                }
            }
            own_moved[r] = f32::from_bits(most as u32);
        }
        any
    }
}

/// What belongs to one color, and to the other.
fn by_color<T>([even, odd]: &mut [T; 2], color: usize) -> (&mut T, &T) {
    if color == 0 { (even, odd) } else { (odd, even) }
}

impl VoxelGrid {
    /// Relaxes the membrane from where it was, tells hollow from solid, and finds where it passes.
    pub(super) fn relax(&mut self) {
        let runs = self.hollow_runs();
        // Anything may have changed since the last time.
        let mut moved = [0, 1].map(|_| vec![1.0; self.side * self.side]);
        for _ in 0..SWEEPS {
            let any = [0, 1].map(|color| self.membrane.sweep(color, &runs[color], &mut moved));
            if any == [false; 2] {
                break;
            }
        }
        let mut solid = Vec::new();
        for (chi, runs) in self.membrane.chi.iter().zip(&runs) {
            solid.extend(runs.iter().flat_map(Run::voxels).filter(|&i| chi[i / 2] > 0.5));
        }
        for &i in &solid {
            self.code[i] = SOLID;
            self.slot[i] = u32::MAX;
        }
        let s = self.side;
        let around = |i: usize| [i - 1, i + 1, i - s, i + s, i - s * s, i + s * s];
        let outside = |j: usize| matches!(self.code[j], FREE | HOLLOW);
        let passes = |&i: &usize| around(i).into_iter().any(outside);
        let chi = |j: usize| self.membrane.get(j);
        let expected = solid.into_iter().filter(passes).map(|i| {
            let [x0, x1, y0, y1, z0, z1] = around(i).map(chi);
            ExpectedVoxel::new(i as u32, [x0 - x1, y0 - y1, z0 - z1])
        });
        self.expected = expected.collect();
        for (k, e) in self.expected.iter().enumerate() {
            self.slot[e.index as usize] = k as u32;
        }
    }

    /// The hollow voxels by color.
    fn hollow_runs(&self) -> [Vec<Run>; 2] {
        let mut runs = [Vec::new(), Vec::new()];
        let hollow = |i: u32| self.code[i as usize] == HOLLOW;
        // Rows end in free voxels, so that no row continues in the next.
        for voxels in self.unknown.chunk_by(|&a, &b| b == a + 1 && hollow(a) == hollow(b)).filter(|v| hollow(v[0])) {
            let first = voxels[0] as usize;
            for (runs, run) in runs.iter_mut().zip(self.membrane.runs(first, first + voxels.len())) {
                if run.len > 0 {
                    runs.push(run);
                }
            }
        }
        runs
    }
}
