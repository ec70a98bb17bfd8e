//! The session: what a user relies on, whatever planner decides.

use geometry::{NeighborGrid, PointCloud, rng};
use nalgebra::{Isometry3, Point3, Vector3};
use planning::{
    Answer, Constraint, Evidence, Network, PlanError, Planner, PlannerName, RankedView, Scan, ScanState, Session,
    SessionConfig, SessionError,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Random points of a bumpy ball of radius 0.1 that a camera at +z of it can see.
fn cap(count: usize) -> Vec<Point3<f64>> {
    let mut rng = rng::stream(5, "test/cap");
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let v = Vector3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-0.2..1.0f64));
        if (0.1..1.0).contains(&v.norm()) && v.normalize().z > -0.1 {
            let n = v.normalize();
            points.push(Point3::from(n * (0.1 + 0.01 * (5.0 * n.x).sin() * (4.0 * n.y).cos())));
        }
    }
    points
}

fn camera() -> Point3<f64> {
    Point3::new(0.05, -0.02, 1.2)
}

fn scan(points: Vec<Point3<f64>>, from: Option<Point3<f64>>) -> Scan {
    Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }
}

fn ask(config: SessionConfig, scans: Vec<Scan>) -> Result<Answer, SessionError> {
    let mut session = Session::new(config, None)?;
    for scan in scans {
        session.add_scan(scan)?;
    }
    session.next_view()
}

fn farthest() -> SessionConfig {
    SessionConfig { planner: PlannerName::Farthest, ..Default::default() }
}

fn positions(answer: &Answer) -> Vec<Point3<f64>> {
    answer.candidates.iter().map(|c| Point3::from(c.position_m)).collect()
}

/// The answers for the cloud, and for the cloud moved and scaled, are the same candidates moved and scaled.
fn assert_moves_with(
    motion: &Isometry3<f64>,
    scale: f64,
    count: usize,
    from: Option<Point3<f64>>,
    planner: PlannerName,
) {
    let place = |p: &Point3<f64>| Point3::from((motion * p).coords * scale);
    let config = SessionConfig { planner, ..Default::default() };
    let moved_config = SessionConfig { working_distance_m: 1.2 * scale, tolerance_m: 0.002 * scale, ..config.clone() };
    let points = cap(count);
    let moved = points.iter().map(place).collect();
    let original = ask(config, vec![scan(points, from)]).expect("an answer");
    let answer = ask(moved_config, vec![scan(moved, from.map(|p| place(&p)))]).expect("an answer");
    assert!(original.candidates.len() >= 20, "{planner:?}: {} candidates", original.candidates.len());
    assert_eq!(original.candidates.len(), answer.candidates.len(), "{planner:?}: number of candidates");
    for (a, b) in positions(&original).iter().zip(positions(&answer)) {
        let error = (place(a) - b).norm() / scale;
        assert!(error < 1e-6, "{planner:?}, scale {scale}: a candidate is off by {error}");
    }
}

#[test]
fn candidates_move_with_the_cloud_and_its_unit() {
    let motion = Isometry3::new(Vector3::new(3.0, -2.0, 0.5), Vector3::new(0.4, -1.0, 2.0));
    for (count, from) in [(4_000, Some(camera())), (4_000, None), (40_000, Some(camera()))] {
        assert_moves_with(&motion, 1.0, count, from, PlannerName::Farthest);
        assert_moves_with(&Isometry3::identity(), 1000.0, count, from, PlannerName::Farthest);
        assert_moves_with(&motion, 0.001, count, from, PlannerName::Farthest);
    }
}

#[test]
fn answers_repeat() {
    let once = || ask(farthest(), vec![scan(cap(3_000), Some(camera()))]).expect("an answer");
    assert_eq!(once(), once(), "same input, same answer");
}

#[test]
fn undo_and_reset_lead_back() {
    lead_back(farthest());
    lead_back(SessionConfig { planner: PlannerName::Volumetric, ..Default::default() });
}

