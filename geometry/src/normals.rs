//! Surface normals by principal components of neighbours.

use crate::PointCloud;
use crate::neighbors::Neighborhoods;
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// Unit normals, each up to its sign: direction of least spread of the `neighbors` nearest points, the point itself
/// included (docs/method.md: 20), of the neighbourhoods of so many points or more. Where the neighbours do not span a plane (under three points, a line, one spot) the
/// answer is some unit vector perpendicular to them, (0, 0, 1) if nothing is known; so too for non-finite points.
///
/// ```
/// use geometry::{Neighborhoods, PointCloud, estimate_normals, orient_normals_toward};
/// use nalgebra::{Point3, Vector3};
///
/// let points: Vec<_> = (0..400).map(|i| Point3::new(0.01 * f64::from(i % 20), 0.01 * f64::from(i / 20), 0.0)).collect();
/// let normals = estimate_normals(&points, &Neighborhoods::of(&points, 30), 30);
/// let mut cloud = PointCloud { points, normals };
/// orient_normals_toward(&mut cloud, &Point3::new(0.1, 0.1, 1.2));
/// assert!(cloud.normals.iter().all(|n| (n - Vector3::z()).norm() < 1e-6));
/// ```
pub fn estimate_normals(points: &[Point3<f64>], near: &Neighborhoods, neighbors: usize) -> Vec<Vector3<f64>> {
    let k = neighbors.min(near.k());
    let normal = |i: usize| least_spread(&covariance(points, &points[i], &near.ids(i)[..k]));
    (0..points.len()).into_par_iter().map(normal).collect()
}

/// Flips each normal to point towards the viewpoint.
pub fn orient_normals_toward(cloud: &mut PointCloud, viewpoint: &Point3<f64>) {
    for (n, p) in cloud.normals.iter_mut().zip(&cloud.points) {
        if n.dot(&(viewpoint - p)) < 0.0 {
            *n = -*n;
        }
    }
}

/// Flips each normal to have no component against `direction` (from the target to the camera): one direction for the
/// whole scan, as published.
pub fn orient_normals_along(cloud: &mut PointCloud, direction: &Vector3<f64>) {
    for n in &mut cloud.normals {
        if n.dot(direction) < 0.0 {
            *n = -*n;
        }
    }
}

/// Scatter of the neighbours around their mean, relative to `center` for precision far from the origin.
fn covariance(points: &[Point3<f64>], center: &Point3<f64>, ids: &[u32]) -> Matrix3<f64> {
    let (mut sum, mut products) = ([0.0; 3], [0.0; 6]);
    let mut count = 0.0;
    for &id in ids.iter().filter(|&&id| id != u32::MAX) {
        let [x, y, z] = (points[id as usize] - center).into();
        for (s, v) in sum.iter_mut().zip([x, y, z]) {
            *s += v;
        }
        for (s, v) in products.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *s += v;
        }
        count += 1.0;
    }
    if count == 0.0 {
        return Matrix3::zeros();
    }
    let [mx, my, mz] = sum.map(|s| s / count);
    let [xx, xy, xz, yy, yz, zz] = products.map(|s| s / count);
    let (xx, xy, xz) = (xx - mx * mx, xy - mx * my, xz - mx * mz);
    let (yy, yz, zz) = (yy - my * my, yz - my * mz, zz - mz * mz);
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// Unit eigenvector of the smallest eigenvalue of a symmetric positive matrix, in closed form.
fn least_spread(a: &Matrix3<f64>) -> Vector3<f64> {
    let scale = a.amax();
    if scale <= 0.0 || !scale.is_finite() {
        return Vector3::z();
    }
    let a = a / scale;
    // Trigonometric solution of the characteristic polynomial.
    let mean = a.trace() / 3.0;
    let shifted = a - Matrix3::from_diagonal_element(mean);
    let p = (shifted.norm_squared() / 6.0).sqrt();
    if p < 1e-14 {
        return Vector3::z();
    }
    let half_determinant = (shifted / p).determinant() / 2.0;
    let angle = half_determinant.clamp(-1.0, 1.0).acos() / 3.0;
    let smallest = mean + 2.0 * p * (angle + 2.0 * std::f64::consts::FRAC_PI_3).cos();
    // Rows of a - smallest span the plane of the other two eigenvectors.
    let m = a - Matrix3::from_diagonal_element(smallest);
    let rows = [0, 1, 2].map(|i| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]));
    let crosses = [rows[0].cross(&rows[1]), rows[1].cross(&rows[2]), rows[2].cross(&rows[0])];
    let longest =
        |v: [Vector3<f64>; 3]| v.into_iter().fold(v[0], |l, w| if w.norm_squared() > l.norm_squared() { w } else { l });
    let normal = longest(crosses);
    if normal.norm() > 1e-12 {
        return normal.normalize();
    }
    // A line: anything perpendicular to it.
    let along = longest(rows);
    along.cross(&axis_least_aligned(&along)).try_normalize(0.0).unwrap_or_else(Vector3::z)
}

fn axis_least_aligned(v: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[v.iamin()] = 1.0;
    axis
}

#[cfg(test)]
mod tests;
