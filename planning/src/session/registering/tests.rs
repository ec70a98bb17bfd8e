use super::*;
use crate::registration::{AfterAlarm, Registrability, RegistrationConfig};
use crate::{Scan, SessionConfig};
use geometry::{PointCloud, View};
use nalgebra::{Translation3, UnitQuaternion};

/// Three sides of a box, 80 mm long, as seen from a corner, or a part of it.
fn sides(skip: usize) -> PointCloud {
    let at = |u: usize, v: usize| (0.002 * u as f64, 0.002 * v as f64);
    let mut points = Vec::new();
    for (u, v) in (skip..40).flat_map(|u| (0..40).map(move |v| at(u, v))) {
        points.extend([Point3::new(u, v, 0.08), Point3::new(u, 0.08, v), Point3::new(0.08, u, v)]);
    }
    PointCloud { points, normals: Vec::new() }
}

fn camera() -> Point3<f64> {
    Point3::new(0.7, 0.8, 0.9)
}

fn off() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3f64, -0.2, 0.1).map(f64::to_radians));
    Isometry3::from_parts(Translation3::new(0.002, -0.001, 0.0015), turn)
}

/// A session with a scan that is right and one that is off.
fn two_scans(registration: RegistrationConfig) -> (Session, Result<crate::ScanReport, SessionError>) {
    let mut session = Session::new(SessionConfig { registration, ..Default::default() }, None).expect("settings");
    session.add_scan(Scan::Cloud { cloud: sides(0), from: Some(camera()) }).expect("the first scan");
    let second = sides(4).transformed(&off());
    let report = session.add_scan(Scan::Cloud { cloud: second, from: Some(off() * camera()) });
    (session, report)
}

fn with(register: Register) -> RegistrationConfig {
    RegistrationConfig { register, ..Default::default() }
}

/// Largest distance of the second scan's points to the planes of the sides.
fn apart(session: &Session) -> f64 {
    let planes = |p: &Point3<f64>| p.iter().map(|x| (x - 0.08).abs()).fold(f64::INFINITY, f64::min);
    session.scans[1].cloud.points.iter().map(planes).fold(0.0, f64::max)
}

#[test]
fn off_believes_the_pose_and_says_nothing() {
    let (mut session, report) = two_scans(with(Register::Off));
    assert_eq!(report.expect("taken").registration, None);
    assert!(apart(&session) > 1e-3);
    let answer = session.next_view().expect("a view");
    assert!(answer.registrations.is_empty());
    assert!(answer.candidates.iter().all(|c| c.registration.is_none()));
}

#[test]
fn check_says_how_far_it_is_off_and_moves_nothing() {
    let (mut session, report) = two_scans(with(Register::Check));
    let found = report.expect("taken").registration.expect("registered");
    assert!((found.correction * off()).translation.vector.norm() < 1e-4, "{found:?}");
    assert!((found.turn_deg - off().rotation.angle().to_degrees()).abs() < 0.05, "{found:?}");
    assert!(apart(&session) > 1e-3);
    let answer = session.next_view().expect("a view");
    assert!(answer.warnings.iter().any(|w| w.contains("scan 2 fits best")), "{:?}", answer.warnings);
    assert_eq!((answer.registrations[0].scan, answer.registrations[0].moved), (2, false));
}

#[test]
fn check_does_not_call_a_pose_wrong_by_a_registration_that_did_not_settle() {
    let (mut session, _) = two_scans(with(Register::Check));
    session.scans[1].report.registration.as_mut().expect("registered").converged = false;
    let warnings = session.next_view().expect("a view").warnings;
    assert!(warnings.iter().any(|w| w.contains("scan 2 could not be checked")), "{warnings:?}");
    assert!(!warnings.iter().any(|w| w.contains("fits best")), "{warnings:?}");
}

#[test]
fn refine_moves_the_scan_and_its_camera() {
    let (mut session, report) = two_scans(with(Register::Refine));
    report.expect("taken").registration.expect("registered");
    assert!(apart(&session) < 1e-4, "{}", apart(&session));
    let position = session.scans[1].camera_position().expect("given");
    assert!((position - camera()).norm() < 1e-3, "{position}");
    let answer = session.next_view().expect("a view");
    assert!(answer.registrations[0].moved);
    assert!(answer.warnings.iter().any(|w| w.contains("scan 2 was moved by")), "{:?}", answer.warnings);
}

