use super::*;
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};

/// Points of a surface, 2 mm apart, with their normals.
fn surface(columns: i32, rows: i32, at: impl Fn(f64, f64) -> (Point3<f64>, Vector3<f64>)) -> PointCloud {
    let mut cloud = PointCloud::default();
    for (i, j) in (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j))) {
        let (p, n) = at(0.002 * f64::from(i), 0.002 * f64::from(j));
        cloud.points.push(p);
        cloud.normals.push(n);
    }
    cloud
}

/// Three sides of a box that meet in a corner: every motion is determined.
fn corner() -> PointCloud {
    let mut cloud = surface(40, 40, |u, v| (Point3::new(u, v, 0.0), Vector3::z()));
    cloud.merge(&surface(40, 40, |u, v| (Point3::new(u, 0.0, v), Vector3::y())));
    cloud.merge(&surface(40, 40, |u, v| (Point3::new(0.0, u, v), Vector3::x())));
    cloud
}

/// A cylinder about z, 30 mm in radius.
fn cylinder() -> PointCloud {
    surface(94, 50, |u, v| {
        let (sin, cos) = (u / 0.03).sin_cos();
        (Point3::new(0.03 * cos, 0.03 * sin, v), Vector3::new(cos, sin, 0.0))
    })
}

fn model(cloud: &PointCloud) -> Model<'_> {
    Model::new(cloud, vec![false; cloud.len()], 0.002, 0.002)
}

fn moving(cloud: &PointCloud) -> Moving<'_> {
    Moving { cloud, footprint_m2: 4e-6 }
}

fn motion(shift_mm: [f64; 3], turn_deg: [f64; 3]) -> Isometry3<f64> {
    let turn = Vector3::from(turn_deg.map(f64::to_radians));
    Isometry3::from_parts(Translation3::from(Vector3::from(shift_mm) * 1e-3), UnitQuaternion::from_scaled_axis(turn))
}

const ARM: PoseError = PoseError { sigma_m: 0.002, sigma_rad: 0.006, about: None };

fn config(kind: Icp, prior: bool) -> RegistrationConfig {
    RegistrationConfig { kind, prior, ..RegistrationConfig::default() }
}

#[test]
fn a_displaced_scan_comes_back() {
    let cloud = corner();
    let off = motion([2.0, -1.5, 1.0], [0.3, -0.4, 0.2]);
    let scan = cloud.transformed(&off);
    for kind in [Icp::Good, Icp::Plain] {
        let found = register(moving(&scan), &model(&cloud), &ARM, &config(kind, false));
        let left = found.correction * off;
        assert!(left.translation.vector.norm() < 2e-5, "{kind:?}: {left}");
        assert!(left.rotation.angle().to_degrees() < 0.01, "{kind:?}: {left}");
        assert!(found.converged && found.refused.is_none(), "{kind:?}: {found:?}");
        assert!(found.fitness > 0.99 && found.like_normals > 0.95 && found.lambda > 50.0, "{found:?}");
    }
}

#[test]
fn what_the_overlap_does_not_determine_is_named() {
    let named = |cloud: &PointCloud| {
        let found = register(moving(cloud), &model(cloud), &ARM, &config(Icp::Good, false));
        (found.weakest.map(|motion| motion.to_string()).unwrap_or_default(), found.lambda)
    };
    let (free, lambda) = named(&cylinder());
    assert!(free.ends_with("along z") || free.ends_with("about z"), "{free}");
    assert!(lambda < 0.1, "{lambda}");
    let groove = surface(40, 40, |u, v| {
        let depth = 0.01 * (u / 0.02).sin();
        (Point3::new(u, v, depth), Vector3::new(-0.5 * (u / 0.02).cos(), 0.0, 1.0).normalize())
    });
    let (free, _) = named(&groove);
    assert_eq!(free, "slide along y");
    let (_, lambda) = named(&corner());
    assert!(lambda > 50.0, "{lambda}");
}

#[test]
fn a_free_motion_is_refused_and_with_the_prior_stays_where_the_robot_says() {
    let cloud = cylinder();
    let scan = cloud.transformed(&motion([1.0, 0.0, 0.0], [0.0; 3]));
    let found = register(moving(&scan), &model(&cloud), &ARM, &config(Icp::Good, true));
    assert!(matches!(found.refused, Some(Unsafe::Uncertain { .. })), "{found:?}");
    let along = found.correction.translation.vector;
    assert!((along.x + 1e-3).abs() < 5e-5, "across the axis it is measured: {along}");
    assert!(along.z.abs() < 1e-4, "along it the robot is believed: {along}");
    let ungated = RegistrationConfig { gate: false, ..config(Icp::Good, true) };
    assert_eq!(register(moving(&scan), &model(&cloud), &ARM, &ungated).refused, None);
}