fn lead_back(config: SessionConfig) {
    let mut session = Session::new(config, None).expect("default settings");
    session.add_scan(scan(cap(3_000), Some(camera()))).expect("a scan");
    let before = session.next_view().expect("an answer");
    let other: Vec<_> = cap(3_000).iter().map(|p| Point3::new(p.z, p.x, p.y)).collect();
    session.add_scan(scan(other, Some(Point3::new(1.2, 0.0, 0.0)))).expect("a second scan");
    let between = session.next_view().expect("an answer");
    assert_ne!(before.next, between.next, "a second scan changes the answer");
    assert!(session.undo(), "there is a scan to undo");
    assert_eq!(session.next_view().expect("an answer"), before, "undo leads back");
    session.reset();
    assert_eq!(session.next_view(), Err(SessionError::NoScan), "nothing left to plan on");
    assert!(!session.undo(), "nothing to undo");
}

#[test]
fn the_neighbours_known_are_those_of_the_cloud() {
    let other_side = || cap(2_000).iter().map(|p| Point3::new(p.x, p.y, -p.z)).collect();
    let stray = || cap(2_000).into_iter().chain([Point3::new(0.0, 0.0, 0.5)]).collect();
    let mut session = Session::new(farthest(), None).expect("defaults");
    let check = |session: &Session| {
        let points = &session.state().cloud.points;
        let known = session.state().neighborhoods(30);
        let found = NeighborGrid::new(points, 0.0).neighborhoods(points.len(), 30);
        assert_eq!((known.len(), known.k()), (found.len(), found.k()));
        assert!((0..points.len()).all(|i| known.ids(i) == found.ids(i)));
        points.len()
    };
    session.add_scan(scan(stray(), None)).expect("a scan");
    let one = check(&session);
    assert!(one <= 2_000, "the stray point is dropped");
    session.add_scan(scan(other_side(), None)).expect("a scan");
    assert!(check(&session) > one, "a scan more");
    session.undo();
    assert_eq!(check(&session), one, "and back");
}

#[test]
fn known_cameras_let_auto_carve() {
    let auto = |scans| ask(SessionConfig::default(), scans).expect("an answer");
    let with = auto(vec![scan(cap(3_000), Some(camera()))]);
    assert_eq!((with.planner.as_str(), with.evidence), ("volumetric", Evidence::CameraPositions), "carves");
    assert!(with.planner_reason.contains("camera positions"), "{}", with.planner_reason);
    let next = with.next.expect("a view");
    // The far side of the ball is unseen, and promises new surface.
    let toward = (Point3::from(next.position_m) - Point3::origin()).normalize();
    assert!(toward.z < 0.85, "from {toward}");
    assert!(next.expected_gain.is_some_and(|g| g > 0.05) && next.expected_overlap.is_some(), "{next:?}");
    let half = auto(vec![scan(cap(3_000), Some(camera())), scan(cap(2_000), None)]);
    assert_eq!((half.planner.as_str(), half.evidence), ("volumetric", Evidence::Clouds), "one camera is estimated");
    assert!(half.planner_reason.contains("estimated"), "{}", half.planner_reason);
}

/// A network that breaks.
struct Broken;

impl Planner for Broken {
    fn name(&self) -> &str {
        "benbv-net"
    }

    fn rank_views(&mut self, _: &ScanState, _: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        Err(PlanError::failed("benbv-net", "a view was scored NaN"))
    }
}

#[test]
fn a_network_that_breaks_is_an_error_and_never_the_end() {
    let config = SessionConfig { planner: PlannerName::BenbvNet, ..Default::default() };
    let mut session = Session::new(config, Some(Network::new(Broken))).expect("defaults");
    session.add_scan(scan(cap(3_000), Some(camera()))).expect("a scan");
    let error = session.next_view().expect_err("broken").to_string();
    assert_eq!(error, "planner benbv-net failed: a view was scored NaN");
}

