//! Evenly spread points on a surface.

use crate::Mesh;
use nalgebra::Point3;
use rand::{Rng, RngExt};
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

/// Random samples drawn for each point that is kept.
const OVERSAMPLING: usize = 5;
/// Bound on the cells of the search grid.
const MAX_CELLS: f64 = 8e6;
/// Ratio of successive thresholds of the elimination.
const BAND: f32 = 0.93;

/// Most pairs of samples within reach of each other: 1 GiB of them.
const MAX_PAIRS: usize = 1 << 27;
/// The same to a sample. One layer of surface asks for 18, ten on top of each other for 180.
const MAX_NEIGHBORS: usize = 190;
/// One sample in so many is asked for its neighbours before a table is made for all.
const PROBED: usize = 64;

/// A surface of which so much lies in one place that its points cannot be spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooDense {
    /// What the table of neighbours may hold, MiB.
    limit_mib: usize,
}

impl std::fmt::Display for TooDense {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let limit = self.limit_mib;
        write!(
            f,
            "its surface lies in dozens of layers on top of each other: spreading points on it would take more than {limit} MiB; \
             leave out faces that repeat or hide inside"
        )
    }
}

impl std::error::Error for TooDense {}

/// `count` points on the surface, uniform over its area: one in each of `count` strips of equal area. Empty for
/// a mesh without area.
pub fn sample_surface(mesh: &Mesh, count: usize, rng: &mut impl Rng) -> Vec<Point3<f64>> {
    let area: Vec<f64> = mesh
        .triangles
        .iter()
        .map(|&t| {
            let [a, b, c] = mesh.corners(t);
            (b - a).cross(&(c - a)).norm()
        })
        .collect();
    let total: f64 = area.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let (mut triangle, mut before) = (0, 0.0);
    (0..count)
        .map(|i| {
            let along = (i as f64 + rng.random::<f64>()) / count as f64 * total;
            while before + area[triangle] < along && triangle + 1 < area.len() {
                before += area[triangle];
                triangle += 1;
            }
            let [a, b, c] = mesh.corners(mesh.triangles[triangle]);
            let (root, v) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
            a + (b - a) * (root * (1.0 - v)) + (c - a) * (root * v)
        })
        .collect()
}

/// `count` points on the surface that keep their distance from each other: weighted sample elimination (Yuksel
/// 2015) from five times as many random ones, with the published parameters (alpha 8, beta 0.65, gamma 1.5).
/// Own code: crates offer dart throwing in boxes only. Empty for a mesh without area.
///
/// # Errors
/// [`TooDense`]: the table of neighbours would outgrow what any object needs.
pub fn poisson_disk_sample(mesh: &Mesh, count: usize, rng: &mut impl Rng) -> Result<Vec<Point3<f64>>, TooDense> {
    let samples = sample_surface(mesh, count * OVERSAMPLING, rng);
    if samples.is_empty() {
        return Ok(samples);
    }
    let radius = (mesh.area() / (2.0 * 3f64.sqrt() * count as f64)).sqrt();
    let most = MAX_PAIRS.min(MAX_NEIGHBORS * samples.len());
    let too_dense = TooDense { limit_mib: (most * size_of::<(u32, f32)>()) >> 20 };
    let kept = eliminate(&samples, count, radius, most).ok_or(too_dense)?;
    Ok(samples.into_iter().zip(kept).filter_map(|(p, keep)| keep.then_some(p)).collect())
}

