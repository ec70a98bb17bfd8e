use super::*;
use crate::constraints::Constraint;
use crate::{Scan, Session, SessionConfig, TurntableConfig};
use geometry::{NeighborGrid, PointCloud};
use nalgebra::Point3;
use std::time::Instant;

/// Two links of 0.4 and 0.3 m about z, and a camera that looks along the second.
fn planar(limit: f64) -> RobotConfig {
    let joint = |name: &str, x: f64, along: f64| Joint {
        name: name.to_owned(),
        kind: JointKind::Revolute,
        xyz_m: [x, 0.0, 0.0],
        rpy_rad: [0.0; 3],
        axis: [0.0, 0.0, 1.0],
        limits: [-limit, limit],
        link: Link {
            name: format!("{name} link"),
            balls_m: (0..8).map(|i| [along * f64::from(i) / 8.0, 0.0, 0.0, 0.03]).collect(),
        },
    };
    let camera = Isometry3::from_parts(
        Vector3::new(0.3, 0.0, 0.0).into(),
        UnitQuaternion::from_matrix(&nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0)),
    );
    RobotConfig {
        flange_from_camera: Some(crate::pose::Pose::from(&camera).matrix),
        camera_body_m: [[-0.02, -0.02, -0.04], [0.02, 0.02, 0.0]],
        arm: Arm { base: Link::default(), joints: vec![joint("first", 0.0, 0.4), joint("second", 0.4, 0.25)] },
        ..Default::default()
    }
}

fn nothing() -> Obstacles<'static> {
    Obstacles { measured: None, expected: None, boxes: &[], floor: None }
}

#[test]
fn the_camera_is_where_the_links_put_it() {
    let reach = Reach::new(&planar(3.0));
    let mut joints = [0.0; MOST_JOINTS];
    (joints[0], joints[1]) = (std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2);
    let camera = reach.camera(&joints);
    assert!((camera.translation.vector - Vector3::new(0.3, 0.4, 0.0)).norm() < 1e-12, "{camera}");
    assert!((camera * Vector3::z() - Vector3::x()).norm() < 1e-12, "it looks along the second link");
    let found = reach.to(&camera, &nothing(), &Isometry3::identity()).expect("within reach");
    let values: Vec<f64> = found.joints.iter().map(|j| j.value).collect();
    assert!((values[0] - joints[0]).abs() < 1e-3 && (values[1] - joints[1]).abs() < 1e-3, "{values:?}");
    assert!((found.travel - std::f64::consts::PI).abs() < 1e-3, "from the middle of the limits");
}

#[test]
fn a_tour_adds_up_what_the_joints_travel_between_the_views_that_it_takes() {
    let reach = Reach::new(&planar(3.0));
    let at = |a: f64, b: f64| {
        let mut joints = [0.0; MOST_JOINTS];
        (joints[0], joints[1]) = (a, b);
        reach.camera(&joints)
    };
    let far = Isometry3::translation(5.0, 0.0, 0.0);
    let tour = |poses: Vec<Isometry3<f64>>| reach.tour(poses, &nothing(), &Isometry3::identity());
    // 0.3 and 0.5 from the first to the second, then back half of it; the way to the first does not count.
    let there = tour(vec![far, at(0.2, 0.4), at(0.5, 0.9), far, at(0.35, 0.65)]);
    assert!((there.travel - 1.2).abs() < 1e-3 && there.unreached == 2, "{there:?}");
    assert_eq!(tour(vec![far, at(0.2, 0.4)]), Tour { travel: 0.0, unreached: 1 });
}

#[test]
fn the_flange_is_told_in_the_arms_base() {
    let cell_from_base = Isometry3::from_parts(
        Vector3::new(0.5, -0.2, 0.1).into(),
        UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
    );
    let config = RobotConfig { cell_from_base: Some(crate::pose::Pose::from(&cell_from_base).matrix), ..planar(3.0) };
    let reach = Reach::new(&config);
    let mut joints = [0.0; MOST_JOINTS];
    (joints[0], joints[1]) = (std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2);
    let flange = reach.base_from_flange(&reach.camera(&joints));
    assert!((flange.translation.vector - Vector3::new(0.0, 0.4, 0.0)).norm() < 1e-9, "at the second joint: {flange}");
    assert!(flange.rotation.angle() < 1e-9, "turned there and back: {flange}");
}

#[test]
fn no_joint_turns_farther_than_it_must() {
    let mut config = planar(6.2);
    config.joints = vec![0.1, -0.1];
    let reach = Reach::new(&config);
    let mut joints = [0.0; MOST_JOINTS];
    (joints[0], joints[1]) = (-4.0, 4.5);
    let pose = reach.camera(&joints);
    for seed in 0..24 {
        let Some(found) = reach.solve(&pose, seed) else { continue };
        let far = |k: usize| (found.joints[k] - config.joints[k]).abs();
        assert!(far(0) < 3.2 && far(1) < 3.2, "start {seed}: {:?}", &found.joints[..2]);
    }
}

