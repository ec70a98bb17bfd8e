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

/// Most pairs of samples within reach of each other: 1 GiB of them. One layer of surface asks for 18 to a sample, ten on top of
/// each other for 180.
const MAX_PAIRS: usize = 1 << 27;

/// A surface of which so much lies in one place that its points cannot be spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooDense;

impl std::fmt::Display for TooDense {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let limit = (MAX_PAIRS * size_of::<(u32, f32)>()) >> 20;
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
    let kept = eliminate(&samples, count, radius).ok_or(TooDense)?;
    Ok(samples.into_iter().zip(kept).filter_map(|(p, keep)| keep.then_some(p)).collect())
}

/// Which of the samples remain when the one with the nearest neighbours is taken away until `count` are left;
/// `radius` is the largest that `count` disks on this area can have. `None` for too many neighbours.
fn eliminate(samples: &[Point3<f64>], count: usize, radius: f64) -> Option<Vec<bool>> {
    let n = samples.len();
    let ratio = count as f64 / n as f64;
    let nearest = 2.0 * 0.65 * radius * (1.0 - ratio.powf(1.5));
    let grid = CellOrder::new(samples, 2.0 * radius);
    let influences = Influences::new(&grid, nearest as f32, (2.0 * radius) as f32)?;
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
    /// Influence (1 - d / reach)^8 of distance d, which counts as `nearest` where it is less; `None` for more than
    /// [`MAX_PAIRS`].
    fn new(grid: &CellOrder, nearest: f32, reach: f32) -> Option<Self> {
        let (n, per_reach) = (grid.sample.len(), 1.0 / reach);
        let (mut start, mut pairs) = (Vec::with_capacity(n + 1), Vec::with_capacity(20 * n));
        // The surroundings of a cell, copied together; padding lies beyond reach.
        let (mut ids, mut around) = (Vec::new(), [const { Vec::new() }; 3]);
        let (mut influence, mut within) = (Vec::new(), Vec::new());
        for i in 0..n {
            if i == 0 || grid.cell[i] != grid.cell[i - 1] {
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
            for (&j, &w) in ids.iter().zip(&influence) {
                within[found] = (j, w);
                found += usize::from((w > 0.0) & (j != i as u32));
            }
            start.push(pairs.len());
            if pairs.len() + found > MAX_PAIRS {
                return None;
            }
            // Never grown beyond the limit.
            if pairs.len() + found > pairs.capacity() {
                pairs.reserve_exact(pairs.len().max(found).min(MAX_PAIRS - pairs.len()));
            }
            pairs.extend_from_slice(&within[..found]);
        }
        start.push(pairs.len());
        Some(Self { start, pairs })
    }

    fn of(&self, i: usize) -> &[(u32, f32)] {
        &self.pairs[self.start[i]..self.start[i + 1]]
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
mod tests {
    use super::*;
    use crate::rng;
    use nalgebra::Vector3;

    /// A torus about z.
    fn torus(major: f64, minor: f64, n: u32) -> Mesh {
        let angle = |i: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        let vertex = |i: u32, j: u32| {
            let ring = major + minor * angle(j).cos();
            Point3::new(ring * angle(i).cos(), ring * angle(i).sin(), minor * angle(j).sin())
        };
        let vertices = (0..n).flat_map(|i| (0..n).map(move |j| vertex(i, j))).collect();
        let id = |i: u32, j: u32| (i % n) * n + j % n;
        let quad = |i, j| [[id(i, j), id(i + 1, j), id(i + 1, j + 1)], [id(i, j), id(i + 1, j + 1), id(i, j + 1)]];
        Mesh { vertices, triangles: (0..n).flat_map(|i| (0..n).flat_map(move |j| quad(i, j))).collect() }
    }

    /// Distances to the nearest other point, in the unit of the points, sorted.
    fn spacings(points: &[Point3<f64>], reach: f64) -> Vec<f64> {
        let grid = CellOrder::new(points, reach);
        let at = |i: usize| Vector3::new(grid.xyz[0][i], grid.xyz[1][i], grid.xyz[2][i]);
        let nearest = |i: usize| {
            let mut nearest = f64::MAX;
            grid.for_rows(i, |range| {
                let others = range.filter(|&j| j != i).map(|j| f64::from((at(i) - at(j)).norm()));
                nearest = others.fold(nearest, f64::min);
            });
            nearest
        };
        let mut spacings: Vec<f64> = (0..points.len()).map(nearest).collect();
        spacings.sort_by(f64::total_cmp);
        spacings
    }

    /// Mean, coefficient of variation and first percentile.
    fn statistics(sorted: &[f64]) -> (f64, f64, f64) {
        let n = sorted.len() as f64;
        let mean = sorted.iter().sum::<f64>() / n;
        let variance = sorted.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / n;
        (mean, variance.sqrt() / mean, sorted[sorted.len() / 100])
    }

    #[test]
    fn points_keep_their_distance_and_spread_evenly() {
        let mesh = torus(0.07, 0.03, 60);
        let count = 12_000;
        let points = poisson_disk_sample(&mesh, count, &mut rng::stream(5, "samples")).unwrap();
        assert_eq!(points.len(), count);
        // The facets lie up to 0.14 mm inside of the torus, and near the axis outside of it.
        assert!(points.iter().all(|p| {
            let from_ring = (p.xy().coords.norm() - 0.07).hypot(p.z);
            (0.0297..=0.0302).contains(&from_ring)
        }));
        let radius = (mesh.area() / (2.0 * 3f64.sqrt() * count as f64)).sqrt();
        let (mean, cv, percentile) = statistics(&spacings(&points, 2.0 * radius));
        // Relative to the densest packing's spacing, Open3D's published sets have a mean of 0.79 and CV 0.072.
        assert!((0.76..0.82).contains(&(mean / (2.0 * radius))), "{}", mean / (2.0 * radius));
        assert!(cv < 0.085 && percentile > 0.85 * mean, "CV {cv}, first percentile {percentile} of {mean}");
        // Even over the area: the outer half (facing away from the axis) has its share of the points.
        let outer = points.iter().filter(|p| p.xy().coords.norm() > 0.07).count() as f64 / count as f64;
        let share = (0.5 * std::f64::consts::PI * 0.07 + 0.03) / (std::f64::consts::PI * 0.07);
        assert!((outer - share).abs() < 0.005, "{outer} and {share}");
        let again = poisson_disk_sample(&mesh, count, &mut rng::stream(5, "samples")).unwrap();
        assert_eq!(points, again, "same stream, same points");
    }

    #[test]
    fn elimination_takes_the_heaviest_each_time() {
        let mesh = torus(0.07, 0.03, 20);
        let samples = sample_surface(&mesh, 400, &mut rng::stream(6, "samples"));
        let radius = (mesh.area() / (2.0 * 3f64.sqrt() * 80.0)).sqrt();
        let kept = eliminate(&samples, 80, radius).unwrap();
        // The definition, with all pairs and weights computed afresh before each removal.
        let nearest = 2.0 * 0.65 * radius * (1.0 - 0.2f64.powf(1.5));
        let mut expected = vec![true; 400];
        let influence = |i: usize, j: usize| {
            (1.0 - (samples[i] - samples[j]).norm().max(nearest) / (2.0 * radius)).max(0.0).powi(8)
        };
        for _ in 0..320 {
            let weight = |i: usize| (0..400).filter(|&j| j != i && expected[j]).map(|j| influence(i, j)).sum::<f64>();
            let alive = (0..400).filter(|&i| expected[i]);
            let heaviest = alive.max_by(|&i, &j| weight(i).total_cmp(&weight(j))).unwrap();
            expected[heaviest] = false;
        }
        let differ = (0..400).filter(|&i| kept[i] != expected[i]).count();
        assert!(differ <= 8, "{differ} of 400 differ; rounding may exchange equals, no more");
    }

    #[test]
    fn degenerate_meshes_have_no_points() {
        let mut rng = rng::stream(7, "samples");
        assert!(poisson_disk_sample(&Mesh::default(), 100, &mut rng).unwrap().is_empty());
        let flat = Mesh { vertices: vec![Point3::origin(); 3], triangles: vec![[0, 1, 2]] };
        assert!(poisson_disk_sample(&flat, 100, &mut rng).unwrap().is_empty());
        assert!(poisson_disk_sample(&torus(1.0, 0.5, 8), 0, &mut rng).unwrap().is_empty());
        assert_eq!(poisson_disk_sample(&torus(1.0, 0.5, 8), 1, &mut rng).unwrap().len(), 1);
    }

    #[test]
    fn layers_without_end_are_refused() {
        let layers = |count: u32| {
            let corner = |i: u32, x: f64, y: f64| Point3::new(x, y, f64::from(i) * 1e-6);
            let vertices = (0..count).flat_map(|i| [corner(i, 0.0, 0.0), corner(i, 0.1, 0.0), corner(i, 0.0, 0.1)]);
            Mesh {
                vertices: vertices.collect(),
                triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            }
        };
        let sample = |count| poisson_disk_sample(&layers(count), 60_000, &mut rng::stream(8, "samples"));
        assert_eq!(sample(10).map(|points| points.len()), Ok(60_000));
        let error = sample(19_900).expect_err("19,900 layers");
        assert!(error.to_string().contains("1024 MiB"), "{error}");
    }

    #[test]
    fn bonus_published_spacing_of_the_bunny() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/repository3d/bunny.obj");
        let Ok((models, _)) = tobj::load_obj(path, &tobj::LoadOptions { triangulate: true, ..Default::default() })
        else {
            println!("bonus test skipped: the 3D Repository's meshes are not beside this checkout");
            return;
        };
        let m = &models[0].mesh;
        let vertices = m.positions.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect();
        let triangles = m.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
        let mesh = Mesh { vertices, triangles }.normalized(0.2);
        let time = std::time::Instant::now();
        let points = poisson_disk_sample(&mesh, 60_000, &mut rng::stream(0, "samples")).unwrap();
        let seconds = time.elapsed().as_secs_f64();
        let (mean, cv, percentile) = statistics(&spacings(&points, 0.0012));
        println!("bunny: mean {:.4} mm, 1 % {:.4} mm, CV {cv:.4}; {seconds:.3} s", mean * 1e3, percentile * 1e3);
        assert!(
            (mean * 1e3 - 0.6634).abs() < 0.003 && (percentile * 1e3 - 0.5914).abs() < 0.004,
            "{mean} {percentile}"
        );
        assert!((cv - 0.073).abs() < 0.003, "{cv}");
    }
}
