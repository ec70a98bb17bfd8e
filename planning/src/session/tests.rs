use super::*;
use crate::Reading;
use crate::Unseen;
use crate::constraints::Objection;
use crate::stop::Missing;
use crate::support::Support;
use crate::{Left, PlannerName, RankBy, Stopped};
use geometry::View;
use nalgebra::Vector3;
use std::sync::atomic::{AtomicUsize, Ordering};

mod distances;

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
    let stop = Stop::judge(&candidates, 0.1, false, [None; 2], None);
    assert_eq!((stop.expected_gain, stop.stop), (Some(0.2), false), "the second is worth it, the third is ruled out");
    candidates.remove(1);
    assert!(Stop::judge(&candidates, 0.1, false, [None; 2], None).stop, "the first alone is not");
    candidates[0].expected_gain = None;
    let unknown = Stop::judge(&candidates, 0.1, false, [None; 2], None);
    assert!(!unknown.stop && unknown.expected_gain.is_none(), "no prediction is no reason to end: {unknown:?}");
    assert!(Stop::judge(&[], 0.0, false, [None; 2], None).stop, "no view is left");
}

#[test]
fn a_run_is_not_over_while_much_is_sure_to_be_missing() {
    let mut candidates = session(40, SessionConfig::default()).next_view().expect("an answer").candidates;
    candidates.truncate(1);
    candidates[0].objections.clear();
    candidates[0].expected_gain = Some(0.004);
    let missing = |low| Missing { share: 0.6, between: [low, 0.7], out_of_reach_share: 0.0, holes: Vec::new() };
    let stop = |low, below| Stop::judge(&candidates, below, false, [None; 2], Some(&missing(low))).stop;
    assert!(!stop(0.1, 0.01) && stop(0.09, 0.01), "a tenth");
    assert!(stop(0.15, 0.2), "who asks for less gets it");
    assert!(Stop::judge(&[], 0.01, false, [None; 2], Some(&missing(0.5))).stop, "no view is left");
}

#[test]
fn ranked_by_gain_the_first_view_is_the_one_expected_to_add_the_most() {
    let candidates = |rank_by, planner| {
        let config = SessionConfig { rank_by, planner, ..Default::default() };
        session(40, config).next_view().expect("an answer").candidates
    };
    let gains =
        |candidates: &[Candidate]| candidates.iter().map(|c| c.expected_gain.expect("predicted")).collect::<Vec<_>>();
    let by_score = candidates(RankBy::Score, PlannerName::Volumetric);
    let by_gain = candidates(RankBy::Gain, PlannerName::Volumetric);
    let falling = |gains: &[f64]| gains.windows(2).all(|pair| pair[0] >= pair[1]);
    assert!(falling(&gains(&by_gain)) && !falling(&gains(&by_score)), "{:?}", gains(&by_score));
    assert!(by_gain.iter().all(|c| c.score == c.expected_gain.expect("predicted")));
    let sorted = |mut gains: Vec<f64>| {
        gains.sort_by(f64::total_cmp);
        gains
    };
    assert_eq!(sorted(gains(&by_gain)), sorted(gains(&by_score)), "the same views");
    let farthest = |rank_by| candidates(rank_by, PlannerName::Farthest);
    assert_eq!(farthest(RankBy::Gain), farthest(RankBy::Score), "it predicts no gain");
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
    config.constraints.min_overlap = middle - 0.1;
    let judged = told(&config);
    assert!(judged.iter().any(|(_, allowed)| *allowed) && judged.iter().any(|(_, allowed)| !allowed), "{judged:?}");
    for (overlap, allowed) in judged {
        // What is beyond may lower it further.
        let least = overlap - 0.1 - (middle - 0.1);
        let fits = if allowed { least >= 0.0 } else { least < 0.1 };
        assert!(fits, "{overlap} expected after one scan, {middle} in the middle, allowed: {allowed}");
    }
}

/// Time for `checks` questions.
fn budget(checks: usize, after: Left) -> Budget {
    let asked = AtomicUsize::new(0);
    let ask = move || asked.fetch_add(1, Ordering::SeqCst);
    Budget::new(move || if ask() < checks { Left::Time } else { after })
}

