use super::*;
use crate::constraints::Constraint;
use crate::{NoReturn, Scan, Session, SessionConfig};
use geometry::{DepthImage, PinholeCamera, View};

/// A ball of 5 cm radius on a tilted table, as a depth camera sees them; the table's plane.
fn on_a_table(table_size: f64) -> (Scan, Plane) {
    let normal = Vector3::new(0.1, -0.05, 1.0).normalize();
    let plane = Plane { normal: normal.into(), offset_m: 0.3 };
    let foot = Point3::from(normal * 0.3);
    let center = foot + normal * 0.05;
    let view = View { target: center, position: center + Vector3::new(0.35, 0.1, 0.35) };
    let pose = view.world_from_camera();
    let camera = PinholeCamera { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 159.5, cy: 119.5 };
    let eye = Point3::from(pose.translation.vector);
    let mut depth = Vec::new();
    for row in 0..240 {
        for column in 0..320 {
            let local = camera.unproject(f64::from(column), f64::from(row), 1.0);
            let ray = pose.rotation * local.coords;
            let on_plane = (0.3 - normal.dot(&eye.coords)) / normal.dot(&ray);
            let hit = eye + on_plane * ray;
            let on_table = (on_plane > 0.0 && (hit - foot).amax() < table_size).then_some(on_plane);
            let (a, b, c) = (ray.norm_squared(), ray.dot(&(eye - center)), (eye - center).norm_squared() - 0.0025);
            let root = b * b - a * c;
            let on_ball = (root > 0.0).then(|| (-b - root.sqrt()) / a);
            depth.push(on_ball.or(on_table).unwrap_or(0.0) as f32);
        }
    }
    let depth = DepthImage { origin: [0, 0], size: [320, 240], depth };
    (Scan::Depth { camera, depth, world_from_camera: pose, misses: NoReturn::Unknown }, plane)
}

fn points(scan: &Scan) -> Vec<Point3<f64>> {
    match scan {
        Scan::Depth { camera, depth, world_from_camera, .. } => depth.to_points(camera, world_from_camera),
        Scan::Cloud { cloud, .. } | Scan::Lines { cloud, .. } => cloud.points.clone(),
    }
}

#[test]
fn the_table_is_found_and_nothing_else_is() {
    let (scan, plane) = on_a_table(0.15);
    let all = points(&scan);
    let found = find(&all, &Vector3::z(), 0.003, 0).expect("a table");
    let angle = Vector3::from(found.normal).angle(&Vector3::from(plane.normal)).to_degrees();
    assert!(angle < 0.05 && (found.offset_m - 0.3).abs() < 1e-4, "{angle} degrees, {} m", found.offset_m);
    assert_eq!(Some(found), find(&all, &Vector3::z(), 0.003, 0), "the same again");
    let ball: Vec<Point3<f64>> = all.iter().filter(|p| plane.height(p) > 0.004).copied().collect();
    assert_eq!(find(&ball, &Vector3::z(), 0.003, 0), None, "no table under the ball alone");
    assert_eq!(find(&all, &Vector3::x(), 0.003, 0), None, "no wall is a table");
    // The lid of a box is not what the box stands on.
    let lid = (0..2500).map(|i| Point3::new(f64::from(i % 50) * 0.002, f64::from(i / 50) * 0.002, 0.1));
    let side = (0..2500).map(|i| Point3::new(f64::from(i % 50) * 0.002, 0.0, f64::from(i / 50) * 0.002));
    assert_eq!(find(&lid.chain(side).collect::<Vec<_>>(), &Vector3::z(), 0.003, 0), None);
}

/// Points of a sheet from `from` along `a` and `b`, 3 mm apart.
fn sheet(from: [f64; 3], a: Vector3<f64>, b: Vector3<f64>) -> Vec<Point3<f64>> {
    let [m, n] = [a, b].map(|edge| (edge.norm() / 0.003).ceil() as usize);
    let at = |i: usize, j: usize| Point3::from(from) + a * (i as f64 / m as f64) + b * (j as f64 / n as f64);
    (0..=m).flat_map(|i| (0..=n).map(move |j| at(i, j))).collect()
}

