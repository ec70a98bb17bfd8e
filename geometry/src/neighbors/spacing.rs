//! How far the points of a cloud lie apart.

use super::Neighborhoods;
use nalgebra::Point3;

/// Mean distance from each point to the nearest other one, metres: the *grid size* of a first scan (docs/method.md,
/// 'Setting'), by their neighbourhoods of two points or more. 0 for fewer than two points. Non-finite points do not count.
pub fn mean_spacing(points: &[Point3<f64>], neighborhoods: &Neighborhoods) -> f64 {
    if neighborhoods.k() < 2 {
        return 0.0;
    }
    let (mut sum, mut count) = (0.0, 0usize);
    for i in 0..points.len() {
        let Some(&other) = neighborhoods.ids(i).iter().find(|&&id| id as usize != i && id != u32::MAX) else {
            continue;
        };
        sum += (points[i] - points[other as usize]).norm();
        count += 1;
    }
    if count == 0 { 0.0 } else { sum / count as f64 }
}
