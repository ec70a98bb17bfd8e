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
mod tests {
    use super::*;

    /// Sum of the triangles' areas, and whether all are turned like the polygon.
    fn cut(outline: &[[f64; 2]]) -> (f64, bool, Work) {
        let tilt = |p: &[f64; 2]| ([p[0], p[1], 0.3 * p[0] - 0.2 * p[1]], None);
        let corners: Vec<CornerData> = outline.iter().map(tilt).collect();
        let mut work = Work::default();
        let triangles = triangulate(&corners, &mut work).expect("little work");
        assert_eq!(triangles.len(), outline.len() - 2);
        let at = |i: usize| Vector2::from(outline[i]);
        let areas: Vec<f64> = triangles.iter().map(|&[a, b, c]| 0.5 * turn(&at(a), &at(b), &at(c))).collect();
        (areas.iter().map(|a| a.abs()).sum(), areas.iter().all(|&a| a >= 0.0), work)
    }

    fn area(outline: &[[f64; 2]]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        0.5 * outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    #[test]
    fn concave_outlines_are_covered_once() {
        let l = [[2.0, 2.0], [1.9, 2.0], [1.9, 0.1], [0.0, 0.1], [0.0, 0.0], [2.0, 0.0]];
        let arrow = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]];
        let comb: Vec<[f64; 2]> = (0..40)
            .map(|i| [f64::from(i) * 0.1, if i % 2 == 0 { 1.0 } else { 0.1 }])
            .chain([[4.0, 0.0], [0.0, 0.0]])
            .rev()
            .collect();
        // A square with a square hole, joined by a bridge walked both ways.
        let keyhole = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ];
        for outline in [&l[..], &arrow, &comb, &keyhole] {
            for first in 0..outline.len() {
                let turned: Vec<[f64; 2]> = outline[first..].iter().chain(&outline[..first]).copied().collect();
                let (covered, one_way, work) = cut(&turned);
                let expected = area(&turned).abs();
                assert!((covered - expected).abs() < 1e-9, "{turned:?}: {covered} for {expected}");
                assert!(one_way && work.crossing == 0, "{turned:?}");
            }
        }
        assert!((area(&l) - 0.39).abs() < 1e-9);
    }

    #[test]
    fn convex_ones_stay_fans() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| ([x, y, 0.0], None));
        let triangles = triangulate(&square, &mut Work::default());
        assert_eq!(triangles, Some(vec![[0, 1, 2], [0, 2, 3]]));
    }

    #[test]
    fn crossing_outlines_end_and_are_counted() {
        let eight = [[0.0, 0.0], [3.0, 3.0], [3.0, 0.0], [0.0, 2.0]];
        assert_eq!(cut(&eight).2.crossing, 1);
        // A spiral walked out and back in asks for many tests; the work is bounded.
        let wild: Vec<CornerData> =
            (0..30_000).map(f64::from).map(|i| ([(i * 1.7).sin(), (i * 2.9).cos(), 0.0], None)).collect();
        assert_eq!(triangulate(&wild, &mut Work::default()), None, "too much work");
    }
}