#[test]
fn a_given_view_is_scanned_where_the_robot_was_sent_not_where_registration_found_it() {
    let (mut session, _) = two_scans(with(Register::Refine));
    let sent = off() * camera();
    assert!((session.scans[1].camera_position().expect("known") - sent).norm() > 3e-3, "it was moved");
    assert!((session.scans[1].position_given().expect("known") - sent).norm() < 1e-6);
    let target = Point3::new(0.04, 0.04, 0.04);
    let ahead = target + (sent - target).normalize() * session.config.working_distance_m;
    let pose = View { target, position: sent }.world_from_camera();
    let other = View { target, position: target - (ahead - target) }.world_from_camera();
    session.set_given_views(vec![pose, other]);
    let candidates = session.next_view().expect("an answer").candidates;
    let ruled_out = |given: usize| candidates.iter().any(|c| c.given == Some(given) && !c.objections.is_empty());
    assert!(ruled_out(0) && !ruled_out(1), "{candidates:?}");
}

#[test]
fn what_cannot_be_placed_is_refused_and_its_place_ruled_out_until_the_cloud_changes() {
    let (mut session, _) = two_scans(with(Register::Refine));
    let next = session.next_view().expect("a view").next.expect("one is left");
    let view = View { target: next.target_m.into(), position: next.position_m.into() };
    let before = session.state().cloud.clone();
    // What the camera would have seen there of another box, half a metre behind.
    let own = View { target: Point3::new(0.04, 0.04, 0.04), position: camera() }.world_from_camera();
    let behind = Translation3::new(0.0, 0.0, 0.5);
    let elsewhere = sides(0).transformed(&(view.world_from_camera() * behind * own.inverse()));
    let refused = session.add_scan(Scan::Cloud { cloud: elsewhere, from: Some(view.position) });
    let message = refused.expect_err("nothing to register by").to_string();
    assert!(message.contains("cannot be registered") && message.contains("check"), "{message}");
    assert_eq!((session.num_scans(), &session.state().cloud), (2, &before), "the session is as it was");
    let answer = session.next_view().expect("a view");
    let same = answer.candidates.iter().find(|c| c.position_m == next.position_m).expect("still scored");
    assert_eq!(same.objections[0].constraint, Constraint::Registrability, "{same:?}");
    let places = session.rejected_from().to_vec();
    assert_eq!(session.camera_now(None), places.last().copied(), "there the robot stands");
    session.set_rejected_from(Vec::new());
    assert_ne!(session.next_view().expect("a view"), answer, "nobody remembers");
    session.set_rejected_from(places);
    assert_eq!(session.next_view().expect("a view"), answer, "and somebody does again");
    session.add_scan(Scan::Cloud { cloud: sides(0), from: Some(camera()) }).expect("fits");
    assert!(session.unregistered().is_empty());
}

#[test]
fn a_view_that_sees_too_little_again_is_ruled_out_with_the_motion_that_stays_free() {
    let registration = RegistrationConfig { registrability: Registrability::Lambda, ..Default::default() };
    let mut session = Session::new(SessionConfig { registration, ..Default::default() }, None).expect("settings");
    let flat = (0..1600).map(|i| Point3::new(0.002 * f64::from(i % 40), 0.002 * f64::from(i / 40), 0.0)).collect();
    let cloud = PointCloud { points: flat, normals: Vec::new() };
    session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.04, 0.04, 1.2)) }).expect("a sheet");
    let answer = session.next_view().expect("an answer");
    assert_eq!(answer.next, None, "a sheet registers nothing");
    // Some look at its other side.
    let front = answer.candidates.iter().find(|c| c.position_m[2] > 0.5).expect("at its rim");
    let reason = &front.objections[0].reason;
    assert!(reason.contains("slide along") || reason.contains("turn about z"), "{reason}");
    let expected = front.registration.expect("predicted");
    assert!(expected.lambda < 0.1 && expected.failure > 0.8, "{expected:?}");
    let (mut session, _) = two_scans(RegistrationConfig {
        register: Register::Refine,
        registrability: Registrability::Lambda,
        ..Default::default()
    });
    let next = session.next_view().expect("an answer").next.expect("a corner registers");
    assert!(next.registration.expect("predicted").failure < 0.15);
}

