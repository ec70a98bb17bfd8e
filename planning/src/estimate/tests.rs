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
fn how_far_it_may_be_off_follows_from_what_the_faces_determine() {
    let trust = |mut cloud: PointCloud| match estimated(&mut cloud)[..] {
        [PastScan { pose: CameraPose::Estimated(trust), .. }] => trust,
        ref other => panic!("{} scans", other.len()),
    };
    assert!(trust(cap(&Vector3::z())).span > 2.0);
    // One face, and two that share an edge along x: from wherever along it, both are as dense.
    let face = |normal: Vector3<f64>, along: Vector3<f64>| {
        let points = (0..1600).map(|i| {
            let [u, v] = [i % 40, i / 40].map(|k| 0.0025 * f64::from(k));
            Point3::from(u * Vector3::x() + v * along)
        });
        PointCloud { points: points.collect(), normals: vec![normal; 1600] }
    };
    let plate = face(Vector3::z(), Vector3::y());
    let mut angle = plate.clone();
    angle.merge(&face(Vector3::y(), -Vector3::z()));
    for flat in [trust(plate), trust(angle)] {
        assert!(flat.off_deg() > 30.0, "{flat:?}");
    }
}

#[test]
fn where_the_density_says_nothing_of_the_side_the_edges_do() {
    // As a scanner of parallel rays sees a dented ball: no part is denser for being nearer.
    let height = |x: f64, y: f64| (0.01 - x * x - y * y).sqrt() - 0.03 * (-(x * x + y * y) / 0.0016).exp();
    let lattice = (0..200).flat_map(|i| (0..200).map(move |j| [i, j].map(|k| 0.001 * (f64::from(k) - 99.5))));
    let scanned: Vec<[f64; 2]> = lattice.filter(|[x, y]| x * x + y * y < 0.0098).collect();
    let slope = |x: f64, y: f64| {
        let h = 1e-6;
        [height(x + h, y) - height(x - h, y), height(x, y + h) - height(x, y - h)].map(|d| d / (2.0 * h))
    };
    let points: Vec<Point3<f64>> = scanned.iter().map(|&[x, y]| Point3::new(x, y, height(x, y))).collect();
    for up in [1.0, -1.0] {
        let turned = |v: Vector3<f64>| v.component_mul(&Vector3::new(1.0, up, up));
        let normals =
            scanned.iter().map(|&[x, y]| turned(Vector3::new(-slope(x, y)[0], -slope(x, y)[1], 1.0).normalize()));
        let cloud =
            PointCloud { points: points.iter().map(|p| turned(p.coords).into()).collect(), normals: normals.collect() };
        let told = Samples::of(&cloud, &cloud.points, 0.001, usize::MAX).direction(1.2).expect("a direction");
        assert!(told.direction.z * up > 0.95, "{:?}", told.direction);
        assert!(told.trust.wrong_side() < 0.1, "{:?}, by density {}", told.trust, told.by_density);
        assert!(told.by_density > 0.7, "{}", told.by_density);
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
