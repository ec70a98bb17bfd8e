use super::*;
use crate::golden::Golden;
use geometry::rng::stream;
use nalgebra::Isometry3;

fn sheet() -> PointCloud {
    let points: Vec<_> =
        (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.003, f64::from(i / 30) * 0.003, 0.0)).collect();
    PointCloud { normals: vec![Vector3::z(); points.len()], points }
}

/// Compares the outward directions and the cameras of each kind (its name; whether the turn is the full one); the
/// indices of their targets.
fn directions_equal(
    golden: &Golden,
    name: &str,
    cloud: &PointCloud,
    cameras: &[(&str, bool)],
    tolerance: f64,
) -> Vec<usize> {
    let field = |f: &str| format!("{name}.{f}");
    let neighborhoods = Neighborhoods::of(&cloud.points, 30);
    let indices = golden.indices(&field("representative_index"));
    let sorted: Vec<usize> = golden.indices(&field("nearest_sort_order")).iter().map(|&i| indices[i]).collect();
    let us = golden.points(&field("view_u"));
    let angles = golden.f64(&field("angle_deg"));
    assert_eq!((sorted.len(), us.len()), (20, 20), "{name}");
    for &(camera, unit_axis) in cameras {
        let cameras = golden.points(&field(camera));
        for (position, &i) in sorted.iter().enumerate() {
            let outward = outward_direction(cloud, &neighborhoods, i);
            assert!((outward - us[position].coords).norm() < tolerance, "{name}: u of {position}");
            let angle = angles[position].to_radians();
            let direction = tilted(&cloud.normals[i].normalize(), &outward, angle, unit_axis);
            let ours = cloud.points[i] + 1.2 * direction;
            assert!((ours - cameras[position]).norm() < tolerance, "{name}: {camera} {position}");
        }
    }
    sorted
}

fn views(cloud: &PointCloud, distance: f64, config: &CandidateConfig, rng: &mut ChaCha8Rng) -> Vec<CandidateView> {
    let near = Neighborhoods::of(&cloud.points, config.boundary.neighbors);
    candidate_views(cloud, &near, distance, config, rng)
}

#[test]
fn directions_equal_the_definition() {
    let (clouds, golden) = (Golden::open("boundary.safetensors"), Golden::open("views.safetensors"));
    let cameras = [("view_camera", false), ("view_camera_unit_axis", true)];
    for name in ["sphere", "torus"] {
        directions_equal(&golden, name, &clouds.cloud_of(name), &cameras, 1e-9);
    }
}

#[test]
fn bonus_directions_equal_the_published_ones() {
    let Some(golden) = Golden::bonus("c_views.safetensors") else { return };
    for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
        let cloud = golden.cloud(&format!("{name}.cloud"));
        let sorted = directions_equal(&golden, name, &cloud, &[("view_camera", false)], 1e-5);
        for (i, target) in sorted.into_iter().zip(golden.points(&format!("{name}.view_target"))) {
            assert!((cloud.points[i] - target).norm() < 1e-6, "{name}");
        }
    }
}

#[test]
fn candidates_of_a_sheet_stand_at_its_rim() {
    let cloud = sheet();
    let config = CandidateConfig::default();
    let candidates = views(&cloud, 0.7, &config, &mut stream(1, "candidates"));
    assert_eq!(candidates.len(), 20);
    for (i, c) in candidates.iter().enumerate() {
        assert!(((c.view.position - c.view.target).norm() - 0.7).abs() < 1e-12);
        let expected = (config.tilts_deg[i % 3].to_radians()).cos();
        assert!((c.direction().z - expected).abs() < 1e-9, "the full tilt about the unit axis");
        let from_middle = c.view.target - Point3::new(0.0435, 0.0435, 0.0);
        assert!(from_middle.amax() > 0.043, "on the rim");
        if i % 3 == 0 {
            assert!(c.direction().dot(&from_middle) > 0.0, "-45 leans out over the unseen side");
        }
        assert!(c.density > 0.0);
    }
    let all = CandidateConfig { angles: Angles::All, ..config };
    assert_eq!(views(&cloud, 0.7, &all, &mut stream(1, "candidates")).len(), 60);
}

#[test]
fn candidates_move_with_the_cloud() {
    let cloud = sheet();
    let motion = Isometry3::new(Vector3::new(4.0, -2.0, 1.0), Vector3::new(0.3, 0.2, -1.0));
    let views = |cloud: &PointCloud| views(cloud, 1.2, &CandidateConfig::default(), &mut stream(2, "candidates"));
    // Away from exact ties of the lattice.
    let mut rng = stream(3, "jitter");
    let mut cloud = cloud;
    for p in &mut cloud.points {
        *p += Vector3::from_fn(|_, _| rand::RngExt::random_range(&mut rng, -3e-4..3e-4));
    }
    let (here, there) = (views(&cloud), views(&cloud.transformed(&motion)));
    assert_eq!(here.len(), there.len());
    for (a, b) in here.iter().zip(&there) {
        assert!((motion * a.view.position - b.view.position).norm() < 1e-6);
    }
}

#[test]
fn degenerate_clouds_have_no_candidates() {
    let views = |cloud: &PointCloud| views(cloud, 1.2, &CandidateConfig::default(), &mut stream(4, "c"));
    assert!(views(&PointCloud::default()).is_empty());
    let mut cloud = sheet();
    cloud.normals.fill(Vector3::zeros());
    assert!(views(&cloud).is_empty());
    let spot = PointCloud { points: vec![Point3::origin(); 10], normals: vec![Vector3::x(); 10] };
    assert!(views(&spot).is_empty());
    let two = PointCloud { points: vec![Point3::origin(), Point3::new(0.1, 0.0, 0.0)], normals: vec![Vector3::z(); 2] };
    for c in views(&two) {
        assert!(c.view.is_valid());
    }
}