#[test]
fn a_rule_that_nobody_asked_for_gives_way_where_it_would_leave_no_view() {
    // From the far side, where little or nothing of the sides is seen again.
    let away = [[-0.7, -0.8, -0.9], [-0.9, 0.3, -0.6], [-0.2, -1.0, 0.5]].map(|position: [f64; 3]| {
        let target = Point3::new(0.04, 0.04, 0.04);
        View { target, position: Point3::from(position) }.world_from_camera()
    });
    let session = |registrability| {
        let registration = RegistrationConfig { register: Register::Refine, registrability, ..Default::default() };
        let mut session = Session::new(SessionConfig { registration, ..Default::default() }, None).expect("settings");
        session.add_scan(Scan::Cloud { cloud: sides(0), from: Some(camera()) }).expect("a scan");
        session.set_given_views(away.to_vec());
        session.next_view().expect("an answer")
    };
    let asked = session(Registrability::Overlap);
    assert_eq!(asked.next, None);
    assert!(asked.candidates.iter().all(|c| c.objections[0].constraint == Constraint::Registrability));
    let answer = session(Registrability::Auto);
    let next = answer.next.expect("one is left");
    let most = asked.candidates.iter().filter_map(|c| c.expected_overlap).fold(0.0, f64::max);
    assert_eq!(next.expected_overlap, Some(most), "the largest overlap");
    let excluded = answer.candidates.iter().filter(|c| !c.objections.is_empty()).count();
    assert_eq!(excluded, asked.candidates.len() - 1);
    assert!(answer.warnings.iter().any(|w| w.contains("may not register")), "{:?}", answer.warnings);
}

/// Hills from `from` to `to` along x.
fn hills(from: f64, to: f64) -> PointCloud {
    let along = |i: u32| from + 0.002 * f64::from(i);
    let count = ((to - from) / 0.002) as u32;
    let height = |x: f64, y: f64| 0.012 * (70.0 * x).sin() * (60.0 * y).cos();
    let points = (0..count).flat_map(|i| (0..40).map(move |j| (along(i), 0.002 * f64::from(j))));
    let points = points.map(|(x, y)| Point3::new(x, y, height(x, y))).collect();
    PointCloud { points, normals: Vec::new() }
}

/// A scan of hills from above their middle, as `off` puts it.
fn scan_of_hills(from: f64, to: f64, off: Isometry3<f64>) -> Scan {
    let from_above = Point3::new(0.5 * (from + to), 0.04, 1.2);
    Scan::Cloud { cloud: hills(from, to).transformed(&off), from: Some(off * from_above) }
}

/// Two scans with a gap between them, the second of them off.
fn with_a_gap(after_alarm: AfterAlarm) -> (Session, Result<crate::ScanReport, SessionError>) {
    let registration = RegistrationConfig { register: Register::Refine, after_alarm, ..Default::default() };
    let mut session = Session::new(SessionConfig { registration, ..Default::default() }, None).expect("settings");
    session.add_scan(scan_of_hills(0.0, 0.12, Isometry3::identity())).expect("the first scan");
    let second = session.add_scan(scan_of_hills(0.16, 0.28, off()));
    (session, second)
}

