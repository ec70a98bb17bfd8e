//! The membrane that closes the surface in the unknown: Laplace's equation, with the outside 0, the surface 0.5 and
//! the inside 1.

use super::grid::{FREE, HOLLOW, SOLID, VoxelGrid};

/// Sweeps per decision at most, and the over-relaxation.
const SWEEPS: usize = 40;
const OMEGA: f32 = 1.8;
/// Sweeps end when no voxel moved by more than this.
const SETTLED: f32 = 2e-3;

impl VoxelGrid {
    /// Relaxes the membrane from where it was, and tells hollow from solid. Returns how many voxels it passes through.
    pub(super) fn relax(&mut self) -> usize {
        let s = self.side;
        let (mut red, mut black) = (Vec::new(), Vec::new());
        for &i in self.unknown.iter().filter(|&&i| self.code[i as usize] == HOLLOW) {
            let [x, y, z] = self.coordinates(i);
            if (x + y + z) % 2 == 0 { red.push(i) } else { black.push(i) }
        }
        let chi = &mut self.chi[..];
        // Voxels of a color have neighbours of the other only, so that the order within a color does not matter.
        let mut sweep = |color: &[u32]| {
            let mut moved = 0f32;
            for &i in color {
                let i = i as usize;
                let around = [i - 1, i + 1, i - s, i + s, i - s * s, i + s * s].map(|j| chi[j]);
                let sum = (around[0] + around[1]) + (around[2] + around[3]) + (around[4] + around[5]);
                let step = OMEGA * (sum * (1.0 / 6.0) - chi[i]);
                chi[i] += step;
                moved = moved.max(step.abs());
            }
            moved
        };
        for _ in 0..SWEEPS {
            let moved = sweep(&red);
            if moved.max(sweep(&black)) < SETTLED {
                break;
            }
        }
        for &i in red.iter().chain(&black).filter(|&&i| self.chi[i as usize] > 0.5) {
            self.code[i as usize] = SOLID;
        }
        let outside = |j: usize| matches!(self.code[j], FREE | HOLLOW);
        let passes = |&&i: &&u32| {
            let i = i as usize;
            self.code[i] == SOLID && [i - 1, i + 1, i - s, i + s, i - s * s, i + s * s].into_iter().any(outside)
        };
        red.iter().chain(&black).filter(passes).count()
    }
}
