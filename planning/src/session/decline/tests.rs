use super::*;
use crate::stop::Stop;
use crate::{Scan, Session, SessionConfig};
use geometry::PointCloud;
use nalgebra::Point3;

/// A sheet of 8 x 8 cm from `x` on, 2 mm apart, seen from 1.2 m above.
fn sheet(x: f64) -> Scan {
    let points =
        (0..1_600).map(|i| Point3::new(x + 0.002 * f64::from(i % 40), 0.002 * f64::from(i / 40), 0.0)).collect();
    Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(Point3::new(x + 0.04, 0.04, 1.2)) }
}

fn session(starts: &[f64]) -> Session {
    let mut session = Session::new(SessionConfig::default(), None).expect("settings in range");
    for &x in starts {
        session.add_scan(sheet(x)).expect("a scan");
    }
    session
}

#[test]
fn the_last_scan_added_what_no_scan_before_had_measured() {
    let added = |starts: &[f64]| {
        let session = session(starts);
        lately_added(&session.scans, &session.state)
    };
    assert_eq!(added(&[0.0]), [None; 2], "nothing to compare it with");
    assert_eq!(added(&[0.0, 0.2])[1], None, "nothing before the last two");
    // Within the tolerance of 2 mm a column more counts as known.
    let near = |starts: &[f64], share: f64| {
        let added = added(starts)[0].expect("scans before");
        assert!((added - share).abs() < 0.03, "{starts:?}: {added}, not {share}");
    };
    let together = |starts: &[f64], share: f64| {
        let added = added(starts)[1].expect("scans before");
        assert!((added - share).abs() < 0.03, "{starts:?}: {added}, not {share}");
    };
    near(&[0.0, 0.0], 0.0);
    near(&[0.0, 0.04], 1.0 / 3.0);
    near(&[0.0, 0.2], 0.5);
    near(&[0.0, 0.2, 0.04], 0.04 / 0.2);
    together(&[0.0, 0.2, 0.04], 0.12 / 0.2);
    together(&[0.0, 0.2, 0.2], 0.5);
    together(&[0.0, 0.2, 0.2, 0.0], 0.0);
}

#[test]
fn points_between_those_of_a_coarse_scan_are_not_new() {
    let config = SessionConfig { accumulate: crate::Accumulate::Averaged, ..SessionConfig::default() };
    let mut session = Session::new(config, None).expect("settings in range");
    // 6 mm apart, three times the tolerance; the second in the middles of the first.
    for shift in [0.0, 0.003] {
        let at = |i: u32| Point3::new(shift + 0.006 * f64::from(i % 40), shift + 0.006 * f64::from(i / 40), 0.0);
        let cloud = PointCloud { points: (0..1_600).map(at).collect(), normals: Vec::new() };
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.12, 0.12, 1.2)) }).expect("a scan");
    }
    let added = lately_added(&session.scans, &session.state)[0].expect("a scan before");
    assert!(added < 0.02, "{added}");
}

#[test]
fn a_run_waits_for_a_scan_that_added_little() {
    let stop = |starts: &[f64], below: f64| {
        let config = SessionConfig { stop_below: below, ..SessionConfig::default() };
        let mut session = Session::new(config, None).expect("settings in range");
        starts.iter().for_each(|&x| session.add_scan(sheet(x)).map(drop).expect("a scan"));
        session.next_view().expect("an answer").stop
    };
    assert_eq!(stop(&[0.0], 0.0).last_added, None);
    assert!(stop(&[0.0, 0.0], 0.0).last_added.expect("two scans") < 0.01, "the same surface again");
    // Half of what is measured; the whole is more.
    let second = stop(&[0.0, 0.2], 0.0);
    let added = second.last_added.expect("two scans");
    assert!((0.05..0.53).contains(&added), "{added}");
    let compared = second.compared().expect("a prediction");
    assert!(compared >= added && compared >= second.expected_gain.expect("a prediction"));
    assert!(!stop(&[0.0, 0.2], compared - 1e-6).stop);
    // Nobody has seen their other sides, which a view shows.
    assert!(compared > 0.1 && stop(&[0.0, 0.2], compared + 1e-6).stop, "{compared}");
    // The third adds nothing, and half of what the second added is still more than any view is expected to.
    let third = stop(&[0.0, 0.2, 0.2], 0.0);
    let (last, two) = (third.last_added.expect("scans before"), third.last_two_added.expect("scans before"));
    assert!(last < 0.01 && two > 0.1, "{last} {two}");
}

