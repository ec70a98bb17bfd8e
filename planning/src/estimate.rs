//! Where a cloud was scanned from, estimated from the cloud itself: a surface shows its front to the camera, and from there no
//! part of it hides another.

mod rim;
mod trust;

use crate::{CameraPose, PastScan, Seen};
use geometry::{NeighborGrid, PointCloud, View, orient_normals_toward};
use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};
use rayon::prelude::*;
use rim::{EdgePoint, turning_away};
use rustc_hash::FxHashMap;

pub use trust::Trust;
pub(crate) use trust::interpolated;

/// A cloud is taken for several scans merged where the density of its points is told worse than this by one camera (the
/// root of the unexplained share), or more of its points hide behind others from there: 95 % of the simulated scans of one
/// camera are under 0.19 and over 0.81.
const MISFIT: f64 = 0.22;
const UNHIDDEN: f64 = 0.8;
/// Yet not where this share of its normals faces the direction of their mean.
const FACING: f64 = 0.9;
/// Spacings within which density is measured, and the offset of their middle, in that radius, from which a point is taken
/// to lie at an edge.
const REACH: f64 = 3.2;
const EDGE: f64 = 0.2;
/// Share of the points that the fit leaves aside as disturbed, twice.
const TRIMMED: f64 = 0.2;
/// Weight of what the edges say of the side, beside the logarithm of what the density says.
const EDGES: f64 = 2.0;
/// Normals that are compared with each other, about, and the cosine from which two tell the same (15 degrees).
const COMPARED: usize = 300;
const ALIKE: f64 = 0.966;
/// Directions that are tried for the cameras of a merged cloud.
const DIRECTIONS: usize = 200;
/// Cosine between normal and direction under which a point does not count as seen.
const GRAZING: f64 = 0.3;
/// Cameras of a merged cloud: no more, once this share of its points is explained, or one explains less than that.
const MOST: usize = 16;
const EXPLAINED: f64 = 0.97;
const LEAST: f64 = 0.02;

/// The scans that a cloud without a known camera stands for, each with an estimated camera `distance` metres from the
/// middle of its points: one where the cloud faces one camera, whose normals are then turned towards it; else as many as
/// explain the points. The normals point outwards before ([`geometry::orient_normals_consistent`]). `measured` are the points
/// before thinning, or some of them at random.
pub fn estimated_scans(cloud: &mut PointCloud, measured: &[Point3<f64>], distance: f64, spacing: f64) -> Vec<PastScan> {
    let middle = middle(&cloud.points);
    let sum: Vector3<f64> = cloud.normals.iter().filter_map(|n| n.try_normalize(0.0)).sum();
    let Some(mean) = sum.try_normalize(1e-9) else { return Vec::new() };
    let samples = Samples::of(cloud, measured, spacing, usize::MAX);
    let told = samples.direction(distance);
    let trust = told.as_ref().map_or(Trust { misfit: 1.0, against_other_side: 1.0, span: 0.0 }, |fit| fit.trust);
    let told = told.filter(|fit| fit.trust.misfit < MISFIT).map(|fit| middle + distance * fit.direction);
    // Evened out before, it has no density to tell by: then its normals do, and its edges.
    let eye = told.filter(|eye| unhidden(cloud, eye, spacing) >= UNHIDDEN).or_else(|| {
        let eye = middle + distance * mean;
        let facing = cloud.points.iter().zip(&cloud.normals).filter(|(p, n)| n.dot(&(eye - *p)) > 0.0).count();
        let from_behind = || turning_away(&samples.edges, &mean) < 0.0;
        let is_one = facing as f64 >= FACING * cloud.len() as f64;
        is_one.then(|| if from_behind() { middle - distance * mean } else { eye })
    });
    if let Some(eye) = eye {
        orient_normals_toward(cloud, &eye);
        return vec![scan(eye, cloud.points.clone(), trust)];
    }
    merged_scans(cloud, &middle, distance, spacing, trust)
}

/// What a scan was sampled like: points with the density around them, and those at an edge.
pub(crate) struct Samples<'a> {
    inner: Vec<Sample<'a>>,
    edges: Vec<EdgePoint>,
    middle: Point3<f64>,
}

/// A point, its normal, and how many measured points are around it.
type Sample<'a> = (&'a Point3<f64>, Vector3<f64>, f64);