#[test]
fn a_scan_that_cannot_be_registered_waits_and_is_merged_with_the_one_that_closes_the_gap() {
    let (mut session, second) = with_a_gap(AfterAlarm::Bridge);
    assert!(second.expect("kept").registration.expect("tried").refused.is_some());
    assert_eq!((session.num_scans(), session.scans.len(), session.correction(2)), (2, 1, None));
    let waiting = session.next_view().expect("a view").warnings;
    assert!(waiting.iter().any(|w| w.contains("scan 2 is kept aside")), "{waiting:?}");
    session.add_scan(scan_of_hills(0.05, 0.24, Isometry3::identity())).expect("it overlaps both");
    let moved = session.correction(2).expect("merged") * off();
    assert!(moved.translation.vector.norm() < 1e-3 && moved.rotation.angle() < 2e-3, "{moved:?}");
    let cloud = session.cloud().clone();
    assert!(cloud.bounding_box().1.x > 0.27, "its surface is in the cloud");
    let told = session.next_view().expect("a view").registrations;
    assert_eq!(told.iter().map(|r| r.scan).collect::<Vec<_>>(), [3, 2], "in the order in which they were merged");

    assert!(session.undo());
    assert_eq!((session.num_scans(), session.scans.len(), session.correction(2)), (2, 1, None), "it waits again");
    session.add_scan(scan_of_hills(0.05, 0.24, Isometry3::identity())).expect("it overlaps both");
    let farthest = cloud.points.iter().zip(&session.cloud().points).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    assert!(farthest < 1e-9 && cloud.len() == session.cloud().len(), "as before: {farthest}");
    session.restore(1);
    assert_eq!((session.num_scans(), session.aside.len()), (1, 0));
}

#[test]
fn after_an_alarm_the_view_that_sees_both_sides_of_the_gap_comes_first_and_says_so() {
    let (mut session, _) = with_a_gap(AfterAlarm::Bridge);
    let answer = session.next_view().expect("a view");
    let next = answer.next.as_ref().expect("one is allowed");
    assert_eq!(next.bridges_to, Some(2));
    assert!(answer.reason().starts_with("Bridges to scan 2"), "{}", answer.reason());
    let view = View { target: next.target_m.into(), position: next.position_m.into() };
    let frame = crate::registration::Frame::around(&[session.cloud()]);
    let demand = Demand::new(&session.config().registration, &frame, session.state().working_distance);
    assert!(demand.predict(session.state(), &view, &frame).failure <= 0.05, "its own scan is safe");
    let best = answer.candidates.iter().filter(|c| c.objections.is_empty()).map(|c| c.score).fold(f64::MIN, f64::max);
    assert!(next.score <= best, "whatever its score");
}

#[test]
fn without_refine_no_view_is_spent_on_a_scan_that_waits_and_it_says_what_for() {
    let (mut session, _) = with_a_gap(AfterAlarm::Bridge);
    let refining = session.config().clone();
    let camera = session.aside[0].camera_position().expect("given");
    assert!(session.unregistered().contains(&camera) && !session.between().is_empty());
    for register in [Register::Off, Register::Check] {
        let mut config = refining.clone();
        config.registration.register = register;
        session.configure(config).expect("in range");
        let answer = session.next_view().expect("a view");
        assert!(answer.candidates.iter().all(|c| c.bridges_to.is_none()));
        assert!(session.between().is_empty() && session.unregistered().is_empty(), "{register:?}");
        let told: Vec<&String> = answer.warnings.iter().filter(|w| w.contains("scan 2 is kept aside")).collect();
        assert!(matches!(&told[..], [w] if w.contains("registration.register = \"refine\"")), "{:?}", answer.warnings);
        session.add_scan(scan_of_hills(0.05, 0.24, Isometry3::identity())).expect("it overlaps both");
        assert_eq!((session.scans.len(), session.aside.len()), (2, 1), "{register:?}");
        assert!(session.undo());
    }
    session.configure(refining).expect("in range");
    assert_eq!(session.next_view().expect("a view").next.expect("one is allowed").bridges_to, Some(2));
    session.add_scan(scan_of_hills(0.05, 0.24, Isometry3::identity())).expect("it overlaps both");
    assert!(session.correction(2).is_some(), "it is merged then");
}

#[test]
fn ignoring_an_alarm_loses_the_scan() {
    let (mut session, second) = with_a_gap(AfterAlarm::Ignore);
    second.expect_err("refused");
    assert_eq!(session.num_scans(), 1);
    let answer = session.next_view().expect("a view");
    assert!(answer.candidates.iter().all(|c| c.bridges_to.is_none()));
}