#[test]
fn too_little_and_too_far_are_refused() {
    let cloud = corner();
    let away = cloud.transformed(&motion([300.0, 0.0, 0.0], [0.0; 3]));
    let found = register(moving(&away), &model(&cloud), &ARM, &config(Icp::Good, false));
    assert!(matches!(found.refused, Some(Unsafe::TooFewPairs { .. })), "{found:?}");
    let exact = PoseError { sigma_m: 0.0003, sigma_rad: 1e-4, about: None };
    let scan = cloud.transformed(&motion([2.0, 2.0, 2.0], [0.0; 3]));
    let found = register(moving(&scan), &model(&cloud), &exact, &config(Icp::Good, false));
    assert!(matches!(found.refused, Some(Unsafe::TooFar { .. })), "{found:?}");
}

#[test]
fn the_back_of_a_thin_sheet_does_not_attract_the_front() {
    let front = surface(40, 40, |u, v| (Point3::new(u, v, 0.0015), Vector3::z()));
    let back = surface(40, 40, |u, v| (Point3::new(u, v, 0.0), -Vector3::z()));
    let found = register(moving(&front), &model(&back), &ARM, &config(Icp::Good, true));
    assert!(matches!(found.refused, Some(Unsafe::TooFewPairs { pairs: 0 })), "{found:?}");
    assert!(found.fitness > 0.9 && found.like_normals == 0.0, "{found:?}");
    let plain = register(moving(&front), &model(&back), &ARM, &config(Icp::Plain, false));
    assert!((plain.correction.translation.vector.z + 0.0015).abs() < 1e-4, "plain ICP is drawn: {plain:?}");
}

#[test]
fn information_equals_finite_differences_of_the_residuals() {
    let cloud = corner();
    let frame = Frame::around(&[&cloud]);
    let mut information = Information::default();
    let mut differences = Matrix6::zeros();
    let h = 1e-6;
    for (q, n) in cloud.points.iter().zip(&cloud.normals) {
        let p = q - frame.center;
        information.add(&p, n, 2.0, frame.radius);
        // How far the moved point is from the plane through where it was.
        let away = |x: Vector6<f64>| {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(x[0], x[1], x[2]) / frame.radius);
            (turn * p + Vector3::new(x[3], x[4], x[5]) - p).dot(n)
        };
        let j = Vector6::from_fn(|k, _| {
            let step = Vector6::from_fn(|i, _| if i == k { h } else { 0.0 });
            (away(step) - away(-step)) / (2.0 * h)
        });
        differences += 2.0 * j * j.transpose();
    }
    let exact = information.symmetric();
    assert!((exact - differences).norm() < 1e-6 * exact.norm(), "{}", exact - differences);
}

#[test]
fn the_prior_equals_drawn_errors_about_the_camera() {
    use rand::RngExt;
    let cloud = corner();
    let frame = Frame::around(&[&cloud]);
    let camera = Point3::new(0.3, 0.2, 1.1);
    let error = PoseError { sigma_m: 0.002, sigma_rad: 0.005, about: Some(camera) };
    let prior = prior::Prior::new(&error, &frame, &cloud);
    let mut rng = geometry::rng::stream(3, "registration/prior");
    // Twelve uniform numbers less six are nearly normal, of variance 1.
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
    let mut squared = 0.0;
    let draws = 4000;
    for _ in 0..draws {
        let shift = Vector3::from_fn(|_, _| 0.002 * normal());
        let turn = Vector3::from_fn(|_, _| 0.005 * normal());
        let points = cloud.points.iter().step_by(37);
        let count = points.clone().count() as f64;
        squared += points.map(|p| (turn.cross(&(p - camera)) + shift).norm_squared()).sum::<f64>() / count;
    }
    let drawn = (squared / f64::from(draws)).sqrt();
    assert!((prior.rms / drawn - 1.0).abs() < 0.03, "{} against {drawn}", prior.rms);
}

#[test]
fn lambda_depends_neither_on_density_nor_on_size() {
    let cloud = corner();
    let lambda = |cloud: &PointCloud, spacing: f64, tolerance: f64, area: f64| {
        let model = Model::new(cloud, vec![false; cloud.len()], spacing, tolerance);
        let scan = Moving { cloud, footprint_m2: area };
        register(scan, &model, &ARM, &config(Icp::Good, false)).lambda
    };
    let once = lambda(&cloud, 0.002, 0.002, 4e-6);
    let step = |i: usize| (i % 40).is_multiple_of(2) && (i / 40).is_multiple_of(2);
    let thin = PointCloud {
        points: cloud.points.iter().enumerate().filter(|(i, _)| step(*i)).map(|(_, p)| *p).collect(),
        normals: cloud.normals.iter().enumerate().filter(|(i, _)| step(*i)).map(|(_, n)| *n).collect(),
    };
    assert!((lambda(&thin, 0.004, 0.002, 16e-6) / once - 1.0).abs() < 0.1);
    let large = PointCloud { points: cloud.points.iter().map(|p| p * 3.0).collect(), normals: cloud.normals.clone() };
    assert!((lambda(&large, 0.006, 0.006, 36e-6) / once - 1.0).abs() < 1e-3);
}