#[test]
fn what_keeps_it_away_is_told() {
    let reach = Reach::new(&planar(3.0));
    let mut joints = [0.0; MOST_JOINTS];
    (joints[0], joints[1]) = (0.4, 0.8);
    let pose = reach.camera(&joints);
    let why = |reach: &Reach, pose: &Isometry3<f64>, obstacles: &Obstacles| {
        reach.to(pose, obstacles, &Isometry3::identity()).expect_err("kept away").describe()
    };
    let far = Isometry3::from_parts((2.0 * pose.translation.vector).into(), pose.rotation);
    assert!(why(&reach, &far, &nothing()).starts_with("out of reach: 1.2"), "{}", why(&reach, &far, &nothing()));
    let up = Translation3::new(0.0, 0.0, 0.1) * pose;
    assert!(why(&reach, &up, &nothing()).contains("the nearest found is 0.1"), "{}", why(&reach, &up, &nothing()));
    let narrow = why(&Reach::new(&planar(0.6)), &pose, &nothing());
    assert_eq!(narrow, "only beyond the limits of joint second");
    // A box beside the first link.
    let boxes = [[[0.1, 0.0, -0.1], [0.2, 0.1, 0.1]]];
    let boxed = why(&reach, &pose, &Obstacles { boxes: &boxes, ..nothing() });
    assert!(boxed.starts_with("first link would touch the box (0.100, 0.000, -0.100)"), "{boxed}");
    // Points before the camera's housing, and expected ones; turned away with the table they are no matter.
    let wall = [Point3::from(pose.translation.vector)];
    let grid = NeighborGrid::new(&wall, 0.05);
    let touched = why(&reach, &pose, &Obstacles { measured: Some((&wall, &grid)), ..nothing() });
    assert!(touched.contains("would touch measured surface"), "{touched}");
    let touched = why(&reach, &pose, &Obstacles { expected: Some((&wall, &grid)), ..nothing() });
    assert!(touched.contains("surface expected in unknown space"), "{touched}");
    let turned = Isometry3::rotation(Vector3::z() * 3.0);
    let away = reach.to(&pose, &Obstacles { measured: Some((&wall, &grid)), ..nothing() }, &turned);
    assert!(away.is_ok(), "{away:?}");
}

#[test]
fn it_touches_what_the_object_stands_on() {
    let mut joints = [0.0; MOST_JOINTS];
    (joints[0], joints[1]) = (0.4, 0.8);
    let pose = Reach::new(&planar(3.0)).camera(&joints);
    let (eye, ahead) = (Point3::from(pose.translation.vector), pose * Vector3::z());
    let lattice = || (0..1600).map(|i| [i % 40, i / 40].map(|x| 0.005 * (f64::from(x) - 19.5)));
    // A board to look at, and the support's plane, which the first link goes through.
    let across = [ahead.cross(&Vector3::z()), Vector3::z()];
    let object = lattice().map(|[u, v]| eye + ahead * 0.35 + across[0] * u + across[1] * v);
    let table = lattice().map(|[u, v]| Point3::new(0.25 + u, 0.1, v));
    let config = SessionConfig {
        robot: Some(RobotConfig { avoid_unknown: false, ..planar(3.0) }),
        support: crate::Support::plane([0.0, 1.0, 0.0, 0.1]),
        working_distance_m: 0.35,
        ..Default::default()
    };
    let mut session = Session::new(config, None).expect("in range");
    session.set_given_views(vec![pose]);
    let against = |session: &Session| session.place(&session.state().given()[0]).objections;
    let scan =
        |points: Vec<Point3<f64>>| Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(eye) };
    session.add_scan(scan(object.clone().collect())).expect("a scan");
    assert!(against(&session).is_empty(), "the board alone: {:?}", against(&session));
    let report = session.add_scan(scan(object.chain(table).collect())).expect("a scan");
    assert_eq!(report.on_support, 1600);
    let touched = against(&session);
    assert!(touched.len() == 1 && touched[0].reason.contains("first link would touch measured surface"), "{touched:?}");
    assert!(session.undo() && against(&session).is_empty(), "gone with its scan");
}

#[test]
fn hand_eye_calibrations_go_either_way_and_not_both() {
    let one = planar(3.0);
    let inverse = one.flange_from_camera().inverse();
    let mut other = RobotConfig { camera_from_flange: Some(crate::pose::Pose::from(&inverse).matrix), ..one.clone() };
    assert_eq!(other.check().expect_err("both").key, "robot.camera_from_flange");
    other.flange_from_camera = None;
    assert_eq!(other.check(), Ok(()));
    let joints = [0.3; MOST_JOINTS];
    let apart = Reach::new(&one).camera(&joints).inverse() * Reach::new(&other).camera(&joints);
    assert!(apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 1e-9);
    other.camera_from_flange = None;
    assert_eq!(other.check().expect_err("neither").key, "robot.flange_from_camera");
    assert_eq!(RobotConfig { arm: Arm::default(), ..one.clone() }.check().expect_err("no arm").key, "robot.arm");
    assert_eq!(RobotConfig { joints: vec![1.0], ..one }.check().expect_err("one of two").key, "robot.joints");
}

