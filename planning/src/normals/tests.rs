use super::*;
use nalgebra::Point3;

/// A half sphere with its outward normals.
fn dome() -> PointCloud {
    let mut cloud = PointCloud::default();
    for i in 0..400 {
        let (z, phi) = (1.0 - (f64::from(i) + 0.5) / 400.0, f64::from(i) * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        let normal = Vector3::new(r * phi.cos(), r * phi.sin(), z);
        cloud.normals.push(normal);
        cloud.points.push(Point3::from(0.1 * normal));
    }
    cloud
}

#[test]
fn given_normals_stay_and_missing_ones_follow_their_neighbours() {
    let truth = dome();
    let mut cloud = truth.clone();
    assert_eq!(settle(&mut cloud, None), Settled { signed: true, ..Default::default() });
    assert_eq!(cloud, truth, "nothing to do");
    for i in (0..400).step_by(3) {
        cloud.normals[i] = if i % 2 == 0 { Vector3::zeros() } else { Vector3::repeat(f64::NAN) };
    }
    assert_eq!(settle(&mut cloud, None), Settled { signed: true, estimated: 134, ..Default::default() });
    let off = cloud.normals.iter().zip(&truth.normals).map(|(a, b)| a.dot(b)).fold(1.0, f64::min);
    assert!(off > 0.9, "the worst is off by {off}");
    cloud.normals.iter_mut().for_each(|n| *n *= 128.0);
    settle(&mut cloud, None);
    assert!(cloud.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-9), "of any length");
}

#[test]
fn normals_that_do_not_stand_on_the_surface_are_ignored() {
    let truth = dome();
    for column in [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] {
        let mut cloud = PointCloud { normals: vec![Vector3::from(column); 400], ..truth.clone() };
        assert!(settle(&mut cloud, None).ignored, "{column:?} everywhere");
        let off = cloud.normals.iter().zip(&truth.normals).map(|(a, b)| a.dot(b).abs()).fold(1.0, f64::min);
        assert!(off > 0.9, "estimated: {off}");
    }
    let labels = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut cloud = PointCloud { normals: (0..400).map(|i| labels[i * 7 % 3]).collect(), ..truth };
    assert!(settle(&mut cloud, None).ignored, "colours of unit length");
}

#[test]
fn a_few_given_ones_tell_nothing() {
    let mut cloud = dome();
    cloud.normals[1..].fill(Vector3::zeros());
    assert_eq!(settle(&mut cloud, None), Settled { ignored: true, ..Default::default() });
    assert!(cloud.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-9));
}
