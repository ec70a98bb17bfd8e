//! What is said and ruled out by where cameras stand.

use super::*;
use crate::config::CameraConfig;
use crate::constraints::Constraint;
use crate::pose::PoseConfig;

#[test]
fn views_keep_their_clearance_from_what_the_object_stands_on() {
    // A table, 1.2 m to one side of a sheet that floats above it.
    let sheet = (0..1_600).map(|i| Point3::new(0.0025 * f64::from(i % 40), 0.0025 * f64::from(i / 40), 0.0));
    let table = (0..4_800).map(|i| Point3::new(0.005 * f64::from(i % 240), 0.005 * f64::from(i / 240), -0.03));
    let cloud = PointCloud { points: sheet.chain(table).collect(), normals: Vec::new() };
    let support = Support::Plane(Plane { normal: [0.0, 0.0, 1.0], offset_m: -0.03 });
    let mut session =
        Session::new(SessionConfig { support, ..SessionConfig::default() }, None).expect("settings in range");
    session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.05, 0.05, 1.0)) }).expect("a scan");
    let against = |x: f64, z: f64| {
        let view = View { target: Point3::origin(), position: Point3::new(x, 0.05, z) };
        session.place(&view).objections.into_iter().map(|o| o.constraint).collect::<Vec<_>>()
    };
    assert_eq!(against(1.0, -0.026), [Constraint::Clearance]);
    assert_eq!(against(1.0, -0.034), [Constraint::Support]);
    assert_eq!(against(1.0, 0.03), []);
    assert_eq!(against(-1.0, -0.026), [], "beside the table");
}

#[test]
fn an_image_that_holds_the_cloud_does_not_overflow() {
    // 0.8 m long; the image holds 0.58 m by 1.04 m at that distance.
    let points = (0..3_200).map(|i| Point3::new(0.01 * f64::from(i % 8), 0.002 * f64::from(i / 8), 0.0)).collect();
    let cloud = PointCloud { points, normals: Vec::new() };
    let told = |width, height, extra_roll_deg| {
        let camera = CameraConfig { width, height, fov_y_deg: 40.0, intrinsics: None };
        let pose = PoseConfig { extra_roll_deg, ..PoseConfig::default() };
        let config = SessionConfig { camera, pose, working_distance_m: 0.8, ..SessionConfig::default() };
        let mut session = Session::new(config, None).expect("settings in range");
        let position = Point3::new(0.04, 0.4, 0.8);
        session.add_scan(Scan::Cloud { cloud: cloud.clone(), from: Some(position) }).expect("a scan");
        let mut best = session.next_view().expect("an answer").candidates.swap_remove(0);
        (best.target_m, best.position_m) = ([0.04, 0.4, 0.0], position.coords.into());
        session.overflows(&best)
    };
    assert_ne!(told(1280, 720, 0.0), told(1280, 720, 90.0), "only along its long side");
    assert!(told(100, 100, 0.0));
}

#[test]
fn pixels_that_leave_gaps_are_told() {
    let told = |tolerance_m| {
        let mut session = session(40, SessionConfig { tolerance_m, ..SessionConfig::default() });
        let warnings = session.next_view().expect("an answer").warnings;
        warnings.iter().any(|w| w.contains("every scan leaves gaps"))
    };
    // 2.3 mm apart at 1.2 m.
    assert!(told(0.001) && !told(0.002));
}