#[test]
fn a_request_holds_for_itself_alone() {
    let mut session = Session::new(farthest(), None).expect("defaults");
    session.add_scan(scan(cap(3_000), Some(camera()))).expect("a scan");
    let limit = planning::ConstraintsConfig { max_travel_m: Some(0.5), ..Default::default() };
    session.configure(SessionConfig { constraints: limit, ..farthest() }).expect("in range");
    let before = session.next_view().expect("an answer");
    let below = planning::session::Request { current_position_m: Some([0.0, 0.0, -1.2]), ..Default::default() };
    let other = session.next_view_for(&below).expect("an answer");
    assert_ne!(before.excluded, other.excluded, "another position is within reach of other views");
    assert_eq!(session.next_view().expect("an answer"), before, "and is forgotten");
}

#[test]
fn awkward_clouds_work_or_say_why_not() {
    let nan = Point3::new(f64::NAN, 0.0, 0.0);
    let good = cap(3_000);
    // Organised: half of the pixels without a return.
    let organised: Vec<_> = good.iter().flat_map(|p| [*p, nan]).collect();
    let clean = ask(farthest(), vec![scan(good.clone(), Some(camera()))]).expect("an answer");
    let answer = ask(farthest(), vec![scan(organised, Some(camera()))]).expect("NaN is no obstacle");
    assert_eq!(positions(&answer), positions(&clean), "pixels without a return do not matter");
    let twice: Vec<_> = good.iter().flat_map(|p| [*p, *p]).collect();
    let answer = ask(farthest(), vec![scan(twice, Some(camera()))]).expect("duplicates are no obstacle");
    assert_eq!(positions(&answer), positions(&clean), "duplicates do not matter");
    let mut flying = good.clone();
    flying.push(Point3::new(4.0, 4.0, 4.0));
    let answer = ask(farthest(), vec![scan(flying, Some(camera()))]).expect("an outlier is no obstacle");
    assert!(answer.warnings.iter().any(|w| w.contains("1 points far from all others")), "{:?}", answer.warnings);
    assert!(answer.cloud.bounding_box_m[1][0] < 0.2, "the outlier does not stretch the box");
    let few = ask(farthest(), vec![scan(cap(60), Some(camera()))]).expect("60 points are enough");
    assert!(few.next.is_some(), "60 points have a boundary");
    let error = ask(farthest(), vec![scan(cap(9), None)]).expect_err("9 points are too few").to_string();
    assert!(error.contains("9 points") && error.contains("30"), "{error}");
    let error = ask(farthest(), vec![scan(vec![nan; 100], None)]).expect_err("only NaN").to_string();
    assert!(error.contains("100 without a position"), "{error}");
}

#[test]
fn sizes_and_distances_that_look_wrong_are_warned_of() {
    let warned = |scale: f64, distance: f64| {
        let points = cap(3_000).iter().map(|p| p * scale).collect();
        let config = SessionConfig { working_distance_m: distance, ..farthest() };
        ask(config, vec![scan(points, Some(camera() * scale))]).expect("an answer").warnings.join("\n")
    };
    assert_eq!(warned(1.0, 1.2), "", "the paper's setting is fine");
    assert!(warned(1000.0, 1.2).contains("--unit mm"), "200 m across");
    assert!(warned(0.001, 1.2).contains("--unit m)"), "0.2 mm across");
    assert!(warned(10.0, 1.2).contains("try a distance of"), "2 m across seen from 1.2 m");
    let text = warned(1.0, 0.1);
    let serves: f64 =
        text.split("--distance ").nth(1).and_then(|t| t.trim_end_matches(')').parse().ok()).expect("a distance");
    assert_eq!(warned(1.0, serves), "", "the distance named does serve: {text}");
}

