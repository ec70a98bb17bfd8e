//! Surface normals by principal components of neighbours.

use crate::PointCloud;
use crate::neighbors::{NeighborGrid, Neighborhoods};
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// Unit normals, each up to its sign: direction of least spread of the `neighbors` nearest points, the point itself
/// included (docs/method.md: 20). Where the neighbours do not span a plane (under three points, a line, one spot) the
/// answer is some unit vector perpendicular to them, (0, 0, 1) if nothing is known; so too for non-finite points.
pub fn estimate_normals(points: &[Point3<f64>], neighbors: usize) -> Vec<Vector3<f64>> {
    let near = NeighborGrid::new(points, 0.0).neighborhoods(points.len(), neighbors);
    (0..points.len()).map(|i| least_spread(&covariance(points, &points[i], near.ids(i)))).collect()
}

/// [`estimate_normals`] on all cores, where neighbourhoods of so many points, or more, are already known.
pub fn normals_of(points: &[Point3<f64>], near: &Neighborhoods, neighbors: usize) -> Vec<Vector3<f64>> {
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
mod tests {
    use super::*;
    use crate::golden::Golden;
    use nalgebra::SymmetricEigen;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn closed_form_equals_the_eigen_decomposition(v in proptest::collection::vec(-1.0f64..1.0, 9), flat in 1e-3f64..1.0) {
            let mut m = Matrix3::from_column_slice(&v);
            m.row_mut(2).scale_mut(flat);
            let a = m.transpose() * m;
            let eigen = SymmetricEigen::new(a);
            let mut order = [0, 1, 2];
            order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
            let gap = (eigen.eigenvalues[order[1]] - eigen.eigenvalues[order[0]]) / eigen.eigenvalues[order[2]];
            prop_assume!(gap > 1e-4);
            let cosine = least_spread(&a).dot(&eigen.eigenvectors.column(order[0])).abs();
            prop_assert!(cosine > 1.0 - 1e-9, "cosine {cosine}, gap {gap}");
        }
    }

    #[test]
    fn planes_lines_and_spots_give_unit_normals() {
        let plane: Vec<_> = (0..100).map(|i| Point3::new(f64::from(i % 10), f64::from(i / 10), 7.0)).collect();
        assert!(estimate_normals(&plane, 20).iter().all(|n| n.z.abs() > 1.0 - 1e-12));
        let line: Vec<_> = (0..30).map(|i| Point3::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
        let along = Vector3::new(1.0, 2.0, 0.0).normalize();
        for n in estimate_normals(&line, 20) {
            assert!((n.norm() - 1.0).abs() < 1e-12 && n.dot(&along).abs() < 1e-6, "{n}");
        }
        for n in estimate_normals(&[Point3::new(1.0, f64::NAN, 0.0), Point3::origin(), Point3::origin()], 20) {
            assert_eq!(n, Vector3::z());
        }
        assert!(estimate_normals(&[], 20).is_empty());
    }

    #[test]
    fn a_sphere_points_outward_when_seen_from_outside() {
        let points: Vec<_> = (0..2000)
            .map(|i| {
                let (z, phi) = (1.0 - (f64::from(i) + 0.5) / 1000.0, f64::from(i) * 2.399_963);
                let r = (1.0 - z * z).sqrt();
                Point3::new(r * phi.cos(), r * phi.sin(), z)
            })
            .filter(|p| p.x > 0.3)
            .collect();
        let mut cloud = PointCloud { normals: estimate_normals(&points, 20), points };
        orient_normals_toward(&mut cloud, &Point3::new(5.0, 0.0, 0.0));
        for (p, n) in cloud.points.iter().zip(&cloud.normals) {
            assert!(n.dot(&p.coords) > 0.99, "{p} {n}");
        }
    }

    #[test]
    fn a_larger_table_gives_the_same_normals() {
        let points: Vec<_> = (0..400).map(f64::from).map(|i| Point3::new(i.sin(), i.cos(), 0.01 * i)).collect();
        let near = NeighborGrid::new(&points, 0.0).neighborhoods(points.len(), 30);
        assert_eq!(normals_of(&points, &near, 20), estimate_normals(&points, 20));
        assert_ne!(normals_of(&points, &near, 30), estimate_normals(&points, 20));
        assert_eq!(normals_of(&points[..1], &NeighborGrid::new(&points[..1], 0.0).neighborhoods(1, 30), 20).len(), 1);
    }

    #[test]
    fn normals_equal_those_of_open3d() {
        let golden = Golden::open("scans.safetensors");
        let mut turned = 0;
        for object in ["sphere", "torus"] {
            let name = |field: &str| format!("{object}.{field}");
            let expected = golden.cloud(&name("scan"));
            let camera = golden.points(&name("camera"))[0];
            let mut ours = PointCloud { normals: estimate_normals(&expected.points, 20), points: expected.points };
            orient_normals_along(&mut ours, &camera.coords);
            for (a, b) in ours.normals.iter().zip(&expected.normals) {
                assert!((a - b).norm() < 1e-5, "{object}: {a} against {b}");
            }
            let along = ours.normals.clone();
            orient_normals_toward(&mut ours, &camera);
            let flipped: Vec<usize> = (0..along.len()).filter(|&i| along[i].dot(&ours.normals[i]) < 0.0).collect();
            assert_eq!(flipped, golden.indices(&name("turned")), "{object}");
            turned += flipped.len();
        }
        assert!(turned > 0, "the two orientations must differ for this to show anything");
    }

    #[test]
    fn bonus_normals_of_published_scans() {
        let Some(golden) = Golden::bonus("e_depth.safetensors") else { return };
        let (mut total, mut off) = (0, 0);
        for object in ["bunny", "teapot"] {
            for pose in 0..3 {
                let name = |field: &str| format!("{object}.pose{pose}.{field}");
                let expected = golden.cloud(&name("world_points_normals"));
                let [camera, target] = ["camera", "target"].map(|f| golden.points(&name(f))[0]);
                let normals = estimate_normals(&expected.points, 20);
                let mut ours = PointCloud { points: expected.points.clone(), normals };
                orient_normals_along(&mut ours, &(camera - target));
                for (a, b) in ours.normals.iter().zip(&expected.normals) {
                    let cosine = a.dot(b);
                    assert!(cosine > 0.98, "flipped or wrong: {a} against {b}");
                    total += 1;
                    off += usize::from(cosine < 0.9999);
                }
            }
        }
        // The 20th neighbour of a pixel lattice is often tied.
        assert!(off * 100 <= total, "{off} of {total} below 0.9999");
    }
}