#[test]
fn a_decision_ends_when_its_time_does_and_can_be_asked_for_again() {
    let config = SessionConfig { planner: PlannerName::Volumetric, ..Default::default() };
    let mut session = session(40, config);
    let mut whole = session.clone();
    let whole = whole.next_view().expect("an answer");
    for (after, expected) in [(Left::Nothing, Stopped::Late), (Left::Nobody, Stopped::Cancelled)] {
        for checks in [0, 1, 3, 8, 20, 50] {
            let request = Request { budget: budget(checks, after), ..Default::default() };
            let stopped = session.next_view_for(&request).map(|answer| answer.candidates.len());
            assert_eq!(stopped, Err(SessionError::Stopped(expected)), "after {checks} checks");
        }
    }
    assert!(session.next_view() == Ok(whole), "nothing was spoilt");
}

#[test]
fn the_best_so_far_is_an_answer_that_says_so() {
    let config = SessionConfig { planner: PlannerName::Volumetric, ..Default::default() };
    let mut session = session(40, config);
    let all = session.clone().next_view().expect("an answer");
    assert!(all.complete);
    let late = |checks| Request { budget: budget(checks, Left::Nothing).or_best(), ..Default::default() };
    assert!(session.next_view_for(&late(3)) == Err(SessionError::Stopped(Stopped::Late)), "no view was scored yet");
    let some = session.next_view_for(&late(30)).expect("some views were scored");
    assert!(!some.complete && some.candidates.len() < all.candidates.len() && some.next.is_some(), "{some:?}");
    let measured = |answer: &Answer| answer.surface.expect("made out").known_m2;
    assert!((measured(&some) / measured(&all) - 1.0).abs() < 1e-9 && !some.stop.stop, "of this state: {some:?}");
    assert!(
        session.scan_plan(&some, 3, None).is_none() && session.expected_surface(&some).is_empty(),
        "and no longer known"
    );
    let known = |c: &Candidate| all.candidates.iter().any(|a| a.position_m == c.position_m);
    assert!(some.candidates.iter().all(known), "each as in the whole answer");
    assert!(session.next_view() == Ok(all), "and it is not kept for the next request");
}

#[test]
fn a_scan_that_takes_too_long_is_not_added() {
    let mut session = session(40, SessionConfig::default());
    let before = session.next_view().expect("an answer");
    let scan = Scan::Cloud { cloud: session.cloud().clone(), from: None };
    for checks in 0..5 {
        let added = session.add_scan_within(scan.clone(), Reading::default(), &budget(checks, Left::Nobody));
        assert_eq!(added, Err(SessionError::Stopped(Stopped::Cancelled)), "after {checks} checks");
    }
    assert_eq!((session.num_scans(), session.next_view()), (1, Ok(before.clone())));
    session.add_scan(scan).expect("time enough");
    session.restore(1);
    assert_eq!((session.num_scans(), session.next_view()), (1, Ok(before)), "restored");
}

#[test]
fn memory_counts_what_planners_remember() {
    let mut session = session(40, SessionConfig { planner: PlannerName::Volumetric, ..Default::default() });
    let before = session.memory();
    session.next_view().expect("an answer");
    assert!(session.memory() > before + 1_000_000, "voxels: {before}, then {}", session.memory());
}

/// A curved sheet 10 cm across below its camera, with normals.
fn sheet(normal: impl Fn(usize, Vector3<f64>) -> Vector3<f64>) -> Scan {
    let mut cloud = PointCloud::default();
    for i in 0..400 {
        let (x, y) = ((i % 20) as f64 * 0.005 - 0.05, (i / 20) as f64 * 0.005 - 0.05);
        cloud.points.push(Point3::new(x, y, 0.1 + 2.0 * (x * x + y * y)));
        cloud.normals.push(normal(i, Vector3::new(-4.0 * x, -4.0 * y, 1.0).normalize()));
    }
    Scan::Cloud { cloud, from: Some(Point3::new(0.0, 0.0, 1.0)) }
}

#[test]
fn a_known_camera_decides_where_normals_point() {
    let next = |scan: Scan| {
        let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
        let report = session.add_scan(scan).expect("a scan");
        let answer = session.next_view().expect("an answer");
        assert!(session.cloud().normals.iter().all(|n| n.z > 0.5), "towards the camera");
        (report, answer.next.expect("the sheet is open").position_m, answer.warnings)
    };
    let (report, expected, warnings) = next(sheet(|_, n| n));
    assert_eq!((report.normals_turned, warnings.len()), (0, 0), "{warnings:?}");
    let (report, position, warnings) = next(sheet(|_, n| -n));
    assert_eq!((report.normals_turned, position), (400, expected), "pointing away");
    assert!(warnings[0].contains("away from the camera"), "{warnings:?}");
    let (report, position, warnings) = next(sheet(|i, n| if i % 4 == 0 { Vector3::repeat(f64::NAN) } else { n }));
    assert_eq!((report.normals_estimated, report.not_finite, report.used), (100, 0, 400), "no point is lost");
    assert!(position[2] > 0.0 && warnings[0].contains("100 normals are missing"), "{warnings:?}");
    for wrong in [Vector3::x(), Vector3::zeros()] {
        let (_, position, _) = next(sheet(move |i, n| if i == 7 { n } else { wrong }));
        assert!(position[2] > 0.0, "{wrong:?} for most");
    }
}

