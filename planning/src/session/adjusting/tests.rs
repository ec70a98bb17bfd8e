use super::*;
use crate::registration::RegistrationConfig;
use crate::{Scan, SessionConfig};
use geometry::PointCloud;
use nalgebra::{Point3, Vector3};

/// The first `count` of three sides of a box, 80 mm long, as seen from a corner, across z, y and x, `off` along x.
fn sides(count: usize, off: f64) -> Scan {
    let at = |u: usize, v: usize, side: usize| {
        let (u, v) = (0.002 * u as f64, 0.002 * v as f64);
        [Point3::new(u, v, 0.08), Point3::new(u, 0.08, v), Point3::new(0.08, u, v)][side] + off * Vector3::x()
    };
    let points = (0..count).flat_map(|side| (0..40).flat_map(move |u| (0..40).map(move |v| at(u, v, side)))).collect();
    Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(Point3::new(0.7 + off, 0.8, 0.9)) }
}

/// A first scan that holds no other along x, and a second that is off along it.
fn two_scans(adjust: bool, kind: Icp) -> Session {
    let registration =
        RegistrationConfig { register: Register::Refine, gate: false, adjust, kind, ..Default::default() };
    let mut session = Session::new(SessionConfig { registration, ..Default::default() }, None).expect("settings");
    session.add_scan(sides(2, 0.0)).expect("the first scan");
    session.add_scan(sides(3, 0.002)).expect("the second");
    session
}

/// How far the side across x of the second scan is off.
fn off(session: &Session) -> f64 {
    session.scans[1].cloud.points.iter().map(|p| p.x).fold(0.0, f64::max) - 0.08
}

#[test]
fn a_later_scan_moves_an_earlier_one_and_its_camera_and_undo_takes_that_back() {
    let mut session = two_scans(true, Icp::Good);
    let before = session.clone();
    assert!(off(&before) > 1.5e-3, "the first scan does not hold it: {}", off(&before));
    session.add_scan(sides(3, 0.0)).expect("the third");
    let moved = off(&before) - off(&session);
    assert!(moved > 3e-4, "two agree less with it than with each other: {moved}");
    let camera = |session: &Session| session.scans[1].camera_position().expect("known");
    assert!((camera(&before).x - camera(&session).x - moved).abs() < 2e-4, "its camera goes with it");
    let correction = session.corrections().find(|(number, _)| *number == 2).expect("moved").1;
    let given = Point3::new(0.702, 0.8, 0.9);
    assert!((correction * given - camera(&session)).norm() < 1e-9, "the whole correction is told");
    assert!(session.undo());
    for (a, b) in session.cloud().points.iter().zip(&before.cloud().points) {
        assert!((a - b).norm() < 1e-12);
    }
    assert_eq!(session.cloud().len(), before.cloud().len());
    assert!((camera(&session) - camera(&before)).norm() < 1e-12);
}

#[test]
fn where_it_is_not_asked_for_or_icp_is_plain_earlier_scans_stay() {
    for (adjust, kind) in [(false, Icp::Good), (true, Icp::Plain)] {
        let mut session = two_scans(adjust, kind);
        let before = off(&session);
        session.add_scan(sides(3, 0.004)).expect("the third");
        assert_eq!(off(&session), before, "{kind:?}");
    }
}