/// Which of the samples remain when the one with the nearest neighbours is taken away until `count` are left;
/// `radius` is the largest that `count` disks on this area can have. `None` for more than `most` pairs of neighbours.
fn eliminate(samples: &[Point3<f64>], count: usize, radius: f64, most: usize) -> Option<Vec<bool>> {
    let n = samples.len();
    let ratio = count as f64 / n as f64;
    let nearest = 2.0 * 0.65 * radius * (1.0 - ratio.powf(1.5));
    let grid = CellOrder::new(samples, 2.0 * radius);
    let influences = Influences::new(&grid, nearest as f32, (2.0 * radius) as f32, most)?;
    let mut weight: Vec<f32> = (0..n).map(|i| influences.of(i).iter().map(|&(_, w)| w).sum()).collect();
    // Weights only fall, so the samples above a falling threshold are the next to go, heaviest first: a small heap
    // at a time instead of one of all. An entry whose key is still its weight is the heaviest; others are put back.
    let key = |weight: f32, i: usize| (u64::from(weight.max(0.0).to_bits()) << 32) | i as u64;
    let mut kept = vec![true; n];
    let mut surplus = n - count.min(n);
    let heaviest = weight.iter().copied().fold(0.0, f32::max);
    let mut threshold = heaviest;
    let mut heap = BinaryHeap::new();
    while surplus > 0 {
        threshold = if threshold > 1e-6 * heaviest { threshold * BAND } else { -1.0 };
        let mut band = std::mem::take(&mut heap).into_vec();
        for (block, weights) in weight.chunks(32).enumerate() {
            if weights.iter().fold(false, |any, &w| any | (w > threshold)) {
                let above = weights.iter().enumerate().filter(|&(_, &w)| w > threshold);
                band.extend(above.map(|(i, &w)| key(w, 32 * block + i)));
            }
        }
        heap = BinaryHeap::from(band);
        while let Some(mut top) = heap.peek_mut().filter(|_| surplus > 0) {
            let i = (*top & 0xffff_ffff) as usize;
            let current = key(weight[i], i);
            if *top == current {
                PeekMut::pop(top);
                kept[grid.sample[i] as usize] = false;
                weight[i] = f32::NEG_INFINITY;
                influences.of(i).iter().for_each(|&(j, w)| weight[j as usize] -= w);
                surplus -= 1;
            } else if weight[i] > threshold {
                *top = current;
            } else {
                PeekMut::pop(top);
            }
        }
    }
    Some(kept)
}

/// For each sample, by its place in cell order, the others within reach and the influence between the two: about
/// 18 on a smooth surface, 8 bytes each.
struct Influences {
    start: Vec<usize>,
    pairs: Vec<(u32, f32)>,
}

impl Influences {
    /// Influence (1 - d / reach)^8 of distance d, which counts as `nearest` where it is less; `None` for more than `most`
    /// pairs: found out on some of the samples first, so that no memory is taken for what would not fit.
    fn new(grid: &CellOrder, nearest: f32, reach: f32, most: usize) -> Option<Self> {
        let n = grid.sample.len();
        let mut around = Surroundings::default();
        (0..n).step_by(PROBED).try_fold((most + most / 4) / PROBED, |left, i| {
            left.checked_sub(around.of(grid, i, nearest, reach).len())
        })?;
        let (mut start, mut pairs) = (Vec::with_capacity(n + 1), Vec::with_capacity(20 * n));
        for i in 0..n {
            let found = around.of(grid, i, nearest, reach);
            start.push(pairs.len());
            if pairs.len() + found.len() > most {
                return None;
            }
            // Never grown beyond the limit.
            if pairs.len() + found.len() > pairs.capacity() {
                pairs.reserve_exact(pairs.len().max(found.len()).min(most - pairs.len()));
            }
            pairs.extend_from_slice(found);
        }
        start.push(pairs.len());
        Some(Self { start, pairs })
    }

    fn of(&self, i: usize) -> &[(u32, f32)] {
        &self.pairs[self.start[i]..self.start[i + 1]]
    }
}

/// The samples around a cell, copied together; padding lies beyond reach.
#[derive(Default)]
struct Surroundings {
    cell: Option<u32>,
    ids: Vec<u32>,
    around: [Vec<f32>; 3],
    influence: Vec<f32>,
    within: Vec<(u32, f32)>,
}

