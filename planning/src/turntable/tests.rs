use super::*;
use crate::{ConstraintsConfig, Reading, Session, SessionError};
use geometry::{PointCloud, View};

fn table() -> TurntableConfig {
    TurntableConfig {
        axis_point_m: [0.4, 0.1, 0.0],
        range_deg: Some([0.0, 360.0]),
        step_deg: 30.0,
        ..Default::default()
    }
}

/// Rows of the pose of a camera that looks at the object from one side, a little from above.
fn fixed() -> [[f64; 4]; 4] {
    let view = View { target: Point3::new(0.4, 0.1, 0.05), position: Point3::new(0.9, 0.1, 0.35) };
    crate::pose::Pose::from(&view.world_from_camera_with_up(&Vector3::z())).matrix
}

#[test]
fn the_table_turns_about_its_axis() {
    let mut table = table();
    let quarter = table.cell_from_object(90.0);
    assert!((quarter * Point3::new(0.5, 0.1, 0.2) - Point3::new(0.4, 0.2, 0.2)).norm() < 1e-12, "counter-clockwise");
    assert!((quarter * Point3::new(0.4, 0.1, 7.0) - Point3::new(0.4, 0.1, 7.0)).norm() < 1e-12, "the axis stays");
    assert_eq!(table.stops().len(), 12, "360 is 0 again");
    table.range_deg = Some([-90.0, 90.0]);
    assert_eq!(table.stops(), [-90.0, -60.0, -30.0, 0.0, 30.0, 60.0, 90.0]);
}

#[test]
fn the_object_sees_up_turn_where_the_axis_is_tilted() {
    let up = |axis_direction: [f64; 3], angle: f64| {
        let turntable = Some(TurntableConfig { axis_direction, ..table() });
        SessionConfig { turntable, ..Default::default() }.up_in_object(angle)
    };
    assert!((up([1.0, 0.0, 0.0], 90.0) - Vector3::y()).norm() < 1e-12, "what was its side is above");
    assert_eq!(up([0.0, 0.0, 1.0], 40.0), Vector3::z());
    assert_eq!(SessionConfig::default().up_in_object(40.0), Vector3::z());
}

#[test]
fn values_without_a_meaning_are_refused() {
    let refused = |table: TurntableConfig, key: &str| assert_eq!(table.check().expect_err(key).key, key);
    assert_eq!(table().check(), Ok(()));
    refused(TurntableConfig::default(), "turntable.stops_deg");
    refused(TurntableConfig { axis_direction: [0.0; 3], ..table() }, "turntable.axis_direction");
    refused(TurntableConfig { stops_deg: vec![1.0], ..table() }, "turntable.range_deg");
    refused(TurntableConfig { range_deg: Some([0.0, 400.0]), ..table() }, "turntable.range_deg");
    refused(TurntableConfig { step_deg: 0.01, ..table() }, "turntable.step_deg");
    refused(TurntableConfig { cell_from_camera: Some([[0.0; 4]; 4]), ..table() }, "turntable.cell_from_camera");
}

/// The top and one side of a box of 10 cm, as the camera sees it with the table at `angle`, in the cell's frame.
fn seen(table: &TurntableConfig, angle: f64) -> (Scan, Vec<Point3<f64>>) {
    let cell_from_object = table.cell_from_object(angle);
    let camera = Point3::new(0.9, 0.1, 0.35);
    let mut points = Vec::new();
    for i in 0..50 {
        for j in 0..50 {
            let (a, b) = (f64::from(i) * 0.002 - 0.05, f64::from(j) * 0.002);
            let sides = [
                (Point3::new(0.45, 0.1 + a, b), Vector3::x()),
                (Point3::new(0.35, 0.1 + a, b), -Vector3::x()),
                (Point3::new(0.4 + a, 0.15, b), Vector3::y()),
                (Point3::new(0.4 + a, 0.05, b), -Vector3::y()),
                (Point3::new(0.4 + a, 0.05 + b, 0.1), Vector3::z()),
            ];
            let visible = |(p, n): &(Point3<f64>, Vector3<f64>)| {
                (camera - cell_from_object * p).dot(&(cell_from_object * n)) > 0.05
            };
            points.extend(sides.into_iter().filter(visible).map(|(p, _)| p));
        }
    }
    let cloud = PointCloud { points: points.iter().map(|p| cell_from_object * p).collect(), normals: Vec::new() };
    (Scan::Cloud { cloud, from: Some(camera) }, points)
}

fn session(table: &TurntableConfig, constraints: ConstraintsConfig) -> Session {
    let config = SessionConfig {
        turntable: Some(table.clone()),
        working_distance_m: 0.55,
        max_points: 0,
        constraints,
        ..Default::default()
    };
    Session::new(config, None).expect("in range")
}

fn add(session: &mut Session, table: &TurntableConfig, angle: f64) {
    let reading = Reading { table_angle_deg: Some(angle), ..Default::default() };
    session.add_scan_within(seen(table, angle).0, reading, &Default::default()).expect("a scan");
}