#[test]
fn each_constraint_changes_the_answer() {
    let free = ask(farthest(), vec![scan(cap(3_000), Some(camera()))]).expect("an answer");
    let best = free.next.clone().expect("a next view");
    let p = best.position_m;
    let [x, y, z] = p;
    let set = |change: &dyn Fn(&mut SessionConfig)| {
        let mut config = farthest();
        change(&mut config);
        ask(config, vec![scan(cap(3_000), Some(camera()))]).expect("an answer")
    };
    let around = |half: f64| [[x - half, y - half, z - half], [x + half, y + half, z + half]];
    let travel = (Point3::from(p) - camera()).norm();
    let tilt = ((z - best.target_m[2]) / 1.2).asin().to_degrees();
    let cases: Vec<(Constraint, Answer)> = vec![
        (Constraint::KeepOut, set(&|c| c.constraints.keep_out_m = vec![around(0.1)])),
        (Constraint::Workspace, set(&|c| c.constraints.workspace_m = Some([[-9.0, -9.0, z + 0.01], [9.0; 3]]))),
        (Constraint::Floor, set(&|c| c.constraints.floor_height_m = Some(z + 0.01))),
        (Constraint::Tilt, set(&|c| c.constraints.min_tilt_deg = Some(tilt + 1.0))),
        (Constraint::Travel, set(&|c| c.constraints.max_travel_m = Some(0.95 * travel))),
        (
            Constraint::Visited,
            set(&|c| {
                c.constraints.visited_m = vec![p];
                c.constraints.visited_radius_m = Some(0.05)
            }),
        ),
        (Constraint::Overlap, set(&|c| c.constraints.min_overlap = 0.4)),
    ];
    for (constraint, answer) in cases {
        let next = answer.next.as_ref().expect("another view is left");
        assert_ne!(next.position_m, p, "{constraint:?} changes the answer");
        let before = answer.candidates.iter().find(|c| c.position_m == p).expect("the best is still listed");
        assert!(before.objections.iter().any(|o| o.constraint == constraint), "{constraint:?}: {before:?}");
        assert!(answer.excluded.iter().any(|e| e.constraint == constraint), "{constraint:?} is counted");
    }
    // From so near that the camera grazes the ball, the clearance rules out what was best.
    let near = |clearance| {
        set(&|c| {
            c.working_distance_m = 0.02;
            c.constraints.clearance_m = clearance
        })
    };
    let best_near = near(None).next.expect("a view").position_m;
    let cleared = near(Some(0.015));
    let objected = cleared.candidates.iter().filter(|c| !c.objections.is_empty()).count();
    assert!(objected > 0, "some cameras graze the ball");
    assert!(cleared.next.is_none_or(|n| n.objections.is_empty()), "what is taken is clear; was {best_near:?}");
    // The cost of travel and the range of distances change the ranking and the pose.
    let cheap = set(&|c| c.constraints.travel_weight_per_m = 10.0).next.expect("a view");
    assert!((Point3::from(cheap.position_m) - camera()).norm() < travel, "a nearer view is taken");
    let ranged = set(&|c| {
        c.working_distance_range_m = Some([0.5, 0.8]);
        c.constraints.travel_weight_per_m = 0.1
    });
    assert!(ranged.candidates.iter().all(|c| (0.5..=0.8).contains(&c.working_distance_m)), "distances of the range");
    assert_eq!(ranged.candidates.len(), 3 * free.candidates.len(), "each candidate at three distances");
}

#[test]
fn where_nothing_is_left_the_answer_says_what_excluded_how_many() {
    let mut config = farthest();
    config.constraints.floor_height_m = Some(50.0);
    config.constraints.max_tilt_deg = Some(-80.0);
    let answer = ask(config, vec![scan(cap(3_000), Some(camera()))]).expect("an answer");
    assert_eq!(answer.next, None, "nobody can stand at 50 m");
    assert!(answer.stop.stop, "so the scanning ends");
    let floor = answer.excluded.iter().find(|e| e.constraint == Constraint::Floor).expect("counted");
    assert_eq!(floor.candidates, answer.candidates.len(), "the floor excludes all");
    let text = answer.to_text();
    assert!(text.contains(&format!("floor_height_m excludes {}", floor.candidates)), "{text}");
    assert!(text.contains("max_tilt_deg excludes"), "{text}");
}

