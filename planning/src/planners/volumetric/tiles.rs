//! The parts of an image in which a view meets blocks of voxels, and how far away.

use super::grid::BLOCK;
use geometry::PinholeCamera;
use nalgebra::{Matrix3, Vector3};

/// Edge of a tile, pixels.
pub(super) const TILE: u32 = 8;

/// The tiles of an image.
pub(super) struct Tiles {
    first: [usize; 2],
    size: [usize; 2],
    /// Nearest and farthest voxel of each tile.
    spans: Vec<[f32; 2]>,
}

/// A tile that shows something.
pub(super) struct Span {
    pub(super) column: u32,
    pub(super) row: u32,
    /// Distances from the eye between which it lies, voxels.
    pub(super) near: f32,
    pub(super) far: f32,
}

impl Tiles {
    /// Tiles that show one of the blocks (given by their first voxels) from `eye`, in voxel coordinates.
    pub(super) fn new(camera: &PinholeCamera, eye: &[f32; 3], rotation: &Matrix3<f32>, blocks: &[[usize; 3]]) -> Self {
        let count = [camera.width, camera.height].map(|n| n.div_ceil(TILE) as usize);
        let camera_from_world = rotation.transpose();
        let [focal, middle] = [[camera.fx, camera.fy], [camera.cx, camera.cy]].map(|v| v.map(|x| x as f32));
        let half = BLOCK as f32 / 2.0;
        let radius = half * 3f32.sqrt();
        // Of blocks around the eye, which any tile may show.
        let mut everywhere = [f32::MAX, 0.0f32];
        let shown: Vec<([usize; 4], f32)> = blocks
            .iter()
            .filter_map(|block| {
                let p = camera_from_world * Vector3::from_fn(|k, _| block[k] as f32 + half - eye[k]);
                if p.z < -radius {
                    return None;
                }
                if p.z < 2.0 * radius {
                    everywhere = [everywhere[0].min(p.norm() - radius), everywhere[1].max(p.norm() + radius)];
                    return None;
                }
                // The box around the ball around the block, which no rotation leaves.
                let tile = |k: usize| {
                    let (low, high) = (p[k] - radius, p[k] + radius);
                    let nearest = |x: f32, z: f32| (focal[k] * x / z + middle[k]) / TILE as f32;
                    let least = nearest(low, p.z - radius).min(nearest(low, p.z + radius));
                    let most = nearest(high, p.z - radius).max(nearest(high, p.z + radius));
                    (most >= 0.0 && least < count[k] as f32)
                        .then(|| [least as usize, (most as usize).min(count[k] - 1)])
                };
                let (columns, rows) = (tile(0)?, tile(1)?);
                Some(([columns[0], columns[1], rows[0], rows[1]], p.norm()))
            })
            .collect();
        let all = everywhere[0] < everywhere[1];
        let (mut first, mut end) = if all { ([0; 2], count) } else { ([usize::MAX; 2], [0; 2]) };
        for ([c0, c1, r0, r1], _) in &shown {
            first = [first[0].min(*c0), first[1].min(*r0)];
            end = [end[0].max(c1 + 1), end[1].max(r1 + 1)];
        }
        let size = [0, 1].map(|k| end[k].saturating_sub(first[k]));
        let mut spans = vec![everywhere; size[0] * size[1]];
        for ([c0, c1, r0, r1], distance) in shown {
            for row in r0..=r1 {
                let start = (row - first[1]) * size[0];
                for span in &mut spans[start + c0 - first[0]..=start + c1 - first[0]] {
                    *span = [span[0].min(distance - radius), span[1].max(distance + radius)];
                }
            }
        }
        Self { first, size, spans }
    }

    /// Those that show something, row by row.
    pub(super) fn spans(&self) -> impl Iterator<Item = Span> {
        self.spans.iter().enumerate().filter(|(_, [near, far])| near < far).map(|(i, &[near, far])| Span {
            column: (self.first[0] + i % self.size[0]) as u32 * TILE,
            row: (self.first[1] + i / self.size[0]) as u32 * TILE,
            near: near.max(0.0),
            far,
        })
    }
}