#[test]
fn the_edge_of_a_table_may_show_and_the_body_under_a_lid_may_not() {
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    let find = |parts: &[Vec<Point3<f64>>]| find(&parts.concat(), &z, 0.002, 0);
    let top = sheet([-0.2, -0.2, 0.0], x * 0.4, y * 0.4);
    let edge = sheet([-0.2, -0.2, -0.003], x * 0.4, -z * 0.017);
    let thing =
        [sheet([-0.05, -0.05, 0.003], x * 0.1, z * 0.097), sheet([-0.05, -0.05, 0.1], x * 0.1, y * 0.1)].concat();
    let floor = sheet([-0.6, 0.25, -0.7], x * 1.2, y * 0.3);
    let table = find(&[top.clone(), edge, thing.clone(), floor]).expect("a table with its edge, above the floor");
    assert!(table.offset_m.abs() < 1e-3 && table.normal[2] > 0.9999, "{table:?}");
    // A box of 30 cm with a small one on it.
    let body = sheet([-0.2, -0.2, -0.003], x * 0.4, -z * 0.3);
    assert_eq!(find(&[top, body, thing]), None);
    // A cut through a dome is no layer.
    let dome: Vec<Point3<f64>> = sheet([-0.1, -0.1, 0.0], x * 0.2, y * 0.2)
        .into_iter()
        .map(|p| Point3::new(p.x, p.y, -4.0 * (p.x * p.x + p.y * p.y)))
        .collect();
    assert_eq!(find(&[dome]), None);
}

fn session(support: Support) -> Session {
    let config = SessionConfig { support, working_distance_m: 0.5, max_points: 0, ..Default::default() };
    let mut session = Session::new(config, None).expect("in range");
    session.add_scan(on_a_table(0.15).0).expect("a scan");
    session
}

#[test]
fn it_is_taken_away_and_no_camera_goes_under_it() {
    let (_, plane) = on_a_table(0.15);
    let kept = session(Support::None);
    let mut found = session(Support::Auto);
    let mut given = session(Support::plane([0.2, -0.1, 2.0, 0.6 * (0.0125f64 + 1.0).sqrt()]));
    let on = |s: &Session| s.cloud().points.iter().filter(|p| plane.height(p).abs() < 0.003).count();
    assert!(on(&kept) > 10_000 && on(&found) == 0 && on(&given) == 0);
    let ball = found.cloud().len();
    assert!(ball > 2_000 && found.cloud().points.iter().all(|p| plane.height(p) < 0.11), "the ball is left: {ball}");
    assert_eq!(ball, given.cloud().len());
    for session in [&mut found, &mut given] {
        let answer = session.next_view().expect("an answer");
        let support = answer.support.expect("told");
        assert!((support.offset_m - 0.3).abs() < 1e-3, "{support:?}");
        let missing = answer.missing.expect("made out");
        let deepest = missing.holes.iter().map(|h| support.height(&h.center_m.into())).fold(f64::INFINITY, f64::min);
        assert!(deepest > -0.01, "nothing is missing under the table: {missing:?}");
        for candidate in &answer.candidates {
            let under = support.height(&Point3::from(candidate.position_m)) <= 0.0;
            let objected = candidate.objections.iter().any(|o| o.constraint == Constraint::Support);
            assert_eq!(under, objected, "{candidate:?}");
        }
        assert!(answer.candidates.iter().any(|c| !c.objections.is_empty()), "some would stand under it");
        assert!(answer.next.is_some_and(|next| support.height(&Point3::from(next.position_m)) > 0.0));
    }
    // The same table for later scans, and another for another object.
    found.add_scan(on_a_table(0.15).0).expect("a scan");
    assert_eq!(on(&found), 0);
    found.reset();
    assert!(found.support().is_none());
}

#[test]
fn undo_forgets_the_support_with_the_scan_that_showed_it() {
    let mut session = session(Support::Auto);
    session.reset();
    let (scan, plane) = on_a_table(0.15);
    let mut ball = points(&scan);
    ball.retain(|p| plane.height(p) > 0.01);
    let cloud = geometry::PointCloud { points: ball, normals: Vec::new() };
    session.add_scan(Scan::Cloud { cloud, from: None }).expect("the ball alone");
    assert!(session.support().is_none());
    session.add_scan(scan.clone()).expect("with its table");
    session.add_scan(scan).expect("again");
    assert!(session.undo() && session.support().is_some(), "the second showed it");
    assert!(session.undo() && session.support().is_none());
    assert!(session.next_view().expect("an answer").support.is_none());
}