#[test]
fn travel_needs_to_know_from_where() {
    let mut config = farthest();
    config.constraints.max_travel_m = Some(1.0);
    let unknown = ask(config.clone(), vec![scan(cap(3_000), None)]);
    assert_eq!(unknown, Err(SessionError::NoCurrentPosition), "the camera is nowhere");
    let far = Some(Point3::new(0.0, 0.0, 1200.0));
    let Err(doubted) = ask(config.clone(), vec![scan(cap(3_000), far)]) else { panic!("given in millimetres") };
    assert!(doubted.to_string().contains("that of scan 1 is not believed: it is "), "{doubted}");
    config.constraints.current_position_m = Some(camera().coords.into());
    assert!(ask(config, vec![scan(cap(3_000), None)]).is_ok(), "the setting says where");
}

#[test]
fn scanning_stops_where_the_next_view_is_not_worth_it() {
    let stops = |stop_below| {
        let config = SessionConfig { stop_below, ..Default::default() };
        ask(config, vec![scan(cap(3_000), Some(camera()))]).expect("an answer").stop.stop
    };
    assert!(!stops(0.0) && !stops(0.05), "after one scan a view adds much");
    assert!(stops(0.9), "nine tenths of the surface are never to be expected");
}

#[test]
fn marks_for_no_return_and_clouds_of_no_size_end_at_once() {
    let sheet = |scale: f64| -> Vec<Point3<f64>> {
        (0..400).map(|i| Point3::new(f64::from(i % 20), f64::from(i / 20), 0.0) * (0.005 * scale)).collect()
    };
    let scan = |points| Scan::Cloud {
        cloud: PointCloud { points, normals: Vec::new() },
        from: Some(Point3::new(0.0, 0.0, 1.0)),
    };
    for mark in [2e6, 2e19, 1e30, f64::from(f32::MAX), 1e39, f64::MAX] {
        let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
        let mut points = sheet(1.0);
        points.push(Point3::new(mark, 0.0, -mark));
        let report = session.add_scan(scan(points)).expect("the sheet stays");
        assert_eq!((report.out_of_range, report.used), (1, 400), "{mark:e}");
        let answer = session.next_view().expect("an answer");
        assert!(answer.next.is_some() && answer.warnings.iter().any(|w| w.contains("no return")), "{mark:e}");
    }
    for scale in [1e-38, 1e-300, 1e-9] {
        let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
        let error = session.add_scan(scan(sheet(scale))).expect_err("no cloud").to_string();
        assert!(error.contains("smaller than a micrometre"), "{scale:e}: {error}");
    }
}

#[test]
fn given_views_are_taken_one_after_another_and_another_request_asks_no_planner() {
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    let turn = |degrees: f64| {
        let position = Point3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
        geometry::View { target: Point3::origin(), position }.world_from_camera()
    };
    session.set_given_views((0..4).map(|k| turn(90.0 * f64::from(k))).collect());
    let points = (0..2500)
        .map(|i| Point3::new(f64::from(i % 50) * 0.002 - 0.05, f64::from(i / 50) * 0.002 - 0.05, 0.02))
        .collect();
    let from = Some(Point3::new(0.0, 0.0, 1.0));
    session.add_scan(Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }).expect("a scan");
    let answer = session.next_view().expect("an answer");
    assert_eq!(answer.candidates.len(), 4, "none is invented");
    let used = answer.candidates.iter().find(|c| c.given == Some(0)).expect("the first is among them");
    assert!(used.objections.iter().any(|o| o.reason.contains("scanned from here")), "{:?}", used.objections);
    let next = answer.next.expect("three are left");
    let pose = turn(90.0 * next.given.expect("one of those given") as f64);
    assert_eq!(next.world_from_camera, planning::pose::Pose::from(&pose), "as it was given");
    let elsewhere = planning::session::Request { current_position_m: Some([1.0, 0.0, 0.0]), ..Default::default() };
    let again = session.next_view_for(&elsewhere).expect("an answer");
    assert_eq!(again.next.map(|n| n.score), Some(next.score), "the planner's score stays");
}
