use super::*;
use crate::Unseen;
use crate::stop::Missing;
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
    let mut candidates = session(40, SessionConfig::default()).next_view().expect("an answer").candidates;
    candidates.truncate(3);
    for (candidate, gain) in candidates.iter_mut().zip([0.01, 0.2, 0.9]) {
        candidate.objections.clear();
        candidate.expected_gain = Some(gain);
    }
    candidates[2].objections.push(Objection::scanned());
    let stop = Stop::judge(&candidates, 0.1);
    assert_eq!((stop.expected_gain, stop.stop), (Some(0.2), false), "the second is worth it, the third is ruled out");
    candidates.remove(1);
    assert!(Stop::judge(&candidates, 0.1).stop, "the first alone is not");
    candidates[0].expected_gain = None;
    let unknown = Stop::judge(&candidates, 0.1);
    assert!(!unknown.stop && unknown.expected_gain.is_none(), "no prediction is no reason to end: {unknown:?}");
    assert!(Stop::judge(&[], 0.0).stop, "no view is left");
}

#[test]
fn what_no_allowed_view_sees_is_listed_but_not_missing() {
    // Seen from above; its other side is open.
    let missing = |floor: Option<f64>| {
        let mut session = session(40, SessionConfig { working_distance_m: 1.0, ..Default::default() });
        let mut config = session.config().clone();
        config.constraints.floor_height_m = floor;
        session.configure(config).expect("in range");
        session.next_view().expect("an answer").missing.expect("the planner makes it out")
    };
    let (free, on_a_table) = (missing(None), missing(Some(-0.01)));
    assert!(free.share > 0.3 && free.out_of_reach_share < 0.01, "{free:?}");
    let whole = |m: &Missing| m.share + m.out_of_reach_share;
    assert!((whole(&free) - whole(&on_a_table)).abs() < 1e-9, "both expect the same");
    assert!(on_a_table.out_of_reach_share > 0.1, "the underside: {on_a_table:?}");
    let hole = &free.holes[0];
    assert_eq!((hole.unseen, hole.best_candidate.is_some()), (Unseen::FacesAway, true), "{hole:?}");
    assert!(hole.normal[2] < -0.5 && (0.08..0.25).contains(&hole.size_m), "{hole:?}");
    assert!(on_a_table.holes[0].within_reach < hole.within_reach, "{on_a_table:?}");
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

#[test]
fn a_least_overlap_is_asked_of_what_is_expected_less_what_it_may_be_missed_by() {
    let mut config = SessionConfig { working_distance_m: 1.0, ..Default::default() };
    let told = |config: &SessionConfig| {
        let answer = session(40, config.clone()).next_view().expect("an answer");
        let told = |c: &Candidate| (c.expected_overlap.expect("a prediction"), c.objections.is_empty());
        answer.candidates.iter().map(told).collect::<Vec<(f64, bool)>>()
    };
    let mut all: Vec<f64> = told(&config).iter().map(|(overlap, _)| *overlap).collect();
    all.sort_by(f64::total_cmp);
    let middle = all[all.len() / 2];
    config.constraints.min_overlap = middle - 0.05;
    for (overlap, allowed) in told(&config) {
        assert_eq!(
            allowed,
            overlap - 0.1 >= middle - 0.05,
            "{overlap} expected after one scan, {middle} in the middle"
        );
    }
}