#[test]
fn a_support_that_was_found_is_taken_up_again() {
    let mut session = session(Support::Auto);
    let found = session.support().expect("found");
    for (support, holds) in [(Support::None, None), (Support::Auto, Some(found))] {
        session.configure(SessionConfig { support, ..session.config().clone() }).expect("in range");
        assert_eq!(session.support(), holds);
    }
    let answer = session.next_view().expect("an answer");
    assert_eq!(answer.support, Some(found));
    assert!(!answer.warnings.iter().any(|w| w.starts_with("support = auto")), "{:?}", answer.warnings);
    assert!(session.undo() && session.support().is_none());
}

#[test]
fn points_that_are_no_part_of_a_scan_do_not_hide_the_table() {
    let (scan, plane) = on_a_table(0.15);
    let eye = scan.camera_position().expect("a pose");
    let finds_table = |more: Vec<Point3<f64>>, config: SessionConfig| {
        let cloud = geometry::PointCloud { points: [points(&scan), more].concat(), normals: Vec::new() };
        let config = SessionConfig { support: Support::Auto, working_distance_m: 0.5, ..config };
        let mut session = Session::new(config, None).expect("in range");
        session.add_scan(Scan::Cloud { cloud, from: Some(eye) }).expect("a scan");
        session.support().is_some_and(|found| (found.offset_m - plane.offset_m).abs() < 1e-3)
    };
    let plain = SessionConfig::default;
    assert!(finds_table(vec![Point3::new(1e30, 1e30, 1e30); 20], plain()), "marks far away");
    assert!(finds_table(vec![eye; 400], plain()), "marks at the camera");
    // A floor that shows more points than the table.
    let floor =
        || (0..40_000).map(|i| Point3::new(0.02 * f64::from(i % 200) - 2.0, 0.02 * f64::from(i / 200) - 2.0, -0.5));
    assert!(!finds_table(floor().collect(), plain()));
    let sensor = crate::SensorConfig { max_range_m: Some(1.0), ..Default::default() };
    assert!(finds_table(floor().collect(), SessionConfig { sensor, ..plain() }), "out of range");
    let region_m = Some([[-0.2, -0.2, 0.2], [0.25, 0.25, 0.6]]);
    assert!(finds_table(floor().collect(), SessionConfig { region_m, ..plain() }), "outside of the region");
}

#[test]
fn a_given_support_far_below_everything_is_doubted() {
    let (_, plane) = on_a_table(0.15);
    let doubted = |offset_m: f64| {
        let mut session = session(Support::Plane(Plane { offset_m, ..plane }));
        let warnings = session.next_view().expect("an answer").warnings;
        warnings.iter().any(|w| w.starts_with("the given support lies 20"))
    };
    assert!(doubted(plane.offset_m - 20.0) && !doubted(plane.offset_m));
}

#[test]
fn the_underside_that_rests_on_it_is_not_missing() {
    let missing = |support: Support| {
        let config = SessionConfig { support, working_distance_m: 1.0, ..Default::default() };
        let mut session = Session::new(config, None).expect("in range");
        let at = |i: u32| 0.1 * f64::from(i) / 40.0;
        let points = (0..1600).map(|i| Point3::new(at(i % 40), at(i / 40), 0.0)).collect();
        let cloud = geometry::PointCloud { points, normals: Vec::new() };
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.05, 0.05, 1.0)) }).expect("a scan");
        session.next_view().expect("an answer").missing.expect("made out")
    };
    let (free, resting) = (missing(Support::None), missing(Support::plane([0.0, 0.0, 1.0, -0.01])));
    assert!(free.share > 0.3 && free.out_of_reach_share < 0.01, "{free:?}");
    assert!(resting.share < 0.5 * free.share, "{resting:?}");
}

#[test]
fn planes_are_read_as_they_are_written() {
    let read = |text: &str| toml::from_str::<SessionConfig>(text).map(|c| c.support);
    assert_eq!(read("support = \"auto\""), Ok(Support::Auto));
    assert_eq!(
        read("support = [0.0, 0.0, 2.0, 1.0]"),
        Ok(Support::Plane(Plane { normal: [0.0, 0.0, 1.0], offset_m: 0.5 }))
    );
    assert!(read("support = \"table\"").expect_err("a word").to_string().contains("expected \"auto\""));
    assert!(Support::plane([0.0, 0.0, 0.0, 1.0]).check().is_err());
}