#[test]
fn hints_on_the_unit_point_the_right_way() {
    let warnings = |scale: f64, metres_per_unit: f64| {
        let Scan::Cloud { mut cloud, .. } = sheet(|_, n| n) else { unreachable!("a cloud") };
        cloud.points.iter_mut().for_each(|p| p.coords *= scale);
        let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
        let reading = Reading {
            notes: vec!["a.csv: a guess".to_owned()],
            metres_per_unit: Some(metres_per_unit),
            table_angle_deg: None,
        };
        let from = Some(Point3::new(0.0, 0.0, scale));
        session.add_scan_within(Scan::Cloud { cloud, from }, reading, &Budget::default()).expect("a scan");
        let warnings = session.next_view().expect("an answer").warnings;
        assert_eq!(warnings[0], "a.csv: a guess", "what was read is said");
        warnings[1..].join("\n")
    };
    assert_eq!(warnings(1.0, 1.0), "");
    let large = warnings(300.0, 1.0);
    assert!(large.contains("--unit mm makes it 4.0 cm") && !large.contains("--distance"), "{large}");
    let large = warnings(300.0, 0.001);
    assert!(!large.contains("--unit mm") && large.contains("--distance"), "{large}");
    assert!(warnings(0.01, 0.001).contains("--unit m makes it 1.35 m"), "{}", warnings(0.01, 0.001));
    let speck = warnings(0.03, 1.0);
    assert!(speck.contains("tolerance_m of 2.00 mm is coarse") && !speck.contains("--unit"), "{speck}");
    assert!(warnings(0.03, 0.001).contains("--unit m makes it 4.0"), "{}", warnings(0.03, 0.001));
}

#[test]
fn a_scan_in_another_unit_than_the_others_is_named() {
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    for scale in [1.0, 1.0, 0.001] {
        let Scan::Cloud { mut cloud, .. } = sheet(|_, n| n) else { unreachable!("a cloud") };
        let odd = |warnings: &[String]| warnings.iter().any(|w| w.contains("in another unit"));
        assert!(session.num_scans() == 0 || !odd(&session.next_view().expect("an answer").warnings));
        cloud.points.iter_mut().for_each(|p| p.coords *= scale);
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.0, 0.0, scale)) }).expect("a scan");
    }
    let warnings = session.next_view().expect("an answer").warnings;
    let odd = warnings.iter().find(|w| w.contains("in another unit")).expect("it is said");
    assert!(odd.starts_with("scan 3 is ") && !warnings.iter().any(|w| w.contains("--unit mm")), "{warnings:?}");
}

#[test]
fn a_scan_that_was_added_before_is_named() {
    let mut session = session(40, SessionConfig::default());
    let twice = |session: &mut Session| {
        let warnings = session.next_view().expect("an answer").warnings;
        warnings.into_iter().find(|w| w.contains("exactly the points of"))
    };
    let Scan::Cloud { mut cloud, from } = sheet(|_, n| n) else { unreachable!("a cloud") };
    session.add_scan(Scan::Cloud { cloud: cloud.clone(), from }).expect("a scan");
    assert_eq!(twice(&mut session), None);
    // Measured anew, one point differs.
    cloud.points[7].z += 1e-6;
    session.add_scan(Scan::Cloud { cloud: cloud.clone(), from }).expect("a scan");
    assert_eq!(twice(&mut session), None);
    session.add_scan(Scan::Cloud { cloud, from: None }).expect("a scan");
    assert!(twice(&mut session).is_some_and(|w| w.starts_with("scan 4 has exactly the points of scan 3:")));
}

