use super::*;
use geometry::View;

/// A sheet of 10 cm, `side` by `side` points, seen from a metre above.
fn session(side: usize, config: SessionConfig) -> Session {
    let at = |i: usize| 0.1 * i as f64 / side as f64;
    let points = (0..side * side).map(|i| Point3::new(at(i % side), at(i / side), 0.0)).collect();
    let from = Some(Point3::new(0.05, 0.05, 1.0));
    let mut session = Session::new(config, None).expect("settings in range");
    session.add_scan(Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }).expect("a scan");
    session
}

#[test]
fn stop_asks_all_views_that_may_be_taken() {
    let mut session = session(40, SessionConfig { stop_below: 0.1, ..Default::default() });
    let mut candidates = session.next_view().expect("an answer").candidates;
    candidates.truncate(3);
    for (candidate, gain) in candidates.iter_mut().zip([0.01, 0.2, 0.9]) {
        candidate.objections.clear();
        candidate.expected_gain = Some(gain);
    }
    candidates[2].objections.push(Objection::scanned());
    let stop = session.judge_stop(&candidates);
    assert_eq!((stop.expected_gain, stop.stop), (0.2, false), "the second is worth it, the third is ruled out");
    candidates.remove(1);
    assert!(session.judge_stop(&candidates).stop, "the first alone is not");
}

#[test]
fn thinning_makes_no_surface_uncovered() {
    let overlap = |max_points: usize| {
        let mut session = session(200, SessionConfig { max_points, working_distance_m: 1.0, ..Default::default() });
        let again = View { target: Point3::new(0.05, 0.05, 0.0), position: Point3::new(0.05, 0.05, 0.9) };
        session.set_given_views(vec![again.world_from_camera()]);
        let answer = session.next_view().expect("an answer");
        answer.candidates[0].expected_overlap.expect("known surface in view")
    };
    let [all, few] = [40_000, 400].map(overlap);
    assert!(all > 0.7 && (all - few).abs() < 0.15, "{all} of all points, {few} of few");
}

#[test]
fn no_camera_stands_in_the_surface_unless_asked_for() {
    let mut session = session(40, SessionConfig::default());
    let near = View { target: Point3::new(0.05, 0.05, -1.0), position: Point3::new(0.05, 0.05, 0.02) };
    session.set_given_views(vec![near.world_from_camera()]);
    assert!(session.next_view().expect("an answer").next.is_none(), "2 cm away");
    let mut config = session.config().clone();
    config.constraints.clearance_m = Some(0.0);
    session.configure(config).expect("in range");
    assert!(session.next_view().expect("an answer").next.is_some(), "asked for");
}
