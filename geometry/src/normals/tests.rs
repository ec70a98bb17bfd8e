use super::*;
use crate::golden::Golden;
use nalgebra::SymmetricEigen;
use proptest::prelude::*;

fn normals(points: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    estimate_normals(points, &Neighborhoods::of(points, 20), 20)
}

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
    assert!(normals(&plane).iter().all(|n| n.z.abs() > 1.0 - 1e-12));
    let line: Vec<_> = (0..30).map(|i| Point3::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
    let along = Vector3::new(1.0, 2.0, 0.0).normalize();
    for n in normals(&line) {
        assert!((n.norm() - 1.0).abs() < 1e-12 && n.dot(&along).abs() < 1e-6, "{n}");
    }
    for n in normals(&[Point3::new(1.0, f64::NAN, 0.0), Point3::origin(), Point3::origin()]) {
        assert_eq!(n, Vector3::z());
    }
    assert!(normals(&[]).is_empty());
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
    let mut cloud = PointCloud { normals: normals(&points), points };
    orient_normals_toward(&mut cloud, &Point3::new(5.0, 0.0, 0.0));
    for (p, n) in cloud.points.iter().zip(&cloud.normals) {
        assert!(n.dot(&p.coords) > 0.99, "{p} {n}");
    }
}

#[test]
fn a_larger_table_gives_the_same_normals() {
    let points: Vec<_> = (0..400).map(f64::from).map(|i| Point3::new(i.sin(), i.cos(), 0.01 * i)).collect();
    let near = Neighborhoods::of(&points, 30);
    assert_eq!(estimate_normals(&points, &near, 20), normals(&points));
    assert_ne!(estimate_normals(&points, &near, 30), normals(&points));
    assert_eq!(estimate_normals(&points[..1], &Neighborhoods::of(&points[..1], 30), 20).len(), 1);
}

#[test]
fn normals_equal_those_of_open3d() {
    let golden = Golden::open("scans.safetensors");
    let mut turned = 0;
    for object in ["sphere", "torus"] {
        let name = |field: &str| format!("{object}.{field}");
        let expected = golden.cloud(&name("scan"));
        let camera = golden.points(&name("camera"))[0];
        let mut ours = PointCloud { normals: normals(&expected.points), points: expected.points };
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
            let normals = normals(&expected.points);
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
