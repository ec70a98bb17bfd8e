use super::*;

/// What is seen of a ball of 0.1 m from this direction, at random, with outward normals.
fn cap(direction: &Vector3<f64>) -> PointCloud {
    let normals: Vec<Vector3<f64>> = (0..DIRECTIONS * 20)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / (DIRECTIONS * 20) as f64;
            let turn = i as f64 * 2.399_963_229_728_653;
            Vector3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
        })
        .filter(|n| n.dot(direction) > 0.15)
        .collect();
    PointCloud { points: normals.iter().map(|n| Point3::from(0.1 * n)).collect(), normals }
}

fn estimated(cloud: &mut PointCloud) -> Vec<PastScan> {
    let measured = cloud.points.clone();
    estimated_scans(cloud, &measured, 1.2, 0.005)
}

fn direction_of(scan: &PastScan) -> Vector3<f64> {
    scan.world_from_camera.translation.vector.normalize()
}

#[test]
fn a_scan_tells_where_it_was_taken_from() {
    for direction in [Vector3::z(), Vector3::new(1.0, -2.0, 0.5).normalize()] {
        let scans = estimated(&mut cap(&direction));
        assert_eq!(scans.len(), 1, "one camera");
        let off = direction_of(&scans[0]).angle(&direction).to_degrees();
        assert!(off < 3.0, "{off} degrees off");
        assert!(matches!(scans[0].pose, CameraPose::Estimated(_)));
    }
}

#[test]
fn a_merged_cloud_is_explained_by_cameras_around_it() {
    let (above, below) = (Vector3::z(), Vector3::new(0.3, 0.0, -1.0).normalize());
    let mut cloud = cap(&above);
    cloud.merge(&cap(&below));
    let scans = estimated(&mut cloud);
    assert!((2..=6).contains(&scans.len()), "{}", scans.len());
    for direction in [above, below] {
        let nearest = scans.iter().map(|s| direction_of(s).angle(&direction)).fold(f64::INFINITY, f64::min);
        assert!(nearest.to_degrees() < 40.0, "{} degrees off", nearest.to_degrees());
    }
}

#[test]
fn nothing_is_told_by_normals_that_cancel() {
    let mut cloud = PointCloud { points: vec![Point3::origin(); 2], normals: vec![Vector3::x(), -Vector3::x()] };
    assert!(estimated(&mut cloud).is_empty());
}
