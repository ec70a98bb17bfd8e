use super::*;
use crate::metrics::tests::record;
use crate::record::Timing;
use datagen::RegistrationOutcome;

fn view(left_mm: Option<f64>, lambda: f64) -> ViewRegistration {
    ViewRegistration {
        placed_from_true: nalgebra::Isometry3::identity(),
        given_m: 0.003,
        left_m: left_mm.map(|mm| 1e-3 * mm),
        adjusted_m: None,
        adjusted_failed: None,
        failed: left_mm.is_some_and(|mm| mm > 2.0),
        refused: left_mm.is_none().then_some(Refused::Uncertain),
        like_overlap: 0.25,
        lambda,
        expected_lambda: lambda + 1.0,
        expected_failure: 0.1,
        waited: 0,
        bridge: false,
    }
}

/// Two episodes: in one the second of three scans fails, in the other one is refused.
fn contents() -> Contents {
    let of = |episode: usize, views: Vec<ViewRegistration>| {
        let mut record = record("a", "p", episode, &[0.3, 0.5, 0.7, 0.8], &[Some(0.3), Some(0.08), Some(0.5)]);
        record.registration = Some(RegistrationOutcome { views, left_m: 0.001, off_share: 0.25 });
        (record, Timing { episode_s: 1.0, decisions_s: vec![] })
    };
    let failing = vec![view(Some(0.4), 5.0), view(Some(6.0), 0.5), view(Some(7.0), 30.0)];
    let refused = vec![view(Some(0.2), 5.0), view(None, 0.5), view(Some(0.2), 30.0)];
    Contents { episodes: vec![of(0, failing), of(1, refused)], skipped: vec![] }
}

#[test]
fn rows_equal_what_is_counted_by_hand() {
    let config = EvaluateConfig::default();
    let rows = rows(&contents(), &config, &["p".to_owned()]);
    let row = &rows[0];
    assert_eq!((row.episodes, row.failed_in_first_5_percent, row.failed_ever_percent), (2, Some(50.0), Some(50.0)));
    assert_eq!((row.refused_views, row.off_percent, row.lambda_median), (Some(0.5), Some(25.0), Some(5.0)));
    assert!((row.left_mm.unwrap() - 1.0).abs() < 1e-9 && (row.overlap_percent.unwrap() - 88.0 / 3.0).abs() < 1e-9);
    assert_eq!(row.coverage_after_5_percent, Some(80.0), "the last one where the episode ended before");
}

#[test]
fn empty_scans_have_nothing_to_register_by() {
    let over_scans = |contents: &Contents| {
        let row = &rows(contents, &EvaluateConfig::default(), &["p".to_owned()])[0];
        [row.overlap_percent, row.like_overlap_percent, row.lambda_median, row.expected_lambda_median]
    };
    let mut with_empty = contents();
    let (record, _) = &mut with_empty.episodes[0];
    let outcome = record.registration.as_mut().expect("registered");
    for _ in 0..2 {
        record.overlaps.push(None);
        let refused = Some(Refused::Empty);
        outcome.views.push(ViewRegistration { refused, like_overlap: 0.0, expected_lambda: 0.0, ..view(None, 0.0) });
    }
    assert_eq!(over_scans(&with_empty), over_scans(&contents()));
}

#[test]
fn there_is_no_coverage_after_more_views_than_an_episode_has() {
    let mut config = EvaluateConfig::default();
    let after = |config: &EvaluateConfig| {
        let row = &rows(&contents(), config, &["p".to_owned()])[0];
        [row.coverage_after_5_percent, row.coverage_after_8_percent, row.coverage_after_15_percent]
    };
    assert_eq!(after(&config), [Some(80.0); 3]);
    config.episode.num_views = 8;
    assert_eq!(after(&config), [Some(80.0), Some(80.0), None]);
}

#[test]
fn what_an_adjustment_mended_is_not_off_at_the_end() {
    let off_at_end = |mend: &dyn Fn(&mut ViewRegistration)| {
        let mut contents = contents();
        contents.episodes[0].0.registration.iter_mut().flat_map(|o| &mut o.views).for_each(mend);
        let row = &rows(&contents, &EvaluateConfig::default(), &["p".to_owned()])[0];
        assert_eq!(row.failed_in_first_5_percent, Some(50.0), "as it was merged, whatever came later");
        row.off_at_end_in_first_5_percent
    };
    let adjusted = |to_m: f64| {
        move |v: &mut ViewRegistration| {
            (v.adjusted_m, v.adjusted_failed) = (Some(to_m), Some(to_m > 0.002));
        }
    };
    assert_eq!(off_at_end(&|_| {}), Some(50.0));
    assert_eq!(off_at_end(&adjusted(0.0004)), Some(0.0));
    assert_eq!(off_at_end(&adjusted(0.003)), Some(50.0));
    let of_before = |v: &mut ViewRegistration| v.adjusted_m = Some(0.0004);
    assert_eq!(off_at_end(&of_before), Some(0.0), "of the other episode: a record of an earlier version does not say");
}

#[test]
fn scans_after_a_failure_do_not_count_against_their_overlap() {
    let failures = failures(&contents());
    let find = |by: &str, from: f64| failures.iter().find(|r| r.by == by && r.from == from).expect("a bin");
    assert_eq!((find("lambda", 25.0).scans, find("lambda", 25.0).failed_percent), (1, Some(0.0)), "one of two");
    assert_eq!((find("lambda", 0.0).scans, find("lambda", 0.0).failed_percent), (1, Some(100.0)), "refused: none");
    let left = find("overlap", 30.0).left_median_mm.expect("scans");
    assert!(find("overlap", 30.0).scans == 2 && (left - 0.3).abs() < 1e-9, "between 0.2 and 0.4: {left}");
    assert_eq!(find("expected_lambda", 4.0).scans, 2);
    assert_eq!((find("overlap", 60.0).scans, find("overlap", 60.0).failed_percent), (0, None));
}

#[test]
fn runs_without_registration_have_no_such_tables() {
    let plain = Contents {
        episodes: vec![(record("a", "p", 0, &[0.5], &[]), Timing { episode_s: 1.0, decisions_s: vec![] })],
        skipped: vec![],
    };
    let config = EvaluateConfig::default();
    assert!(rows(&plain, &config, &["p".to_owned()]).is_empty() && failures(&plain).is_empty());
    assert!(tables(&[], &[]).is_empty());
}

#[test]
fn intervals_of_shares_are_wilsons() {
    let row = |failed_percent, scans| FailureRow {
        by: "lambda",
        from: 0.0,
        to: None,
        scans,
        failed_percent,
        left_median_mm: None,
    };
    // The roots p of |share - p| = 1.96 sqrt(p (1 - p) / n), by bisection.
    for (failed, scans, [low, high]) in
        [(0.0, 10, [0.0, 27.753]), (50.0, 10, [23.659, 76.341]), (4.0, 100, [1.566, 9.837])]
    {
        let [l, h] = row(Some(failed), scans).interval().expect("scans");
        assert!((l - low).abs() < 5e-3 && (h - high).abs() < 5e-3, "{failed} % of {scans}: {l} {h}");
    }
    assert_eq!(row(None, 0).interval(), None);
}
