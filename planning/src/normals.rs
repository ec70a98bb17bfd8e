//! The normals of a scan: those that come with it are held against its points and its camera.

use crate::scan::{NORMAL_NEIGHBORS, neighborhoods};
use geometry::{Neighborhoods, PointCloud, estimate_normals};
use nalgebra::Vector3;

/// Cosine above which a given normal agrees with the surface, and the share of them that must: one in three agrees by
/// chance.
const AGREES: f64 = 0.7;
const LEAST_AGREEING: f64 = 0.4;
/// The same share where all given normals are alike, as a flat sheet's are and those of a program that knows none.
const LEAST_AGREEING_ALIKE: f64 = 0.9;
/// Lengths between which a given normal is kept as it is; averages are shorter than one.
const LENGTHS: std::ops::Range<f64> = 0.5..1.05;

/// How the given normals were used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Settled {
    /// Whether the signs are known from them.
    pub(crate) signed: bool,
    /// They are few, or do not stand on the surface: all are estimated.
    pub(crate) ignored: bool,
    /// Missing ones, estimated.
    pub(crate) estimated: usize,
}

/// Gives every point a normal: the given one where it can be one, else the estimated. `near` are the neighbours of the
/// points, where they are known.
pub(crate) fn settle(cloud: &mut PointCloud, near: Option<&Neighborhoods>) -> Settled {
    let found;
    let neighbors = match near {
        Some(near) => near,
        None => {
            found = Neighborhoods::of(&cloud.points, NORMAL_NEIGHBORS);
            &found
        }
    };
    let estimated = estimate_normals(&cloud.points, neighbors, NORMAL_NEIGHBORS);
    let known = |n: &Vector3<f64>| n.iter().all(|x| x.is_finite()) && n.norm() > 0.0 && n.norm().is_finite();
    let given = if cloud.has_normals() { cloud.normals.iter().filter(|n| known(n)).count() } else { 0 };
    if 2 * given < cloud.len().max(1) {
        cloud.normals = estimated;
        return Settled { ignored: given > 0, ..Default::default() };
    }
    for n in &mut cloud.normals {
        if known(n) && !LENGTHS.contains(&n.norm()) {
            *n = n.normalize();
        }
    }
    let mut unlike = cloud.normals.iter().filter(|n| known(n));
    let first = unlike.next().copied().unwrap_or_default();
    let alike = unlike.all(|n| (n - first).norm() < 1e-6);
    let agrees = |(n, e): &(&Vector3<f64>, &Vector3<f64>)| known(n) && n.dot(e).abs() > AGREES * n.norm();
    let agreeing = cloud.normals.iter().zip(&estimated).filter(agrees).count();
    let least = if alike { LEAST_AGREEING_ALIKE } else { LEAST_AGREEING };
    if (agreeing as f64) < least * given as f64 {
        cloud.normals = estimated;
        return Settled { ignored: true, ..Default::default() };
    }
    let missing: Vec<usize> = (0..cloud.len()).filter(|&i| !known(&cloud.normals[i])).collect();
    if !missing.is_empty() {
        fill(cloud, &missing, &estimated, near);
    }
    Settled { signed: true, estimated: missing.len(), ..Default::default() }
}

/// Missing normals as estimated, with the sign of those given nearby.
fn fill(cloud: &mut PointCloud, missing: &[usize], estimated: &[Vector3<f64>], near: Option<&Neighborhoods>) {
    let found;
    let near = match near {
        Some(near) => near,
        None => {
            found = neighborhoods(&cloud.points);
            &found
        }
    };
    let finite = |n: &Vector3<f64>| if n.iter().all(|x| x.is_finite()) { *n } else { Vector3::zeros() };
    let filled: Vec<Vector3<f64>> = missing
        .iter()
        .map(|&i| {
            let others = near.ids(i).iter().filter(|&&j| j != u32::MAX);
            let nearby: Vector3<f64> = others.map(|&j| finite(&cloud.normals[j as usize])).sum();
            if estimated[i].dot(&nearby) < 0.0 { -estimated[i] } else { estimated[i] }
        })
        .collect();
    missing.iter().zip(filled).for_each(|(&i, normal)| cloud.normals[i] = normal);
}

#[cfg(test)]
mod tests;
