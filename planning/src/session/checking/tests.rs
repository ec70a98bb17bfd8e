use super::*;
use crate::constraints::{Constraint, ConstraintsConfig};
use crate::session::Request;
use crate::{Answer, Scan, Session, SessionConfig, TurntableConfig};
use geometry::PointCloud;
use nalgebra::Point3;
use std::sync::Mutex;

/// A sheet of 10 cm, seen from above.
fn session(config: SessionConfig) -> Session {
    let points = (0..900).map(|i| Point3::new(f64::from(i % 30), f64::from(i / 30), 0.0) / 300.0).collect();
    let mut session = Session::new(SessionConfig { working_distance_m: 0.8, ..config }, None).expect("in range");
    let cloud = PointCloud { points, normals: Vec::new() };
    session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.05, 0.05, 0.8)) }).expect("a scan");
    session
}

/// With this check, and what it was asked, question by question.
fn checked(
    session: &mut Session,
    verdict: impl Fn(&AskedView) -> Verdict + Send + Sync + 'static,
) -> (Answer, Vec<Vec<AskedView>>) {
    let asked = Arc::new(Mutex::new(Vec::new()));
    let kept = Arc::clone(&asked);
    let check = ViewCheck::new(move |views, _| {
        kept.lock().expect("one thread").push(views.to_vec());
        Ok(views.iter().map(&verdict).collect())
    });
    let answer = session.next_view_for(&Request { check: Some(check), ..Default::default() }).expect("an answer");
    let asked = asked.lock().expect("one thread").clone();
    (answer, asked)
}

fn no(reason: &str) -> Verdict {
    Verdict::Unreachable { reason: reason.to_owned() }
}

const YES: Verdict = Verdict::Reachable { cost: 0.0 };

#[test]
fn what_the_caller_refuses_is_ruled_out_with_his_reason() {
    let mut session = session(SessionConfig::default());
    let free = session.next_view().expect("an answer");
    let best = free.next.clone().expect("a view");
    let at = best.world_from_camera.clone();
    let (answer, asked) = checked(&mut session, move |view| match view.cell_from_camera == at {
        true => no("joint 4 at its limit"),
        false => YES,
    });
    let allowed = free.candidates.iter().filter(|c| c.objections.is_empty()).count();
    assert_eq!(asked.len(), 1, "one question for all");
    assert_eq!(asked[0].len(), allowed, "those that are ruled out anyway are not asked about");
    assert!(asked[0].iter().all(|view| view.table_stop_deg.is_none() && view.base_from_flange.is_none()));
    let refused = answer.candidates.iter().find(|c| c.position_m == best.position_m).expect("listed");
    let reason = "joint 4 at its limit".to_owned();
    assert_eq!(refused.objections, [Objection { constraint: Constraint::Caller, reason }]);
    assert_eq!(answer.next.expect("another view").position_m, free.candidates[1].position_m);
    let (answer, _) = checked(&mut session, |_| no("no arm"));
    assert!(answer.next.is_none() && answer.stop.stop, "nothing is left");
    assert!(answer.no_view_reason().contains("the caller's own check excludes"), "{}", answer.no_view_reason());
    assert_eq!(session.next_view().expect("an answer"), free, "it holds for one answer alone");
}

#[test]
fn a_cost_is_taken_off_the_score() {
    let mut session = session(SessionConfig::default());
    let free = session.next_view().expect("an answer");
    let (best, at) = (&free.candidates[0], free.candidates[0].world_from_camera.clone());
    let (answer, _) = checked(&mut session, move |view| match view.cell_from_camera == at {
        true => Verdict::Reachable { cost: 0.75 },
        false => YES,
    });
    let dear = answer.candidates.iter().find(|c| c.position_m == best.position_m).expect("listed");
    assert!((dear.score - (best.planner_score - 0.75)).abs() < 1e-12, "{} {}", dear.score, best.planner_score);
    assert!(dear.objections.is_empty() && dear.rank > 0, "{}", dear.rank);
    assert_eq!(answer.candidates[0].position_m, free.candidates[1].position_m);
}

