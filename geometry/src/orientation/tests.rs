use super::*;
use crate::normals::estimate_normals;
use crate::rng::stream;
use nalgebra::Point3;
use rand::RngExt;

fn orient(cloud: &mut PointCloud) {
    orient_normals_consistent(cloud, &Neighborhoods::of(&cloud.points, 11), 10);
}

/// A torus with its outward normals; large radius 3, small radius 1.
fn torus(n: usize) -> PointCloud {
    let mut rng = stream(1, "torus");
    let mut cloud = PointCloud::default();
    for _ in 0..n {
        let (u, v): (f64, f64) =
            (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(0.0..std::f64::consts::TAU));
        let normal = Vector3::new(v.cos() * u.cos(), v.cos() * u.sin(), v.sin());
        cloud.points.push(Point3::new(3.0 * u.cos(), 3.0 * u.sin(), 0.0) + normal);
        cloud.normals.push(normal);
    }
    cloud
}

#[test]
fn a_torus_faces_outwards_also_around_its_hole() {
    let truth = torus(6000);
    let mut cloud = PointCloud {
        normals: estimate_normals(&truth.points, &Neighborhoods::of(&truth.points, 20), 20),
        points: truth.points.clone(),
    };
    orient(&mut cloud);
    let wrong = cloud.normals.iter().zip(&truth.normals).filter(|(a, b)| a.dot(b) < 0.0).count();
    assert_eq!(wrong, 0, "of {}", cloud.len());
}

#[test]
fn separate_pieces_are_signed_separately() {
    let mut truth = torus(3000);
    let mut other = torus(3000);
    other.points.iter_mut().for_each(|p| p.z += 50.0);
    truth.merge(&other);
    let mut rng = stream(2, "flip");
    let mut cloud = truth.clone();
    cloud.normals.iter_mut().for_each(|n| *n *= if rng.random() { 1.0 } else { -1.0 });
    orient(&mut cloud);
    for half in [0..3000, 3000..6000] {
        let agree = half.clone().filter(|&i| cloud.normals[i].dot(&truth.normals[i]) > 0.0).count();
        assert!(agree == 0 || agree == 3000, "{agree} of 3000 agree");
    }
}

#[test]
fn degenerate_clouds_stay() {
    orient(&mut PointCloud::default());
    let points = vec![Point3::new(f64::NAN, 0.0, 0.0), Point3::origin(), Point3::origin()];
    let mut cloud = PointCloud { normals: vec![Vector3::z(), Vector3::zeros(), Vector3::z()], points };
    orient(&mut cloud);
    assert_eq!(cloud.len(), 3);
    cloud.normals.clear();
    orient(&mut cloud);
}