/// An arm of six joints as large as a table, beside the object.
fn six() -> RobotConfig {
    let quarter = std::f64::consts::FRAC_PI_2;
    let rows = [
        ([0.0, 0.0, 0.1625], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [quarter, 0.0, 0.0]),
        ([-0.425, 0.0, 0.0], [0.0; 3]),
        ([-0.3922, 0.0, 0.1333], [0.0; 3]),
        ([0.0, -0.0997, 0.0], [quarter, 0.0, 0.0]),
        ([0.0, 0.0996, 0.0], [quarter, std::f64::consts::PI, std::f64::consts::PI]),
    ];
    let joint = |(i, (xyz_m, rpy_rad)): (usize, ([f64; 3], [f64; 3]))| Joint {
        name: format!("joint {i}"),
        kind: JointKind::Revolute,
        xyz_m,
        rpy_rad,
        axis: [0.0, 0.0, 1.0],
        limits: [-6.2, 6.2],
        link: Link { name: format!("link {i}"), balls_m: vec![[0.0, 0.0, 0.0, 0.06]] },
    };
    RobotConfig {
        cell_from_base: Some(crate::pose::Pose::from(&Isometry3::translation(-0.55, 0.0, 0.0)).matrix),
        flange_from_camera: Some(crate::pose::Pose::from(&Isometry3::translation(0.0, 0.05, 0.03)).matrix),
        arm: Arm { base: Link::default(), joints: rows.into_iter().enumerate().map(joint).collect() },
        ..Default::default()
    }
}

fn session(robot: Option<RobotConfig>, turntable: Option<TurntableConfig>) -> Session {
    let config = SessionConfig { robot, turntable, working_distance_m: 0.35, ..Default::default() };
    let mut session = Session::new(config, None).expect("in range");
    let mut points = Vec::new();
    // The side of a ball of 8 cm, 15 cm up, that looks to the arm.
    for i in 0..6000 {
        let z = 1.0 - (f64::from(i) + 0.5) / 3000.0;
        let (sin, cos) = (2.399_963 * f64::from(i)).sin_cos();
        let n = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        if n.x < -0.2 {
            points.push(Point3::new(0.0, 0.0, 0.15) + 0.08 * n);
        }
    }
    let from = Some(Point3::new(-0.43, 0.0, 0.15));
    session.add_scan(Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }).expect("a scan");
    session
}

#[test]
fn an_arm_rules_out_what_it_does_not_reach_and_a_table_brings_it_round() {
    let free = session(None, None).next_view().expect("an answer");
    assert!(free.candidates.iter().all(|c| c.reached.is_none()));
    let mut one = session(Some(six()), None);
    let (clock, answer) = (Instant::now(), one.next_view().expect("an answer"));
    println!("{} candidates with an arm in {:?}", answer.candidates.len(), clock.elapsed());
    let reach = Reach::new(&six());
    for candidate in &answer.candidates {
        let arm =
            candidate.objections.iter().any(|o| matches!(o.constraint, Constraint::Reach | Constraint::Collision));
        assert!(candidate.reached.is_some() != arm || !candidate.objections.is_empty(), "{candidate:?}");
        let Some(reached) = &candidate.reached else { continue };
        let joints = std::array::from_fn(|k| reached.joints.get(k).map_or(0.0, |j| j.value));
        let wanted = crate::pose::rigid(&candidate.world_from_camera.matrix).expect("a pose").0;
        let off = reach.camera(&joints).inverse() * wanted;
        assert!(off.translation.vector.norm() < 1e-4 && off.rotation.angle() < 1e-3, "{off}");
    }
    let reached = |answer: &crate::Answer| answer.candidates.iter().filter(|c| c.reached.is_some()).count();
    let far_side = |answer: &crate::Answer| {
        answer.candidates.iter().filter(|c| c.reached.is_some() && c.position_m[0] > 0.1).count()
    };
    let stops = TurntableConfig { range_deg: Some([0.0, 360.0]), step_deg: 45.0, ..Default::default() };
    let turned = session(Some(six()), Some(stops)).next_view().expect("an answer");
    println!("reached: {} of {}, with a table {}", reached(&answer), answer.candidates.len(), reached(&turned));
    assert!(
        reached(&turned) > reached(&answer) && far_side(&turned) > far_side(&answer),
        "the table brings views round"
    );
    assert!(reached(&answer) > 0 && reached(&answer) < answer.candidates.len());
}