#[test]
fn bounds_follow_from_the_robot_and_the_kind_of_icp() {
    use registrability::Demand;
    let demand = |error_m: f64, error_deg: f64, kind: Icp, about: About| {
        let config = RegistrationConfig {
            pose_error_m: error_m,
            pose_error_deg: error_deg,
            pose_error_about: about,
            kind,
            registrability: Registrability::Lambda,
            ..Default::default()
        };
        Demand::new(&config, &Frame { center: Point3::origin(), radius: 0.065 }, 1.2)
    };
    let small = demand(0.002, 0.3, Icp::Good, About::Object);
    let large = demand(0.008, 2.0, Icp::Good, About::Object);
    // The figures of docs/registration.md.
    assert!((small.least_lambda() - 0.72).abs() < 0.02, "{}", small.least_lambda());
    assert!((large.least_lambda() - 3.54).abs() < 0.05, "{}", large.least_lambda());
    assert!((small.failure(small.least_lambda()) - 0.15).abs() < 1e-9);
    assert!(small.failure(0.0) > 0.8 && large.failure(0.1) > 0.9 && small.failure(40.0) < 0.01);
    for (careful, careless) in [
        (small, large),
        (small, demand(0.002, 0.3, Icp::Plain, About::Object)),
        (small, demand(0.002, 0.3, Icp::Good, About::Camera)),
    ] {
        assert!(careful.least_lambda() < careless.least_lambda(), "{careful:?} {careless:?}");
        assert!(careful.least_overlap() < careless.least_overlap(), "{careful:?} {careless:?}");
    }
}

#[test]
fn views_are_held_against_the_overlap_where_scans_are_moved_and_nothing_else_is_asked() {
    let rule = |register, registrability| RegistrationConfig { register, registrability, ..Default::default() }.rule();
    assert_eq!(RegistrationConfig::default().rule(), Registrability::Off);
    assert_eq!(rule(Register::Check, Registrability::Auto), Registrability::Off);
    assert_eq!(rule(Register::Refine, Registrability::Auto), Registrability::Overlap);
    assert_eq!(rule(Register::Refine, Registrability::Off), Registrability::Off);
    assert_eq!(rule(Register::Off, Registrability::Lambda), Registrability::Lambda);
}

#[test]
fn what_a_view_would_see_again_is_the_area_that_faces_it() {
    use crate::ScanState;
    use geometry::View;
    let seen = |spacing: f64, distance: f64, cloud: PointCloud| {
        let camera = geometry::PinholeCamera::default();
        let state = ScanState { cloud, grid_size: spacing, camera, num_scans: 1, ..Default::default() };
        let target = Point3::new(0.04, 0.04, 0.04);
        let frame = Frame::around(&[&state.cloud]);
        let from = |direction: [f64; 3]| {
            let position = target + distance * Vector3::from(direction).normalize();
            let view = View { target, position };
            registrability::seen_again(&state, &view, &view.world_from_camera(), &frame)
        };
        (from([1.0, 1.0, 1.0]).lambda(frame.radius), from([-1.0, -1.0, -1.0]).lambda(frame.radius))
    };
    // The trace of the lower right block is the area seen, square to the line of sight.
    let (front, behind) = seen(0.002, 1.2, corner());
    assert!(front > 20.0 && behind == 0.0, "{front} and {behind}: the back of the sides faces away");
    let (near, _) = seen(0.002, 0.6, corner());
    assert!((near / front - 1.0).abs() < 0.15, "the distance changes nothing: {near} and {front}");
    let step = |i: usize| (i % 40).is_multiple_of(2) && (i / 40).is_multiple_of(2);
    let all = corner();
    let thin = PointCloud {
        points: all.points.iter().enumerate().filter(|(i, _)| step(*i)).map(|(_, p)| *p).collect(),
        normals: all.normals.iter().enumerate().filter(|(i, _)| step(*i)).map(|(_, n)| *n).collect(),
    };
    let (sparse, _) = seen(0.004, 1.2, thin);
    assert!((sparse / front - 1.0).abs() < 0.2, "nor does the density: {sparse} and {front}");
}

#[test]
fn what_the_sensor_does_not_measure_registers_nothing() {
    use crate::{ScanState, SensorConfig};
    let target = Point3::new(0.04, 0.04, 0.04);
    // Each side is met at 55 degrees.
    let view = geometry::View { target, position: target + 1.2 * Vector3::new(1.0, 1.0, 1.0).normalize() };
    let lambda = |sensor: SensorConfig| {
        let state = ScanState { cloud: corner(), grid_size: 0.002, num_scans: 1, sensor, ..Default::default() };
        let frame = Frame::around(&[&state.cloud]);
        registrability::seen_again(&state, &view, &view.world_from_camera(), &frame).lambda(frame.radius)
    };
    let all = lambda(SensorConfig::default());
    assert!(all > 20.0, "{all}");
    let flat = |angle: f64| SensorConfig { max_incidence_deg: Some(angle), ..Default::default() };
    assert_eq!((lambda(flat(70.0)), lambda(flat(35.0))), (all, 0.0));
    assert_eq!(lambda(SensorConfig { max_range_m: Some(1.0), ..Default::default() }), 0.0);
}
