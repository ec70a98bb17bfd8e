use super::*;
use crate::{NoReturn, Scan, Session, SessionConfig};
use geometry::{PointCloud, View};
use nalgebra::Isometry3;

fn camera() -> PinholeCamera {
    PinholeCamera { width: 120, height: 100, fx: 200.0, fy: 200.0, cx: 60.0, cy: 50.0 }
}

/// A wall at 1 m, and a board of 60 x 60 pixels in its middle at 0.6 m.
fn image() -> DepthImage {
    let pixel = |i: u32| if (30..90).contains(&(i % 120)) && (20..80).contains(&(i / 120)) { 0.6 } else { 1.0 };
    DepthImage { origin: [0, 0], size: [120, 100], depth: (0..12_000).map(pixel).collect() }
}

#[test]
fn mixed_pixels_are_those_between_two_depths() {
    let sensor = SensorConfig { drop_mixed_pixels: true, ..Default::default() };
    let mut clean = image();
    assert_eq!(sensor.clean(&mut clean, &camera()).mixed, 0, "edges are none");
    let mut veiled = image();
    for row in 20..80 {
        // One and two wide.
        veiled.depth[row * 120 + 30] = 0.8;
        veiled.depth[row * 120 + 88] = 0.7;
        veiled.depth[row * 120 + 89] = 0.85;
    }
    assert_eq!(sensor.clean(&mut veiled, &camera()).mixed, 180);
    assert!((20..80).all(|row| veiled.depth[row * 120 + 30].is_nan() && veiled.depth[row * 120 + 31] == 0.6));
    // A steep plane, met at 75 degrees, is a surface.
    let steep = |i: u32| 1.0 / (1.0 - 3.7 * (f64::from(i % 120) - 60.0) / 200.0) as f32;
    let mut plane = DepthImage { origin: [0, 0], size: [50, 100], depth: Vec::new() };
    plane.depth = (0..5000u32).map(|i| steep(i / 50 * 120 + i % 50)).collect();
    assert_eq!(sensor.clean(&mut plane, &camera()), Dropped::default());
}

fn scan(misses: NoReturn) -> Scan {
    Scan::Depth { camera: camera(), depth: image(), world_from_camera: Isometry3::identity(), misses }
}

fn wall_and_board() -> PointCloud {
    PointCloud { points: image().to_points(&camera(), &Isometry3::identity()), normals: Vec::new() }
}

/// Whether the first scan, from the origin along z, shows nothing at this x / z and z.
fn shows_nothing(session: &Session, x: f64, z: f64) -> bool {
    let past = &session.state().scans[0];
    let p = past.world_from_camera.inverse() * Point3::new(x * z, 0.0, z);
    past.hides([p.x / p.z, p.y / p.z], p.z, 0)
}

#[test]
fn what_is_out_of_range_is_left_out_counted_and_no_background() {
    let config = |sensor| SessionConfig { sensor, working_distance_m: 0.6, max_points: 0, ..Default::default() };
    let sensor = SensorConfig { max_range_m: Some(0.8), ..Default::default() };
    for misses in [NoReturn::Free, NoReturn::Unknown] {
        let mut session = Session::new(config(sensor), None).expect("in range");
        let report = session.add_scan(scan(misses)).expect("a scan");
        assert_eq!((report.read, report.beyond_sensor), (12_000, 12_000 - 3_600));
        let answer = session.next_view().expect("an answer");
        assert!(
            answer.warnings.iter().any(|w| w.contains("8400 of 12000 points outside the sensor's range")),
            "{answer:?}"
        );
        // What was measured beyond is not declared empty: beside the board it may continue.
        let beside = session.state().scans[0].clone();
        let crate::Seen::Depth { depth, .. } = &beside.seen else { panic!("a depth image") };
        assert!(depth.depth.iter().filter(|z| z.is_nan()).count() == 8_400 && depth.at(0, 0).is_none());
    }
    let mut session = Session::new(config(sensor), None).expect("in range");
    let cloud = wall_and_board();
    let report = session.add_scan(Scan::Cloud { cloud, from: Some(Point3::origin()) }).expect("a cloud");
    assert_eq!(report.beyond_sensor, 8_400, "the same of a cloud with its camera's position");
    assert!(shows_nothing(&session, -0.275, 0.2) && !shows_nothing(&session, 0.0, 0.7), "nor background there");
    // What is cut away was measured all the same: space is free up to it.
    let region_m = Some([[-1.0, -1.0, 0.5], [1.0, 1.0, 0.8]]);
    let mut session =
        Session::new(SessionConfig { region_m, ..config(SensorConfig::default()) }, None).expect("in range");
    session.add_scan(Scan::Cloud { cloud: wall_and_board(), from: Some(Point3::origin()) }).expect("a cloud");
    assert!(!shows_nothing(&session, -0.275, 0.9) && shows_nothing(&session, -0.275, 1.1));
}

