//! Polygons into triangles: a fan where that covers the polygon once, else by ears. Own code: a page, with a bound on the
//! work that one file can ask for.

use super::CornerData;
use nalgebra::{Vector2, Vector3};

/// Tests of a corner against an ear that one file may ask for: some tenths of a second.
const MOST_TESTS: u64 = 100_000_000;

/// What the polygons of a file have asked for.
#[derive(Default)]
pub(super) struct Work {
    tests: u64,
    /// Polygons that cross themselves: a triangle is turned the other way.
    pub(super) crossing: usize,
}

/// Triangles of a polygon, as indices of its corners, turned as it is; `None` where it asks for too much work.
pub(super) fn triangulate(corners: &[CornerData], work: &mut Work) -> Option<Vec<[usize; 3]>> {
    let n = corners.len();
    let fan = || (2..n).map(|k| [0, k - 1, k]).collect();
    if n <= 3 || corners.iter().flat_map(|(p, _)| p).any(|x| !x.is_finite()) {
        return Some(fan());
    }
    let origin = Vector3::from(corners[0].0);
    let at: Vec<Vector3<f64>> = corners.iter().map(|(p, _)| Vector3::from(*p) - origin).collect();
    let normal: Vector3<f64> = (2..n).map(|k| at[k - 1].cross(&at[k])).sum();
    let Some(normal) = normal.try_normalize(0.0) else { return Some(fan()) };
    if covers_once(&at, &normal) {
        return Some(fan());
    }
    ears(&flat(&at, &normal), work)
}

/// Whether the fan from the first corner covers the polygon once: its rays turn one way, and less than all around.
fn covers_once(at: &[Vector3<f64>], normal: &Vector3<f64>) -> bool {
    let mut around = 0.0;
    (2..at.len()).all(|k| {
        let (a, b) = (at[k - 1], at[k]);
        let sine = a.cross(&b).dot(normal);
        around += sine.atan2(a.dot(&b));
        sine >= -1e-12 * a.norm() * b.norm() && around < std::f64::consts::TAU
    })
}

/// The polygon seen from its front, counterclockwise.
fn flat(at: &[Vector3<f64>], normal: &Vector3<f64>) -> Vec<Vector2<f64>> {
    let mut aside = Vector3::zeros();
    aside[normal.iamin()] = 1.0;
    let u = normal.cross(&aside).normalize();
    let v = normal.cross(&u);
    at.iter().map(|p| Vector2::new(p.dot(&u), p.dot(&v))).collect()
}

/// Twice the signed area of a triangle.
fn turn(a: &Vector2<f64>, b: &Vector2<f64>, c: &Vector2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

/// Cuts corners off whose triangle no other corner lies in, until three are left.
fn ears(at: &[Vector2<f64>], work: &mut Work) -> Option<Vec<[usize; 3]>> {
    let n = at.len();
    let mut next: Vec<usize> = (1..n).chain([0]).collect();
    let mut before: Vec<usize> = [n - 1].into_iter().chain(0..n - 1).collect();
    // Only corners where the outline turns back can lie in an ear.
    let turns_back = |i: usize, before: &[usize], next: &[usize]| turn(&at[before[i]], &at[i], &at[next[i]]) <= 0.0;
    let mut back: Vec<usize> = (0..n).filter(|&i| turns_back(i, &before, &next)).collect();
    let mut is_back = vec![false; n];
    back.iter().for_each(|&i| is_back[i] = true);

    let mut triangles = Vec::with_capacity(n - 2);
    let (mut here, mut left, mut in_vain) = (0, n, 0);
    let mut crosses = false;
    while left > 3 {
        let (a, b) = (before[here], next[here]);
        let (pa, p, pb) = (&at[a], &at[here], &at[b]);
        let area = turn(pa, p, pb);
        let mut tests = 0;
        let inside = |&i: &usize| {
            tests += 1;
            let q = &at[i];
            is_back[i]
                && q != pa
                && q != p
                && q != pb
                && turn(pa, p, q) >= 0.0
                && turn(p, pb, q) >= 0.0
                && turn(pb, pa, q) >= 0.0
        };
        // A corner without area goes in any case; after a round in vain, any that turns the right way.
        let is_ear = area == 0.0 || area > 0.0 && !back.iter().any(inside) || in_vain > left && area > 0.0;
        work.tests += tests + 1;
        if work.tests > MOST_TESTS {
            return None;
        }
        if is_ear || in_vain > 2 * left {
            crosses |= area < 0.0;
            triangles.push([a, here, b]);
            (next[a], before[b]) = (b, a);
            is_back[here] = false;
            [a, b].into_iter().for_each(|i| is_back[i] &= turns_back(i, &before, &next));
            left -= 1;
            in_vain = 0;
            if left % 64 == 0 {
                back.retain(|&i| is_back[i]);
            }
            here = before[a];
        } else {
            in_vain += 1;
            here = b;
        }
    }
    let last = [before[here], here, next[here]];
    crosses |= turn(&at[last[0]], &at[last[1]], &at[last[2]]) < -1e-12 * (at[last[1]] - at[last[0]]).norm_squared();
    triangles.push(last);
    work.crossing += usize::from(crosses);
    Some(triangles)
}

#[cfg(test)]
mod tests;