impl<'a> Samples<'a> {
    /// At most `asked` points of the cloud, about evenly spaced in their order.
    pub(crate) fn of(cloud: &'a PointCloud, measured: &[Point3<f64>], spacing: f64, asked: usize) -> Self {
        let share = (cloud.len() as f64 / measured.len().max(1) as f64).sqrt().min(1.0);
        let radius = REACH * spacing * share.max(0.25);
        let grid = NeighborGrid::new(measured, radius);
        let around = |p: &Point3<f64>| {
            let (mut count, mut offset) = (0usize, Vector3::zeros());
            grid.for_each_within(p, radius, |i| {
                count += 1;
                offset += measured[i] - p;
            });
            (count >= 6).then_some((count as f64, offset))
        };
        let points = cloud.points.par_iter().zip(&cloud.normals).step_by(cloud.len().div_ceil(asked).max(1));
        let look = |(p, n): (&'a Point3<f64>, &Vector3<f64>)| Some((p, n.try_normalize(0.0)?, around(p)?));
        let all: Vec<_> = points.filter_map(look).collect();
        let is_edge = |(count, offset): &(f64, Vector3<f64>)| offset.norm() >= EDGE * radius * count;
        let (edges, inner): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, _, around)| is_edge(around));
        Self {
            inner: inner.into_iter().map(|(p, n, (count, _))| (p, n, count)).collect(),
            edges: edges.into_iter().map(|(_, normal, (_, inward))| EdgePoint { normal, inward }).collect(),
            middle: middle(&cloud.points),
        }
    }

    /// The direction to the camera by how densely it sampled the surface: pixels lie as far apart as the cosine between
    /// normal and ray says, so that density / f^2 * z^2 = |n . d|. Solved for d by least squares over all points but those
    /// at an edge: squared first, where the sign of normals does not matter, then with all of them turned to the camera.
    /// From which side, the density tells, and the edges.
    pub(crate) fn direction(&self, distance: f64) -> Option<Told> {
        let axis = squared_direction(self.inner.iter().map(|(_, n, density)| (*n, *density)))?;
        let [a, b] = [axis, -axis].map(|start| fitted(&self.inner, &self.middle, &start, distance));
        let (a, b) = (a?, b?);
        let (better, worse) = if a.trimmed <= b.trimmed { (a, b) } else { (b, a) };
        let by_density = better.trimmed / worse.trimmed.max(f64::MIN_POSITIVE);
        let evidence = EDGES * turning_away(&self.edges, &better.direction) - by_density.ln();
        let (taken, by_density) = if evidence < 0.0 { (worse, by_density.recip()) } else { (better, by_density) };
        let trust = Trust { misfit: taken.misfit, against_other_side: (-evidence.abs()).exp(), span: self.span() };
        Some(Told { direction: taken.direction, by_density, trust })
    }

    /// [`Trust::span`].
    fn span(&self) -> f64 {
        let mut normals: Vec<&Vector3<f64>> = self.inner.iter().map(|(_, n, _)| n).collect();
        let squares = normals.iter().map(|n| *n * n.transpose()).sum::<Matrix3<f64>>();
        let least = squares.symmetric_eigenvalues().min().max(0.0) / normals.len().max(1) as f64;
        normals = normals.into_iter().step_by(self.inner.len().div_ceil(COMPARED).max(1)).collect();
        let alike = |a: &Vector3<f64>| normals.iter().filter(|b| a.dot(b).abs() > ALIKE).count();
        let pairs = normals.iter().map(|n| alike(n)).sum::<usize>();
        least * (normals.len() * normals.len()) as f64 / pairs.max(1) as f64
    }

    /// Root of the share of the density that a camera at `eye` does not explain, in [0, 1].
    pub(crate) fn misfit_from(&self, eye: &Point3<f64>) -> f64 {
        unexplained(&densities(&self.inner, eye))
    }
}

/// A camera's direction, estimated from the density.
pub(crate) struct Told {
    pub(crate) direction: Vector3<f64>,
    /// What it leaves unexplained of the density of undisturbed points, over what the best camera on the other side does.
    pub(crate) by_density: f64,
    pub(crate) trust: Trust,
}

