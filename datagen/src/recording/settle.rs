//! One surface from scans that lie apart, by the noise of their sensor and by how they were registered: without it, every
//! scan would add a layer of its own to their union.

use formats::sequence::SequenceScan;
use geometry::normals::{estimate_normals, orient_normals_toward};
use geometry::{NeighborGrid, Neighborhoods, PointCloud};
use nalgebra::{Point3, Vector3};
use planning::accumulate::{Accumulate, reference_surface};
use rayon::prelude::*;

/// Points that a normal is estimated from.
const NEIGHBORS: usize = 30;
/// Tolerances to both sides of a point over which the scans are averaged along its normal, and as far as another scan is
/// looked for, at first.
const BESIDE: f64 = 2.0;
const FAR: f64 = 6.0;
/// Deviations within which a point belongs to the surface.
const DEVIATIONS: f64 = 4.0;
/// Points that are asked how far other scans lie from them.
const ASKED: usize = 20_000;
/// Median distance of a normal distribution, in deviations.
const MEDIAN: f64 = 0.6745;

/// All scans together, each averaged in voxels as wide as the tolerance.
struct Layers {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    scan: Vec<u32>,
    grid: NeighborGrid,
    tolerance: f64,
}

/// Scans on the surface that they have in common.
pub(super) struct Settled {
    /// Their points, on the mean of all scans.
    pub scans: Vec<Vec<Point3<f64>>>,
    /// Standard deviation of the scans from it, along its normals, metres.
    pub spread_m: f64,
}

impl Settled {
    pub fn new(scans: &[SequenceScan], tolerance: f64) -> Self {
        let layers = Layers::new(scans, tolerance);
        let spread_m = layers.spread();
        let apart = tolerance.max(DEVIATIONS * spread_m).min(FAR * tolerance);
        let start = |scan: usize| layers.scan.partition_point(|&s| (s as usize) < scan);
        let settled = (0..scans.len()).into_par_iter().map(|i| {
            let (from, to) = (start(i), start(i + 1));
            let own = NeighborGrid::new(&layers.points[from..to], 2.0 * tolerance);
            let moved = |p: &Point3<f64>| match own.nearest(p) {
                Some(nearest) => layers.settled(p, &layers.normals[from + nearest.index], apart),
                None => *p,
            };
            scans[i].points.iter().map(moved).collect()
        });
        Self { scans: settled.collect(), spread_m }
    }
}

impl Layers {
    fn new(scans: &[SequenceScan], tolerance: f64) -> Self {
        let averaged = |scan: &SequenceScan| {
            let points = reference_surface(&scan.points, tolerance, Accumulate::Averaged);
            let mut cloud = PointCloud {
                normals: estimate_normals(&points, &Neighborhoods::of(&points, NEIGHBORS), NEIGHBORS),
                points,
            };
            orient_normals_toward(&mut cloud, &Point3::from(scan.world_from_camera.translation.vector));
            cloud
        };
        let clouds: Vec<PointCloud> = scans.par_iter().map(averaged).collect();
        let scan = (0..).zip(&clouds).flat_map(|(i, cloud)| std::iter::repeat_n(i, cloud.len())).collect();
        let normals = clouds.iter().flat_map(|cloud| cloud.normals.iter().copied()).collect();
        let points: Vec<Point3<f64>> = clouds.into_iter().flat_map(|cloud| cloud.points).collect();
        let grid = NeighborGrid::new(&points, 2.0 * tolerance);
        Self { points, normals, scan, grid, tolerance }
    }

    /// Points of the same side of the surface beside `p`, at most so far along its normal: their places, and how far they are along it.
    fn column(&self, p: &Point3<f64>, normal: &Vector3<f64>, beside: f64, along: f64) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        self.grid.for_each_within(p, beside.hypot(along), |j| {
            let away = self.points[j] - p;
            let height = away.dot(normal);
            let near = height.abs() <= along && (away - normal * height).norm_squared() <= beside * beside;
            if near && self.normals[j].dot(normal) > 0.5 {
                found.push((j, height));
            }
        });
        found
    }

    /// By how much another scan deviates from one, along the normal.
    fn spread(&self) -> f64 {
        let step = self.points.len().div_ceil(ASKED).max(1);
        let asked: Vec<usize> = (0..self.points.len()).step_by(step).collect();
        let apart = asked.par_iter().flat_map_iter(|&i| {
            let mut found = self.column(&self.points[i], &self.normals[i], self.tolerance, FAR * self.tolerance);
            found.retain(|&(j, _)| self.scan[j] != self.scan[i]);
            found.sort_by_key(|&(j, _)| self.scan[j]);
            let mean = |column: &[(usize, f64)]| column.iter().map(|(_, h)| h).sum::<f64>() / column.len() as f64;
            let of_scans = found.chunk_by(|a, b| self.scan[a.0] == self.scan[b.0]).map(|c| mean(c).abs());
            of_scans.collect::<Vec<_>>()
        });
        let mut apart: Vec<f64> = apart.collect();
        let middle = apart.len() / 2;
        match apart.is_empty() {
            true => 0.0,
            // Of both scans together.
            false => *apart.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN / 2f64.sqrt(),
        }
    }

    /// The point on the mean of all that lie beside it.
    fn settled(&self, p: &Point3<f64>, normal: &Vector3<f64>, along: f64) -> Point3<f64> {
        let beside = BESIDE * self.tolerance;
        let column = self.column(p, normal, beside, along);
        let sum: Vector3<f64> = column.iter().map(|&(j, _)| self.normals[j]).sum();
        let Some(mean) = sum.try_normalize(1e-9) else { return *p };
        let column = self.column(p, &mean, beside, along);
        let height = column.iter().map(|(_, h)| h).sum::<f64>() / column.len().max(1) as f64;
        p + mean * height
    }
}
