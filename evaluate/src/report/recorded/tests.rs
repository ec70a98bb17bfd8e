use super::*;
use crate::metrics::tests::record;
use crate::record::{Forecast, Timing};

#[test]
fn forecasts_are_held_against_what_came() {
    let mut config = EvaluateConfig { resamples: 50, views_if_unreached: Some(9), ..EvaluateConfig::default() };
    let episode = |sequence: &str, number: usize, coverages: &[f64], expected: &[f64]| {
        let mut record = record(sequence, "auto", number, coverages, &vec![Some(0.5); coverages.len() - 1]);
        record.forecasts = expected.iter().map(|&gain| Forecast { gain: Some(gain), most: Some(gain) }).collect();
        (record, Timing { episode_s: 0.0, decisions_s: Vec::new() })
    };
    // Gains 0.4, 0.1, 0.1, 0.005; the last decision of the first ends it.
    let contents = Contents {
        episodes: vec![
            episode("a", 0, &[0.395, 0.795, 0.895, 0.995, 1.0], &[0.25, 0.15, 0.3, 0.01, 0.0]),
            episode("a", 1, &[0.5, 0.9], &[0.21]),
            episode("b", 0, &[0.5, 1.0], &[0.5]),
        ],
        skipped: Vec::new(),
    };
    let policies = ["auto".to_owned()];
    assert!(rows(&contents, &config, &policies).is_empty(), "meshes");
    config.dataset.name = DatasetName::Sequences;
    let recorded = rows(&contents, &config, &policies);
    let views: Vec<_> = recorded.iter().map(|r| (r.sequence.as_str(), r.views_to_80, r.views_to_95)).collect();
    // a: 3 and 2 views to 80 %, 4 and never (9) to 95 %.
    assert_eq!(views, [("a", Some(2.5), Some(6.5)), ("b", Some(2.0), Some(2.0)), ("all", Some(2.25), Some(4.25))]);
    let of_b = &recorded[1];
    assert_eq!((of_b.views_to_90_ci_starts_low, of_b.views_to_90_ci_starts_high), (None, None), "one start");
    assert!(recorded[0].views_to_90_ci_starts_low.is_some(), "two starts");
    let forecasts = forecasts(&contents, &config, &policies);
    let all = forecasts.iter().find(|r| r.sequence == "a" && r.after_scans == "all").expect("all");
    // Ratios 0.625, 1.5, 3 and 0.525; a step of 0.5 % has none.
    assert_eq!((all.steps, all.steps_in_ratio), (5, 4));
    let near = |found: Option<f64>, expected: f64| (found.expect("a number") - expected).abs() < 1e-9;
    assert!(near(all.within_factor_2_percent, 75.0) && near(all.ratio_median, 1.0625), "{all:?}");
    assert!(near(all.ratio_quartile_low, 0.6) && near(all.ratio_quartile_high, 1.875), "as numpy: {all:?}");
    let first = &forecasts[0];
    assert!(first.after_scans == "1" && near(first.expected_gain_percent, 23.0), "{first:?}");
    assert!(near(first.true_gain_percent, 40.0) && near(first.ratio_median, 0.575), "{first:?}");
    let stops = stops(&contents, &config, &policies);
    // After four scans of the first episode 0.5 % are missing.
    assert_eq!((stops[0].episodes, stops[0].stopped, stops[0].scans_at_stop), (2, 1, Some(4.0)));
    assert!(near(stops[0].missing_at_stop_percent, 0.5), "{stops:?}");
    assert_eq!((stops[1].stopped, stops[1].missing_at_stop_percent), (0, None));
}

fn recorded(sequence: &str, policy: &str, coverages: &[f64], expected: &[Option<f64>]) -> (EpisodeRecord, Timing) {
    let mut record = record(sequence, policy, 0, coverages, &vec![Some(0.5); coverages.len() - 1]);
    record.forecasts = expected.iter().map(|&most| Forecast { gain: None, most }).collect();
    (record, Timing { episode_s: 0.0, decisions_s: Vec::new() })
}

fn of_recordings() -> EvaluateConfig {
    let mut config = EvaluateConfig { resamples: 50, ..EvaluateConfig::default() };
    config.dataset.name = DatasetName::Sequences;
    config
}

#[test]
fn a_sequence_may_be_called_all() {
    let episodes = vec![recorded("all", "p", &[0.5, 1.0], &[]), recorded("b", "p", &[0.9], &[])];
    let rows = rows(&Contents { episodes, skipped: Vec::new() }, &of_recordings(), &["p".to_owned()]);
    let found: Vec<_> = rows.iter().map(|r| (r.sequence.as_str(), r.starts, r.views_to_80)).collect();
    assert_eq!(found, [("all", 1, Some(2.0)), ("b", 1, Some(1.0)), ("all", 2, Some(1.5))]);
}

#[test]
fn only_decisions_before_a_scan_may_stop() {
    let episodes = vec![
        // The last scan is the second: nothing is left to decide.
        recorded("a", "auto", &[0.5, 1.0], &[Some(0.5), Some(0.0)]),
        recorded("a", "farthest", &[0.5, 1.0], &[None, None]),
    ];
    let policies = ["auto".to_owned(), "farthest".to_owned()];
    let stops = stops(&Contents { episodes, skipped: Vec::new() }, &of_recordings(), &policies);
    let found: Vec<_> = stops.iter().map(|r| (r.policy.as_str(), r.episodes, r.stopped)).collect();
    assert_eq!(found, [("auto", 1, 0)]);
}