/// A camera's direction, and the root of the share of density that it does not explain: of all points, and without the worst.
struct Fit {
    direction: Vector3<f64>,
    misfit: f64,
    trimmed: f64,
}

/// The least-squares direction from a first one.
fn fitted(found: &[Sample], middle: &Point3<f64>, start: &Vector3<f64>, distance: f64) -> Option<Fit> {
    let mut direction = *start;
    for _ in 0..3 {
        let eye = middle + distance * direction;
        let (mut normals, mut told) = (Matrix3::zeros(), Vector3::zeros());
        for (p, n, density) in found {
            let ray = eye - *p;
            normals += n * n.transpose();
            told += n * (n.dot(&ray).signum() * density * ray.norm_squared());
        }
        // What the normals do not span stays as it was.
        let weight = 0.01 * normals.trace();
        let scale = told.norm() / normals.trace().max(f64::MIN_POSITIVE);
        let solved = (normals + Matrix3::identity() * weight).try_inverse()? * (told + direction * (weight * scale));
        direction = solved.try_normalize(1e-12)?;
    }
    let mut told = densities(found, &(middle + distance * direction));
    let misfit = unexplained(&told);
    for _ in 0..2 {
        let scale = told.iter().map(|(c, d)| c * d).sum::<f64>() / told.iter().map(|(c, _)| c * c).sum::<f64>();
        let error = |(cosine, density): &(f64, f64)| (density - scale * cosine).abs();
        told.sort_by(|a, b| error(a).total_cmp(&error(b)));
        told.truncate((told.len() as f64 * (1.0 - TRIMMED)) as usize);
    }
    Some(Fit { direction, misfit, trimmed: unexplained(&told) })
}

/// The density that a camera at `eye` has at each, but for a factor, and the one found.
fn densities(found: &[Sample], eye: &Point3<f64>) -> Vec<(f64, f64)> {
    let told = |(p, n, density): &Sample| {
        let ray = eye - *p;
        (n.dot(&ray).abs() / ray.norm().powi(3), *density)
    };
    found.iter().map(told).collect()
}

/// Root of the share of the second numbers' squares that no multiple of the first explains.
fn unexplained(pairs: &[(f64, f64)]) -> f64 {
    let sum = |f: fn(&(f64, f64)) -> f64| pairs.iter().map(f).sum::<f64>();
    let (both, squares) = (sum(|(a, b)| a * b), sum(|(a, _)| a * a) * sum(|(_, b)| b * b));
    (1.0 - (both * both / squares.max(f64::MIN_POSITIVE)).min(1.0)).sqrt()
}

/// The axis d that fits density^2 ~ (n . d)^2 best: the largest eigenvector of the symmetric D that fits density^2 ~ n D n.
fn squared_direction(found: impl Iterator<Item = (Vector3<f64>, f64)>) -> Option<Vector3<f64>> {
    let (mut squares, mut told) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for (n, density) in found {
        let [x, y, z] = n.into();
        let row = SVector::<f64, 6>::from([x * x, y * y, z * z, 2.0 * x * y, 2.0 * x * z, 2.0 * y * z]);
        squares += row * row.transpose();
        told += row * (density * density);
    }
    // Towards the identity, which says nothing of the axis, where the normals do not span all.
    let weight = 1e-3 * squares.trace();
    let d = (squares + SMatrix::<f64, 6, 6>::identity() * weight).try_inverse()? * told;
    let matrix = Matrix3::new(d[0], d[3], d[4], d[3], d[1], d[5], d[4], d[5], d[2]);
    let eigen = matrix.symmetric_eigen();
    let largest = eigen.eigenvalues.imax();
    eigen.eigenvectors.column(largest).into_owned().try_normalize(1e-12)
}

