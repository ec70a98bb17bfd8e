use super::*;
use crate::config::CameraConfig;
use crate::pose::{PoseConfig, rigid};
use crate::{NoReturn, Scan};
use geometry::{DepthImage, PointCloud};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

/// A session with a sheet of 10 cm, seen from a metre above.
fn session(config: SessionConfig) -> Session {
    let at = |i: usize| 0.0025 * i as f64;
    let points = (0..1600).map(|i| Point3::new(at(i % 40), at(i / 40), 0.0)).collect();
    let cloud = PointCloud { points, normals: Vec::new() };
    let mut session = Session::new(config, None).expect("settings in range");
    session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.05, 0.05, 1.0)) }).expect("a scan");
    session
}

/// Settings with which overlaps are told, estimated from the cloud alone, of this camera.
fn estimating(width: u32, height: u32, intrinsics: [f64; 4]) -> SessionConfig {
    let camera = CameraConfig { width, height, intrinsics: Some(intrinsics), ..Default::default() };
    let constraints = ConstraintsConfig { min_overlap: 1e-6, ..Default::default() };
    SessionConfig { planner: PlannerName::Farthest, camera, constraints, ..Default::default() }
}

fn overlap(candidate: &Candidate) -> f64 {
    candidate.expected_overlap.expect("asked for")
}

#[test]
fn given_views_that_differ_in_roll_alone_are_told_apart() {
    // Beside the sheet, looking straight down; most of the image is on the side of the camera's +X.
    let mut session = session(estimating(400, 720, [514.0, 514.0, 100.0, 360.0]));
    let at = Translation3::new(0.3, 0.05, 1.2);
    let [away, toward] = [Quaternion::new(0.0, 1.0, 0.0, 0.0), Quaternion::new(0.0, 0.0, 1.0, 0.0)];
    let poses = [away, toward].map(|turn| Isometry3::from_parts(at, UnitQuaternion::new_unchecked(turn)));
    session.set_given_views(poses.to_vec());
    let given = session.state().given();
    assert_eq!(given[0], given[1], "one position and one target");
    let candidates = session.next_view().expect("an answer").candidates;
    let told = |i: usize| candidates.iter().find(|c| c.given == Some(i)).expect("answered");
    for (i, pose) in poses.iter().enumerate() {
        assert_eq!(told(i).world_from_camera, Pose::from(pose), "{i}");
    }
    assert!((overlap(told(0)) - 0.325).abs() < 0.02, "a third is in the image: {}", overlap(told(0)));
    assert!(overlap(told(1)) > 0.99, "all of it: {}", overlap(told(1)));
}

#[test]
fn what_is_expected_of_a_view_is_of_its_image_as_it_is_turned() {
    // An image that is much wider than high.
    let told = |extra_roll_deg: f64, given: &[Candidate]| {
        let pose = PoseConfig { extra_roll_deg, ..Default::default() };
        let camera = estimating(400, 40, [500.0, 500.0, 200.0, 20.0]);
        let mut session = session(SessionConfig { pose, working_distance_m: 0.6, ..camera });
        session.set_given_views(given.iter().map(Candidate::pose).collect());
        session.next_view().expect("an answer").candidates
    };
    let turned = told(90.0, &[]);
    for candidate in told(0.0, &turned) {
        let same = &turned[candidate.given.expect("one of those given")];
        assert!((overlap(&candidate) - overlap(same)).abs() < 0.02, "{candidate:?} {same:?}");
    }
    let upright = told(0.0, &[]);
    let differs = |t: &&Candidate| {
        let same = upright.iter().find(|u| u.position_m == t.position_m).expect("the same views");
        (overlap(same) - overlap(t)).abs() > 0.05
    };
    assert!(turned.iter().filter(differs).count() > 5, "the image is turned");
}

#[test]
fn images_are_upright_in_the_cell_whichever_way_the_table_turns() {
    let turned = |axis_direction: [f64; 3]| {
        let table = TurntableConfig { axis_direction, stops_deg: vec![90.0], ..Default::default() };
        let mut session = session(SessionConfig { turntable: Some(table.clone()), ..Default::default() });
        let candidates = session.next_view().expect("an answer").candidates;
        for candidate in &candidates {
            let told = candidate.table.as_ref().expect("a stop");
            let (in_cell, _) = rigid(&told.cell_from_camera.matrix).expect("a pose");
            let [right, up] = [Vector3::x(), -Vector3::y()].map(|axis| in_cell * axis);
            assert!(right.z.abs() < 1e-6 && up.z > -1e-6, "{axis_direction:?}: {in_cell}");
            let from_object = table.cell_from_object(told.stop_deg) * candidate.pose();
            assert!(from_object.rotation.angle_to(&in_cell.rotation) < 1e-6, "{axis_direction:?}: {in_cell}");
            let forecast = session.state().pose(&candidate.view(), None);
            assert!(forecast.rotation.angle_to(&candidate.pose().rotation) < 1e-6, "{axis_direction:?}: {forecast}");
        }
        session.state().roll
    };
    assert_ne!(turned([1.0, 0.0, 0.0]), CameraRoll::default());
    assert_eq!(turned([0.0, 0.0, 1.0]), CameraRoll::default(), "the object sees no other up");
}

#[test]
fn settings_that_nobody_changed_give_forecasts_of_the_published_roll() {
    assert_eq!(session(SessionConfig::default()).state().roll, CameraRoll::default());
}

#[test]
fn a_given_view_that_looks_elsewhere_from_a_place_scanned_from_is_another_one() {
    let view = View { target: Point3::origin(), position: Point3::new(0.05, 0.05, 1.0) };
    let pose = view.world_from_camera();
    let panned = |deg: f64| pose * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), deg.to_radians());
    let ruled_out = |mut session: Session| {
        session.set_given_views(vec![pose, panned(20.0), panned(1.0)]);
        let candidates = session.next_view().expect("an answer").candidates;
        let scanned =
            |i: usize| candidates.iter().any(|c| c.given == Some(i) && c.objections == [Objection::scanned()]);
        [0, 1, 2].map(scanned)
    };
    let camera = CameraConfig::default().camera();
    let depth = DepthImage { origin: [600, 320], size: [80, 80], depth: vec![1.0; 6400] };
    let mut of_image = Session::new(SessionConfig::default(), None).expect("settings in range");
    of_image.add_scan(Scan::Depth { camera, depth, world_from_camera: pose, misses: NoReturn::Free }).expect("a scan");
    assert_eq!(ruled_out(of_image), [true, false, true]);
    assert_eq!(ruled_out(session(SessionConfig::default())), [true; 3], "of a cloud the position alone is told");
}
