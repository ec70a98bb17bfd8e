use super::*;
use crate::{Scan, Session, SessionConfig};

/// The upper half of a tube of 0.05 m radius and 0.3 m length along x.
fn tube() -> PointCloud {
    let at = |i: usize, j: usize| {
        let turn = std::f64::consts::PI * (j as f64 + 0.5) / 40.0;
        Point3::new(0.004 * i as f64, 0.05 * turn.cos(), 0.05 * turn.sin())
    };
    let points = (0..75).flat_map(|i| (0..40).map(move |j| at(i, j))).collect();
    PointCloud { points, normals: Vec::new() }
}

/// Above it, from before its beginning to past its end, given the other way round.
const PATH: [[f64; 3]; 2] = [[0.5, 0.0, 0.6], [-0.2, 0.0, 0.6]];

fn path() -> [Point3<f64>; 2] {
    PATH.map(Point3::from)
}

#[test]
fn pieces_hold_every_point_once_and_are_seen_from_abreast() {
    let cloud = tube();
    let pieces = pieces(&path(), &cloud.points);
    assert_eq!(pieces.len(), PIECES);
    assert_eq!(pieces.iter().map(|(_, points)| points.len()).sum::<usize>(), cloud.len());
    let width = 0.296 / PIECES as f64;
    for (from, points) in &pieces {
        assert_eq!((from.y, from.z), (0.0, 0.6));
        assert!(points.iter().all(|p| (p.x - from.x).abs() < 0.5 * width + 1e-9), "{from}");
    }
    assert!((pieces[0].0.x - 0.148).abs() < 1e-9, "the middle stands for all: {}", pieces[0].0);
    assert_eq!(super::pieces(&path(), &cloud.points[..40]).len(), 1, "a single line of points");
}

#[test]
fn a_session_plans_on_what_a_line_scanner_saw_from_its_path() {
    let session = |path: [Point3<f64>; 2]| {
        let mut session = Session::new(SessionConfig::default(), None).expect("settings");
        session.add_scan(Scan::Lines { cloud: tube(), path }).expect("a scan");
        session
    };
    let mut along = session(path());
    let towards = |i: usize| {
        along.state().cloud.normals[i]
            .dot(&(abreast(&path(), &along.state().cloud.points[i]) - along.state().cloud.points[i]))
    };
    assert!((0..along.state().cloud.len()).all(|i| towards(i) > 0.0), "normals face the path");
    assert_eq!(along.state().scans.len(), PIECES);
    let answer = along.next_view().expect("an answer");
    assert_eq!(answer.planner, "volumetric", "{}", answer.planner_reason);
    let next = answer.next.expect("a view");
    assert!(next.position_m[2] < 0.3, "the lower half is missing: {:?}", next.position_m);
    assert!(along.undo() && along.state().scans.is_empty());
    // Such a path lies in the tube, and such a one in another unit.
    for (path, inside) in
        [(PATH.map(|[x, y, _]| Point3::new(x, y, 0.05)), true), (PATH.map(|p| Point3::from(p) * 1e6), false)]
    {
        let warnings = session(path).next_view().expect("an answer").warnings;
        let why = if inside { "lies in its points" } else { "a different unit" };
        assert!(warnings.iter().any(|w| w.contains(why)), "{warnings:?}");
    }
}
