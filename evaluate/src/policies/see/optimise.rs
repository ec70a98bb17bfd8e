//! The view direction with the largest angular clearance from all occluders.
//!
//! The published code solves two small non-linear programs with a wall-clock limit. Both ask for the direction u that
//! minimises max_j C_j.u over unit directions C_j to the occluders: from the minimum-norm point of their convex hull
//! where the origin lies outside it, by local descent from the observing direction where it lies inside.

use nalgebra::{DMatrix, DVector, Vector3};

/// Square root of the published acceptance threshold 1e-3.
const ACCEPT: f64 = 0.031_622_776_601_683_79;

/// Largest cosine between a direction and the occluders.
fn worst(occluders: &[Vector3<f64>], u: &Vector3<f64>) -> f64 {
    occluders.iter().map(|c| c.dot(u)).fold(f64::NEG_INFINITY, f64::max)
}

/// Unit direction from the frontier point to the camera, or `None` where the published optimisers fail.
/// `observed` is the unit direction in which the point was first observed.
pub(super) fn clearest_direction(occluders: &[Vector3<f64>], observed: &Vector3<f64>) -> Option<Vector3<f64>> {
    if occluders.is_empty() {
        return None;
    }
    let nearest = min_norm_point(occluders);
    if nearest.norm() > ACCEPT {
        return Some(-nearest.normalize());
    }
    let mut u = *observed;
    if u.norm() < 0.5 {
        return None;
    }
    let mut value = worst(occluders, &u);
    let mut step = 0.5;
    while step >= 1e-3 {
        let side = if u.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let e0 = u.cross(&side).normalize();
        let e1 = u.cross(&e0);
        let best = (0..12)
            .map(|i| {
                let angle = f64::from(i) * std::f64::consts::TAU / 12.0;
                let trial = (u + step * (angle.cos() * e0 + angle.sin() * e1)).normalize();
                (worst(occluders, &trial), trial)
            })
            .fold((value, u), |best, trial| if trial.0 < best.0 { trial } else { best });
        if best.0 < value {
            (value, u) = best;
        } else {
            step *= 0.5;
        }
    }
    (value > ACCEPT).then_some(u)
}

/// Point of least norm in the convex hull, by Wolfe's algorithm.
pub(super) fn min_norm_point(points: &[Vector3<f64>]) -> Vector3<f64> {
    let mut active = vec![0usize];
    let mut weights = vec![1.0];
    let mut x = points[0];
    for _ in 0..300 {
        let (entering, least) = points
            .iter()
            .enumerate()
            .map(|(i, p)| (i, p.dot(&x)))
            .fold((0, f64::INFINITY), |best, item| if item.1 < best.1 { item } else { best });
        if x.norm_squared() - least <= 1e-12 || active.contains(&entering) {
            break;
        }
        active.push(entering);
        weights.push(0.0);
        loop {
            let Some(affine) = affine_minimizer(points, &active) else {
                active.pop();
                weights.pop();
                return x;
            };
            if affine.iter().all(|&a| a > 1e-12) {
                weights = affine;
                break;
            }
            let theta = weights
                .iter()
                .zip(&affine)
                .filter(|&(_, &a)| a <= 1e-12)
                .map(|(&w, &a)| if w - a > 0.0 { w / (w - a) } else { 0.0 })
                .fold(1.0, f64::min);
            for (w, a) in weights.iter_mut().zip(&affine) {
                *w = theta * a + (1.0 - theta) * *w;
            }
            let keep: Vec<bool> = weights.iter().map(|&w| w > 1e-12).collect();
            let mut kept = keep.iter();
            active.retain(|_| kept.next() == Some(&true));
            let mut kept = keep.iter();
            weights.retain(|_| kept.next() == Some(&true));
            if active.len() <= 1 {
                weights = vec![1.0; active.len()];
                break;
            }
        }
        if active.is_empty() {
            return x;
        }
        x = active.iter().zip(&weights).fold(Vector3::zeros(), |sum, (&i, &w)| sum + points[i] * w);
    }
    x
}

/// Affine coordinates of the point of least norm in the affine hull of the active points.
fn affine_minimizer(points: &[Vector3<f64>], active: &[usize]) -> Option<Vec<f64>> {
    let n = active.len();
    let mut system = DMatrix::zeros(n + 1, n + 1);
    let mut right = DVector::zeros(n + 1);
    right[0] = 1.0;
    for i in 0..n {
        system[(0, i + 1)] = 1.0;
        system[(i + 1, 0)] = 1.0;
        for j in 0..n {
            system[(i + 1, j + 1)] = points[active[i]].dot(&points[active[j]]);
        }
    }
    let solution = system.lu().solve(&right)?;
    let affine: Vec<f64> = solution.iter().skip(1).copied().collect();
    affine.iter().all(|a| a.is_finite()).then_some(affine)
}

#[cfg(test)]
mod tests;