#[test]
fn a_fixed_camera_looks_at_every_side_stop_by_stop() {
    let table = TurntableConfig { cell_from_camera: Some(fixed()), ..table() };
    let mut session = session(&table, ConstraintsConfig::default());
    let mut angle = 60.0;
    let mut stops = vec![angle];
    for _ in 0..3 {
        add(&mut session, &table, angle);
        let answer = session.next_view().expect("an answer");
        assert_eq!(answer.candidates.len(), 12);
        let next = answer.next.expect("a stop is left");
        let placed = next.table.expect("a stop");
        let fixed = table.fixed_camera().expect("fixed");
        let cell = rigid(&placed.cell_from_camera.matrix).expect("a pose").0;
        assert!((cell.translation.vector - fixed.translation.vector).norm() < 1e-9, "the camera stands still");
        let own = rigid(&next.world_from_camera.matrix).expect("a pose").0;
        let back = table.cell_from_object(placed.stop_deg) * own;
        assert!(
            (back.translation.vector - fixed.translation.vector).norm() < 1e-9
                && back.rotation.angle_to(&fixed.rotation) < 1e-6
        );
        assert!(!stops.contains(&placed.stop_deg), "{} again, after {stops:?}", placed.stop_deg);
        angle = placed.stop_deg;
        stops.push(angle);
    }
    // The second stop shows the other side.
    let apart = (stops[1] - stops[0]).rem_euclid(360.0);
    assert!((90.0..=270.0).contains(&apart), "{stops:?}");
    // All in one frame: each point of the cloud is one of the box.
    let (_, mut all) = seen(&table, stops[0]);
    stops.iter().for_each(|stop| all.extend(seen(&table, *stop).1));
    let off = |p: &Point3<f64>| all.iter().map(|q| (p - q).norm()).fold(f64::INFINITY, f64::min);
    assert!(session.cloud().points.iter().step_by(97).all(|p| off(p) < 1e-6), "scans lie on each other");
}

#[test]
fn a_camera_on_an_arm_gets_the_stop_that_its_cell_allows() {
    let table = table();
    // The arm stands on the side of large x.
    let constraints =
        ConstraintsConfig { workspace_m: Some([[0.45, -1.0, -1.0], [2.0, 1.0, 1.0]]), ..Default::default() };
    let mut session = session(&table, constraints);
    add(&mut session, &table, 0.0);
    let answer = session.next_view().expect("an answer");
    let allowed: Vec<_> = answer.candidates.iter().filter(|c| c.objections.is_empty()).collect();
    let turned = allowed.iter().filter(|c| c.table.as_ref().is_some_and(|t| t.stop_deg != 0.0)).count();
    assert!(turned > 5 && allowed.iter().all(|c| c.position_in_cell().x >= 0.45), "{turned} of {}", allowed.len());
    let beyond = allowed.iter().filter(|c| c.position_m[0] < 0.4).count();
    assert!(beyond > 3, "the far side comes round: {beyond}");
    // Taught poses of the arm, at every stop.
    let taught = rigid(&fixed()).expect("a pose").0;
    let higher = nalgebra::Translation3::new(0.0, 0.0, 0.05) * taught;
    session.set_given_views(vec![taught, higher]);
    let answer = session.next_view().expect("an answer");
    assert_eq!(answer.candidates.len(), 24);
    for candidate in &answer.candidates {
        let own = [taught, higher][candidate.given.expect("of those given")].translation.vector;
        assert!((candidate.position_in_cell().coords - own).norm() < 1e-9, "{candidate:?}");
    }
    let next = answer.next.as_ref().expect("one is allowed");
    let camera = next.position_in_cell();
    let told = format!("  camera  {:.4} {:.4} {:.4} ", camera.x, camera.y, camera.z);
    assert!(answer.to_text().contains(&told), "{told}\n{}", answer.to_text());
}

#[test]
fn an_angle_without_a_table_is_refused() {
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    let reading = Reading { table_angle_deg: Some(30.0), ..Default::default() };
    let refused = session.add_scan_within(seen(&table(), 0.0).0, reading, &Default::default());
    assert_eq!(refused, Err(SessionError::NoTurntable(30.0)));
}

#[test]
fn what_is_missing_does_not_depend_on_whether_the_table_or_the_camera_turns() {
    let table = TurntableConfig { step_deg: 90.0, ..table() };
    let taught = rigid(&fixed()).expect("a pose").0;
    let asked = |turntable: Option<TurntableConfig>, views: Vec<Isometry3<f64>>| {
        let config = SessionConfig { turntable, working_distance_m: 0.58, ..Default::default() };
        let mut session = Session::new(config, None).expect("in range");
        session.set_given_views(views);
        session.add_scan(seen(&table, 0.0).0).expect("a scan");
        session.next_view().expect("an answer")
    };
    let (turned, around) = (asked(Some(table.clone()), vec![taught]), asked(None, table.views(&[taught])));
    let (a, b) = (turned.missing.expect("made out"), around.missing.expect("made out"));
    assert!(
        (a.share - b.share).abs() < 1e-6 && (a.out_of_reach_share - b.out_of_reach_share).abs() < 1e-6,
        "{a:?} {b:?}"
    );
    assert!(a.share > 0.2, "{a:?}");
    let seen_by = |answer: &[crate::Hole]| answer.iter().map(|hole| hole.within_reach).collect::<Vec<_>>();
    let close = seen_by(&a.holes).iter().zip(seen_by(&b.holes)).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(close && a.holes.len() == b.holes.len(), "{a:?} {b:?}");
}