#[test]
fn a_run_goes_on_while_much_is_sure_to_be_missing_though_no_view_is_expected_to_add_to_it() {
    let answer = session(&[0.0]).next_view().expect("an answer");
    let missing = answer.missing.expect("made out");
    let sure = missing.between[0];
    assert!(sure > 0.1, "the other side: {missing:?}");
    let mut candidates = answer.candidates;
    candidates.iter_mut().for_each(|c| c.expected_gain = Some(0.0));
    let stops = |below| Stop::judge(&candidates, below, false, [None; 2], Some(&missing)).stop;
    assert!(!stops(0.02) && !stops(sure - 0.01) && stops(sure + 0.01));
}

#[test]
fn gains_fall_no_faster_than_scans_before_lead_one_to_expect() {
    let answer = session(&[0.0]).next_view().expect("an answer");
    let mut candidates = answer.candidates;
    candidates.truncate(3);
    let set = |candidates: &mut [Candidate]| {
        for (candidate, gain) in candidates.iter_mut().zip([0.004, 0.01, 0.5]) {
            candidate.objections.clear();
            candidate.expected_gain = Some(gain);
        }
        candidates[2].objections.push(crate::constraints::Objection::scanned());
    };
    let missing = || Missing { share: 0.02, between: [0.01, 0.03], ..answer.missing.clone().expect("made out") };
    let gains = |candidates: &[Candidate]| candidates.iter().filter_map(|c| c.expected_gain).collect::<Vec<_>>();
    set(&mut candidates);
    let mut left = missing();
    assert!(!heed(&mut candidates, Some(&mut left), 0.019), "half of it is less than the planner expects");
    assert_eq!(gains(&candidates), [0.004, 0.01, 0.5]);
    assert_eq!(left.share, 0.02);
    assert!(heed(&mut candidates, Some(&mut left), 0.1));
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a}, not {b}");
    // 0.01 and 0.7 of what is more in 0.05; the other by the same factor, the one that may not be taken no further than it was.
    let raised = gains(&candidates);
    near(raised[1], 0.038);
    near(raised[0], 0.0152);
    near(raised[2], 0.5);
    near(left.share, 0.02 + 0.7 * 0.08);
    assert!(left.between[1] > 0.1 && left.between[0] == 0.01, "{:?}", left.between);
    assert!(raised[1] <= left.share, "no more than is missing");
    // Where none is expected to add anything, nothing is raised.
    let mut none = candidates.clone();
    none.iter_mut().for_each(|c| c.expected_gain = Some(0.0));
    let mut nothing = Missing { share: 0.0, between: [0.0, 0.02], ..missing() };
    assert!(!heed(&mut none, Some(&mut nothing), 0.3));
    assert_eq!((nothing.share, nothing.between), (0.0, [0.0, 0.02]));
    // 0.038 is expected at most: a run goes on all the same while the last scan added more than the threshold, or the last two did in the
    // mean.
    let stop = |last, two| Stop::judge(&candidates, 0.045, true, [last, two], None);
    assert!(!stop(Some(0.1), None).stop && stop(Some(0.04), None).stop && stop(None, None).stop);
    assert!(!stop(Some(0.04), Some(0.1)).stop && stop(Some(0.04), Some(0.08)).stop);
    let compared = |last, two| stop(Some(last), Some(two)).compared();
    assert_eq!(
        [compared(0.1, 0.1), compared(0.02, 0.02), compared(0.02, 0.1)],
        [Some(0.1), Some(raised[1]), Some(0.05)]
    );
}