impl Surroundings {
    /// The others within reach of a sample, by its place in cell order, and their influence.
    fn of(&mut self, grid: &CellOrder, i: usize, nearest: f32, reach: f32) -> &[(u32, f32)] {
        let Self { cell, ids, around, influence, within } = self;
        if *cell != Some(grid.cell[i]) {
            *cell = Some(grid.cell[i]);
            ids.clear();
            around.iter_mut().for_each(Vec::clear);
            grid.for_rows(i, |range| {
                ids.extend(range.start as u32..range.end as u32);
                for (around, axis) in around.iter_mut().zip(&grid.xyz) {
                    around.extend_from_slice(&axis[range.clone()]);
                }
            });
            let padded = ids.len().next_multiple_of(8);
            around.iter_mut().for_each(|axis| axis.resize(padded, f32::MAX.sqrt()));
            influence.resize(padded, 0.0);
            within.resize(padded, (0, 0.0));
        }
        let per_reach = 1.0 / reach;
        let [x, y, z] = [0, 1, 2].map(|axis| grid.xyz[axis][i]);
        let [xs, ys, zs] = [0, 1, 2].map(|axis| around[axis].chunks_exact(8));
        for (((w, xs), ys), zs) in influence.chunks_exact_mut(8).zip(xs).zip(ys).zip(zs) {
            for k in 0..8 {
                let (dx, dy, dz) = (xs[k] - x, ys[k] - y, zs[k] - z);
                let distance = (dx * dx + dy * dy + dz * dz).sqrt();
                let clamped = if distance > nearest { distance } else { nearest };
                let t = 1.0 - clamped * per_reach;
                let t = if t > 0.0 { t } else { 0.0 };
                let t4 = (t * t) * (t * t);
                w[k] = t4 * t4;
            }
        }
        let mut found = 0;
        for (&j, &w) in ids.iter().zip(influence.iter()) {
            within[found] = (j, w);
            found += usize::from((w > 0.0) & (j != i as u32));
        }
        &within[..found]
    }
}

/// Points sorted by the cells of a uniform grid, x fastest, so that three neighbouring cells are one slice.
struct CellOrder {
    cells: [usize; 3],
    /// First point of each cell, and the end.
    start: Vec<u32>,
    /// Per point in cell order: its cell, its index among the samples, and its coordinates.
    cell: Vec<u32>,
    sample: Vec<u32>,
    xyz: [Vec<f32>; 3],
}

impl CellOrder {
    fn new(points: &[Point3<f64>], reach: f64) -> Self {
        let (low, high) = crate::cloud::bounding_box(points);
        let extent = high - low;
        let count_at = |edge: f64| [0, 1, 2].map(|k| (extent[k] / edge).floor() + 1.0);
        let mut edge = reach;
        while count_at(edge).iter().product::<f64>() > MAX_CELLS {
            edge *= 1.25;
        }
        let cells = count_at(edge).map(|c| c as usize);
        let of = |p: &Point3<f64>| {
            let [x, y, z] = [0, 1, 2].map(|k| (((p - low)[k] / edge) as usize).min(cells[k] - 1));
            (z * cells[1] + y) * cells[0] + x
        };
        let mut start = vec![0u32; cells.iter().product::<usize>() + 1];
        let unsorted: Vec<u32> = points.iter().map(|p| of(p) as u32).collect();
        unsorted.iter().for_each(|&c| start[c as usize] += 1);
        for c in 1..start.len() {
            start[c] += start[c - 1];
        }
        // `start` holds the ends until each cell is filled, last point first.
        let mut sample = vec![0; points.len()];
        for (i, &c) in unsorted.iter().enumerate().rev() {
            start[c as usize] -= 1;
            sample[start[c as usize] as usize] = i as u32;
        }
        let cell = sample.iter().map(|&i| unsorted[i as usize]).collect();
        let axis = |k: usize| sample.iter().map(|&i| (points[i as usize] - low)[k] as f32).collect();
        let xyz = [axis(0), axis(1), axis(2)];
        Self { cells, start, cell, sample, xyz }
    }

    /// Calls `visit` with the slices of points in the 27 cells around a point, nine at most.
    fn for_rows(&self, i: usize, mut visit: impl FnMut(std::ops::Range<usize>)) {
        let [nx, ny, nz] = self.cells;
        let cell = self.cell[i] as usize;
        let (x, y, z) = (cell % nx, cell / nx % ny, cell / (nx * ny));
        let (x_first, x_last) = (x.saturating_sub(1), (x + 1).min(nx - 1));
        for z in z.saturating_sub(1)..(z + 2).min(nz) {
            for y in y.saturating_sub(1)..(y + 2).min(ny) {
                let row = (z * ny + y) * nx;
                let range = self.start[row + x_first] as usize..self.start[row + x_last + 1] as usize;
                if !range.is_empty() {
                    visit(range);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