/// Share of the points that no other hides from `eye`, in cells of three spacings.
pub(crate) fn unhidden(cloud: &PointCloud, eye: &Point3<f64>, spacing: f64) -> f64 {
    let middle = middle(&cloud.points);
    let camera = View { target: middle, position: *eye }.world_from_camera().inverse();
    let (cell, away) = (3.0 * spacing, (eye - middle).norm());
    let place = |p: &Point3<f64>| {
        let p = camera * p;
        let scale = away / (p.z.max(0.1 * away) * cell);
        (<(i64, i64)>::from([p.x, p.y].map(|x| (x * scale).floor() as i64)), p.z)
    };
    let mut front: FxHashMap<_, f64> = FxHashMap::default();
    for p in &cloud.points {
        let (at, depth) = place(p);
        front.entry(at).and_modify(|d| *d = d.min(depth)).or_insert(depth);
    }
    let seen = |(p, n): &(&Point3<f64>, &Vector3<f64>)| {
        let (at, depth) = place(p);
        let ray = eye - *p;
        let cosine = (n.dot(&ray).abs() / (n.norm() * ray.norm()).max(f64::MIN_POSITIVE)).clamp(0.15, 1.0);
        // A slope falls within a cell by its tangent.
        depth <= front[&at] + cell * (1.0 + 1.5 * (1.0 - cosine * cosine).sqrt() / cosine)
    };
    cloud.points.iter().zip(&cloud.normals).filter(seen).count() as f64 / cloud.len().max(1) as f64
}

fn scan(position: Point3<f64>, points: Vec<Point3<f64>>, trust: Trust) -> PastScan {
    let view = View { target: middle(&points), position };
    PastScan {
        world_from_camera: view.world_from_camera(),
        seen: Seen::Points(points),
        pose: CameraPose::Estimated(trust),
        veil: None,
    }
}

fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64)
}

/// Greedily the direction from which most of the points not yet explained are seen.
fn merged_scans(cloud: &PointCloud, middle: &Point3<f64>, distance: f64, spacing: f64, trust: Trust) -> Vec<PastScan> {
    let normals: Vec<Vector3<f64>> = cloud.normals.iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect();
    // Some of the cloud's own normals, so that the answer moves with it.
    let step = normals.len().div_ceil(DIRECTIONS).max(1);
    let directions: Vec<Vector3<f64>> = normals.iter().step_by(step).copied().filter(|n| n.norm() > 0.5).collect();
    let aside = |d: &Vector3<f64>| directions.iter().map(|other| d.cross(other)).find(|c| c.norm() > 0.1);
    let look = |d: &Vector3<f64>| match aside(d) {
        Some(u) => visible(cloud, &normals, middle, [d, &u.normalize()], 3.0 * spacing),
        None => Vec::new(),
    };
    let seen: Vec<Vec<usize>> = directions.par_iter().map(look).collect();
    let mut open = vec![true; cloud.len()];
    let mut left = cloud.len() as f64;
    let mut scans = Vec::new();
    while scans.len() < MOST && left > (1.0 - EXPLAINED) * cloud.len() as f64 {
        let explains =
            |k: usize| seen[k].iter().filter(|&&i| open[i]).map(|&i| normals[i].dot(&directions[k])).sum::<f64>();
        let values: Vec<f64> = (0..directions.len()).map(explains).collect();
        let Some(best) = (0..directions.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])) else { break };
        if values[best] < LEAST * cloud.len() as f64 {
            break;
        }
        for &i in &seen[best] {
            left -= f64::from(u8::from(std::mem::take(&mut open[i])));
        }
        let points = seen[best].iter().map(|&i| cloud.points[i]).collect();
        scans.push(scan(middle + distance * directions[best], points, trust));
    }
    scans
}

/// Indices of the points that face a direction (the second is at a right angle to it) and are not behind others, in
/// cells of this width, metres.
fn visible(
    cloud: &PointCloud,
    normals: &[Vector3<f64>],
    middle: &Point3<f64>,
    [d, u]: [&Vector3<f64>; 2],
    cell: f64,
) -> Vec<usize> {
    let v = d.cross(u);
    let place = |p: &Point3<f64>| {
        let r = p - middle;
        let at: (i64, i64) = [r.dot(u), r.dot(&v)].map(|x| (x / cell).floor() as i64).into();
        (at, r.dot(d))
    };
    let mut front: FxHashMap<_, f64> = FxHashMap::default();
    for p in &cloud.points {
        let (at, height) = place(p);
        front.entry(at).and_modify(|h| *h = h.max(height)).or_insert(height);
    }
    let seen = |&i: &usize| {
        let (at, height) = place(&cloud.points[i]);
        normals[i].dot(d) > GRAZING && height >= front[&at] - 2.0 * cell
    };
    (0..cloud.len()).filter(seen).collect()
}

#[cfg(test)]
mod tests;