#[test]
fn copies_are_no_thinning() {
    let Scan::Cloud { cloud, from } = sheet(|_, n| n) else { unreachable!("a cloud") };
    let cloud = PointCloud { points: cloud.points.repeat(3), normals: Vec::new() };
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    let report = session.add_scan(Scan::Cloud { cloud, from }).expect("a scan");
    assert_eq!((report.duplicates, report.thinned, report.used), (800, 0, 400));
    let warnings = session.next_view().expect("an answer").warnings;
    assert!(warnings[0].contains("800 duplicates of 1200 points") && warnings.len() == 1, "{warnings:?}");
}

#[test]
fn given_views_are_told_the_same_whatever_was_asked_before() {
    let views: Vec<Isometry3<f64>> = (0..6)
        .map(|k| {
            let (sin, cos) = f64::from(k).sin_cos();
            let position = Point3::new(0.05 + 0.7 * cos, 0.05 + 0.7 * sin, if k % 2 == 0 { 0.6 } else { -0.6 });
            View { target: Point3::new(0.05, 0.05, 0.0), position }.world_from_camera()
        })
        .collect();
    let mut fresh = session(40, SessionConfig::default());
    fresh.set_given_views(views.clone());
    let mut asked = session(40, SessionConfig::default());
    asked.next_view().expect("an answer");
    asked.set_given_views(views);
    assert_eq!(asked.next_view().expect("an answer"), fresh.next_view().expect("an answer"));
}

#[test]
fn the_reason_names_a_hole_that_the_next_view_sees_best_and_no_other() {
    let mut answer = session(40, SessionConfig::default()).next_view().expect("an answer");
    let rank = answer.next.as_ref().expect("a view").rank;
    let holes = &mut answer.missing.as_mut().expect("a back").holes;
    assert!(!holes.is_empty(), "the back of a sheet");
    holes.iter_mut().for_each(|hole| hole.best_candidate = None);
    assert!(!answer.reason().contains("a part"), "{}", answer.reason());
    answer.missing.as_mut().expect("a back").holes[0].best_candidate = Some(rank);
    assert!(answer.reason().contains(" across, "), "{}", answer.reason());
}

#[test]
fn a_mesh_is_given_up_at_its_deadline() {
    let session = session(30, SessionConfig::default());
    let whole = session.mesh_within(&Budget::default()).expect("time enough");
    assert_eq!(whole, session.mesh());
    assert!(whole.mesh.triangles.len() > 500);
    for (left, why) in [(Left::Nothing, Stopped::Late), (Left::Nobody, Stopped::Cancelled)] {
        let given_up = session.mesh_within(&budget(100, left)).expect_err("no time left");
        assert!(matches!(given_up, SessionError::Stopped(stopped) if stopped == why), "{given_up}");
    }
}

#[test]
fn a_region_much_larger_than_the_object_changes_no_number() {
    let answer = |region_m| {
        let config = SessionConfig { region_m, planner: PlannerName::Volumetric, ..Default::default() };
        let answer = session(40, config).next_view().expect("an answer");
        (answer.next.expect("open").position_m, answer.stop.expected_gain, answer.missing.expect("made out").share)
    };
    assert_eq!(answer(None), answer(Some([[-2.0; 3], [2.0; 3]])));
    let tight = answer(Some([[-0.01, -0.01, -0.02], [0.11, 0.11, 0.02]]));
    assert!(tight != answer(None), "what was cut away bounds the object");
}

#[test]
fn another_support_holds_from_the_next_answer_on() {
    let mut session = session(40, SessionConfig::default());
    let mut on = |support: Support| {
        session.configure(SessionConfig { support, ..session.config().clone() }).expect("in range");
        session.next_view().expect("an answer").support
    };
    let plane = |offset: f64| Support::plane([0.0, 0.0, 1.0, offset]);
    assert_eq!(on(plane(-0.02)).map(|p| p.offset_m), Some(-0.02));
    assert_eq!(on(plane(-0.05)).map(|p| p.offset_m), Some(-0.05));
    assert_eq!(on(Support::None), None);
}

#[test]
fn answers_do_not_depend_on_the_settings_before() {
    let fine = SessionConfig { tolerance_m: 5e-4, planner: PlannerName::Volumetric, ..Default::default() };
    let mut changed = session(40, SessionConfig { tolerance_m: 4e-3, ..fine.clone() });
    changed.next_view().expect("an answer");
    changed.configure(fine.clone()).expect("in range");
    let (then, at_once) = (changed.next_view().expect("an answer"), session(40, fine).next_view().expect("an answer"));
    assert_eq!((then.surface, then.next), (at_once.surface, at_once.next));
}