#[test]
fn values_without_a_meaning_are_refused() {
    let refused = |sensor: SensorConfig, key: &str| {
        let error = sensor.check(&[1.2]).expect_err(key);
        assert_eq!(error.key, key, "{error}");
    };
    let off = SensorConfig::default();
    assert_eq!(off.check(&[1.2]), Ok(()));
    refused(SensorConfig { min_range_m: Some(-1.0), ..off }, "sensor.min_range_m");
    refused(SensorConfig { min_range_m: Some(2.0), max_range_m: Some(1.0), ..off }, "sensor.max_range_m");
    refused(SensorConfig { max_incidence_deg: Some(95.0), ..off }, "sensor.max_incidence_deg");
    refused(SensorConfig { max_range_m: Some(1.0), ..off }, "working_distance_m");
}

/// A sheet of 10 cm seen from above, and the answer about views of it.
fn told(sensor: SensorConfig, views: &[View]) -> Vec<crate::Candidate> {
    let at = |i: u32| 0.1 * f64::from(i) / 60.0;
    let points = (0..3600).map(|i| Point3::new(at(i % 60), at(i / 60), 0.0)).collect();
    let config = SessionConfig { sensor, working_distance_m: 0.6, ..Default::default() };
    let mut session = Session::new(config, None).expect("in range");
    let from = Some(Point3::new(0.05, 0.05, 0.6));
    session.add_scan(Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }).expect("a scan");
    session.set_given_views(views.iter().map(View::world_from_camera).collect());
    let mut told = session.next_view().expect("an answer").candidates;
    told.sort_by_key(|c| c.given);
    told
}

#[test]
fn forecasts_count_what_the_sensor_measures_and_views_of_nothing_are_ruled_out() {
    let target = Point3::new(0.05, 0.05, 0.0);
    let from = |distance: f64, tilt: f64| {
        let (sin, cos) = tilt.to_radians().sin_cos();
        View { target, position: target + distance * Vector3::new(sin, 0.0, cos) }
    };
    let views = [from(0.55, 5.0), from(1.5, 0.0), from(0.2, 0.0), from(0.55, 70.0)];
    let off = told(SensorConfig::default(), &views);
    assert!(off.iter().all(|c| c.objections.is_empty()), "{off:?}");
    let range = SensorConfig { min_range_m: Some(0.4), max_range_m: Some(1.0), ..Default::default() };
    let told_of = |c: &crate::Candidate| c.objections.first().map(|o| o.constraint);
    use crate::Constraint::Sensor;
    let limited = told(range, &views);
    assert_eq!(limited.iter().map(told_of).collect::<Vec<_>>(), [None, Some(Sensor), Some(Sensor), None]);
    assert_eq!(limited[0].expected_overlap, off[0].expected_overlap, "within range nothing changes");
    // Flat: the sheet is no longer known surface in its image.
    let flat = told(SensorConfig { max_incidence_deg: Some(60.0), ..Default::default() }, &views);
    let overlap = |c: &crate::Candidate| c.expected_overlap.unwrap_or(0.0);
    assert!(overlap(&off[3]) > 0.3 && overlap(&flat[3]) < 0.1, "{} {}", overlap(&off[3]), overlap(&flat[3]));
    assert!((overlap(&flat[0]) - overlap(&off[0])).abs() < 0.05);
}