/// An arm on the side of large x, and a table that brings all sides round.
fn cell() -> SessionConfig {
    let turntable = TurntableConfig {
        axis_point_m: [0.05, 0.05, 0.0],
        range_deg: Some([0.0, 360.0]),
        step_deg: 30.0,
        ..Default::default()
    };
    let constraints =
        ConstraintsConfig { workspace_m: Some([[0.1, -2.0, -2.0], [2.0, 2.0, 2.0]]), ..Default::default() };
    SessionConfig { turntable: Some(turntable), constraints, ..Default::default() }
}

#[test]
fn the_caller_is_asked_in_the_frame_that_does_not_turn() {
    let mut session = session(cell());
    let (answer, asked) = checked(&mut session, |_| YES);
    let mut turned = 0;
    for view in &asked[0] {
        let stop = view.table_stop_deg.expect("a stop");
        assert!(view.cell_from_camera.translation_m[0] >= 0.1, "within the workspace of the cell: {view:?}");
        let placed = |c: &&Candidate| {
            c.table.as_ref().is_some_and(|t| t.stop_deg == stop && t.cell_from_camera == view.cell_from_camera)
        };
        let candidate = answer.candidates.iter().find(placed).expect("the candidate that was asked about");
        if stop != 0.0 {
            turned += 1;
            assert_ne!(candidate.world_from_camera, view.cell_from_camera);
        }
    }
    assert!(turned > 5, "{turned} of {}", asked[0].len());
}

#[test]
fn a_view_refused_at_one_stop_is_asked_about_at_the_next() {
    let mut session = session(cell());
    let (free, first) = checked(&mut session, |_| YES);
    assert_eq!(first.len(), 1);
    let (answer, asked) = checked(&mut session, |view| match view.table_stop_deg {
        Some(stop) if stop < 100.0 => no("the table may not stand there"),
        _ => YES,
    });
    assert!(asked.len() > 1 && asked.windows(2).all(|w| w[0].len() >= w[1].len()), "fewer each time");
    let stop = |c: &Candidate| c.table.as_ref().map(|t| t.stop_deg).expect("a stop");
    let allowed: Vec<&Candidate> = answer.candidates.iter().filter(|c| c.objections.is_empty()).collect();
    assert!(allowed.iter().all(|c| stop(c) > 100.0 && c.position_in_cell().x >= 0.1), "where all agree");
    let before = |c: &Candidate| free.candidates.iter().find(|f| f.position_m == c.position_m).map(stop);
    assert!(allowed.iter().any(|c| before(c).is_some_and(|stop| stop < 100.0)), "brought round");
    for refused in answer.candidates.iter().filter(|c| c.objections.iter().any(|o| o.constraint == Constraint::Caller))
    {
        assert_eq!(before(refused), Some(stop(refused)), "told of the stop that comes first");
    }
}

#[test]
fn a_check_that_fails_is_an_error_and_spoils_nothing() {
    let mut session = session(SessionConfig::default());
    let free = session.next_view().expect("an answer");
    let mut fails = |verdicts: Result<Vec<Verdict>, String>, expected: &str| {
        let check = ViewCheck::new(move |_, _| verdicts.clone());
        let error = session.next_view_for(&Request { check: Some(check), ..Default::default() }).expect_err(expected);
        assert!(error.to_string().contains(expected), "{error}");
    };
    fails(Err("no controller".to_owned()), "could not be checked: no controller");
    fails(Ok(vec![YES]), &format!("1 answers for {} views", free.candidates.len()));
    for cost in [-0.1, f64::NAN, f64::INFINITY] {
        let many = vec![Verdict::Reachable { cost }; free.candidates.len()];
        fails(Ok(many), "expected zero or a positive number");
    }
    assert_eq!(session.next_view().expect("an answer"), free);
}
