//! Line scanners: each point was measured from abreast of it, on a straight path.

use geometry::PointCloud;
use nalgebra::Point3;

/// The place on a straight path that is nearest to a point.
pub(super) fn abreast([first, last]: &[Point3<f64>; 2], point: &Point3<f64>) -> Point3<f64> {
    let along = last - first;
    let share = (point - first).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
    first + along * share
}

/// Pieces that a line scanner's cloud is cut into, each taken for a scan from the middle of its part of the path: in an object as long
/// as the distance to it, rays are then off by up to 3 degrees.
const PIECES: usize = 9;

/// The pieces of a line scanner's cloud with where each was seen from, the middle one first: that stands for all.
pub(super) fn pieces(path: &[Point3<f64>; 2], points: &[Point3<f64>]) -> Vec<(Point3<f64>, Vec<Point3<f64>>)> {
    let [first, last] = path;
    let along = (last - first).try_normalize(0.0).unwrap_or_default();
    let at = |p: &Point3<f64>| (p - first).dot(&along);
    let low = points.iter().map(at).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(at).fold(f64::NEG_INFINITY, f64::max);
    let width = ((high - low) / PIECES as f64).max(f64::MIN_POSITIVE);
    let mut pieces: Vec<(Point3<f64>, Vec<Point3<f64>>)> =
        (0..PIECES).map(|i| (first + along * (low + (i as f64 + 0.5) * width), Vec::new())).collect();
    for p in points {
        let piece = ((at(p) - low) / width) as usize;
        pieces[piece.min(PIECES - 1)].1.push(*p);
    }
    pieces.swap(0, PIECES / 2);
    pieces.retain(|(_, points)| !points.is_empty());
    pieces
}

/// Turns each normal to where the scanner was abreast of its point.
pub(super) fn orient_normals_abreast(cloud: &mut PointCloud, path: &[Point3<f64>; 2]) {
    for (p, n) in cloud.points.iter().zip(&mut cloud.normals) {
        if n.dot(&(abreast(path, p) - p)) < 0.0 {
            *n = -*n;
        }
    }
}

#[cfg(test)]
mod tests;
