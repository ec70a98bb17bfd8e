//! Recorded sequences: views to a share of the union of all scans, what was expected of each view and what it brought, and
//! where `stop` would have ended.

use super::table::{Row, Table, number, range};
use crate::bootstrap::{Interval, ResampleUnit, draws, mean_interval};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, mean, quantile};
use crate::record::EpisodeRecord;
use datagen::dataset::DatasetName;
use serde::Serialize;

/// Steps that add less are too small for a ratio.
const LEAST_GAIN: f64 = 0.01;
/// `stop_below` that the table of stops is for.
const STOP_BELOW: f64 = 0.02;
/// Steps that get their own row.
const STEPS: usize = 5;
/// What rows over all sequences, and over all steps, say instead of which.
const ALL: &str = "all";

/// A policy on a sequence, or on all.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct RecordedRow {
    pub sequence: String,
    pub policy: String,
    pub starts: usize,
    pub views_to_50: Option<f64>,
    pub views_to_80: Option<f64>,
    pub views_to_80_ci_starts_low: Option<f64>,
    pub views_to_80_ci_starts_high: Option<f64>,
    pub views_to_90: Option<f64>,
    pub views_to_90_ci_starts_low: Option<f64>,
    pub views_to_90_ci_starts_high: Option<f64>,
    /// Of all sequences alone.
    pub views_to_90_ci_sequences_low: Option<f64>,
    pub views_to_90_ci_sequences_high: Option<f64>,
    pub views_to_95: Option<f64>,
    pub views_to_95_ci_starts_low: Option<f64>,
    pub views_to_95_ci_starts_high: Option<f64>,
    pub overlap_1_percent: Option<f64>,
    pub overlap_2_percent: Option<f64>,
    pub overlap_3_percent: Option<f64>,
}

impl Row for RecordedRow {
    const HEADINGS: &'static [&'static str] = &[
        "sequence",
        "policy",
        "starts",
        "v50",
        "v80",
        "v80, 95 % starts",
        "v90",
        "v90, 95 % starts",
        "v90, 95 % sequences",
        "v95",
        "v95, 95 % starts",
        "overlap 1",
        "overlap 2",
        "overlap 3",
    ];

    fn cells(&self) -> Vec<String> {
        vec![
            self.sequence.clone(),
            self.policy.clone(),
            self.starts.to_string(),
            number(self.views_to_50, 2),
            number(self.views_to_80, 2),
            range(self.views_to_80_ci_starts_low, self.views_to_80_ci_starts_high, 2),
            number(self.views_to_90, 2),
            range(self.views_to_90_ci_starts_low, self.views_to_90_ci_starts_high, 2),
            range(self.views_to_90_ci_sequences_low, self.views_to_90_ci_sequences_high, 2),
            number(self.views_to_95, 2),
            range(self.views_to_95_ci_starts_low, self.views_to_95_ci_starts_high, 2),
            number(self.overlap_1_percent, 1),
            number(self.overlap_2_percent, 1),
            number(self.overlap_3_percent, 1),
        ]
    }
}

/// Expected and true gain of the views of a policy on a sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct ForecastRow {
    pub sequence: String,
    pub policy: String,
    /// Scans before the view.
    pub after_scans: String,
    pub steps: usize,
    pub expected_gain_percent: Option<f64>,
    pub true_gain_percent: Option<f64>,
    /// Of the steps that add 1 % at least.
    pub steps_in_ratio: usize,
    pub ratio_median: Option<f64>,
    pub ratio_quartile_low: Option<f64>,
    pub ratio_quartile_high: Option<f64>,
    pub within_factor_2_percent: Option<f64>,
}

impl Row for ForecastRow {
    const HEADINGS: &'static [&'static str] = &[
        "sequence",
        "policy",
        "after scans",
        "steps",
        "expected gain %",
        "true gain %",
        "steps of 1 % and more",
        "expected / true, median",
        "quartiles",
        "within a factor of 2, %",
    ];

    fn cells(&self) -> Vec<String> {
        vec![
            self.sequence.clone(),
            self.policy.clone(),
            self.after_scans.clone(),
            self.steps.to_string(),
            number(self.expected_gain_percent, 2),
            number(self.true_gain_percent, 2),
            self.steps_in_ratio.to_string(),
            number(self.ratio_median, 2),
            range(self.ratio_quartile_low, self.ratio_quartile_high, 2),
            number(self.within_factor_2_percent, 0),
        ]
    }
}

/// Where a policy would have stopped on a sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct StopRow {
    pub sequence: String,
    pub policy: String,
    pub episodes: usize,
    pub stopped: usize,
    pub scans_at_stop: Option<f64>,
    pub missing_at_stop_percent: Option<f64>,
    pub missing_at_stop_most_percent: Option<f64>,
}

impl Row for StopRow {
    const HEADINGS: &'static [&'static str] =
        &["sequence", "policy", "episodes", "stopped", "scans at stop", "missing then %", "missing at most %"];

    fn cells(&self) -> Vec<String> {
        vec![
            self.sequence.clone(),
            self.policy.clone(),
            self.episodes.to_string(),
            self.stopped.to_string(),
            number(self.scans_at_stop, 2),
            number(self.missing_at_stop_percent, 2),
            number(self.missing_at_stop_most_percent, 2),
        ]
    }
}

/// Sequence by sequence; over all, where there are several, for policies that ran on each of them.
pub fn rows(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<RecordedRow> {
    let sequences = sequences(contents, config);
    // A sequence; `None`: all of them.
    let of = |sequence: Option<&str>, policy: &str| {
        let all = Runs::of(contents.episodes.iter().map(|(r, _)| r), policy);
        let runs = match sequence {
            Some(sequence) => all.object(sequence),
            None => all,
        };
        if runs.is_empty() || (sequence.is_none() && runs.objects().len() < sequences.len()) {
            return None;
        }
        let column = |figure| runs.column(figure, config.views_if_unreached());
        let drawn = |over| draws(&column(Figure::FinalCoverage).sizes(), over, config.resamples, config.seed);
        let starts = drawn(ResampleUnit::Episodes);
        let over_starts = |percent| mean_interval(&column(Figure::ViewsTo(percent)), &starts);
        let over_sequences = sequence
            .is_none()
            .then(|| mean_interval(&column(Figure::ViewsTo(90)), &drawn(ResampleUnit::Objects)))
            .flatten();
        let [v80, v90, v95] = [80, 90, 95].map(over_starts);
        let (low, high) = (|i: Option<Interval>| i.and_then(|i| i.low), |i: Option<Interval>| i.and_then(|i| i.high));
        let value = |i: Option<Interval>| i.map(|i| i.value);
        Some(RecordedRow {
            sequence: sequence.unwrap_or(ALL).to_owned(),
            policy: policy.to_owned(),
            starts: runs.len(),
            views_to_50: column(Figure::ViewsTo(50)).mean(),
            views_to_80: value(v80),
            views_to_80_ci_starts_low: low(v80),
            views_to_80_ci_starts_high: high(v80),
            views_to_90: value(v90),
            views_to_90_ci_starts_low: low(v90),
            views_to_90_ci_starts_high: high(v90),
            views_to_90_ci_sequences_low: low(over_sequences),
            views_to_90_ci_sequences_high: high(over_sequences),
            views_to_95: value(v95),
            views_to_95_ci_starts_low: low(v95),
            views_to_95_ci_starts_high: high(v95),
            overlap_1_percent: column(Figure::Overlap(1)).mean(),
            overlap_2_percent: column(Figure::Overlap(2)).mean(),
            overlap_3_percent: column(Figure::Overlap(3)).mean(),
        })
    };
    let all = (sequences.len() > 1).then_some(None);
    let names = sequences.iter().copied().map(Some).chain(all);
    names.flat_map(|sequence| policies.iter().filter_map(move |policy| of(sequence, policy))).collect()
}

/// Sequences by name, in a run on recorded ones.
fn sequences<'a>(contents: &'a Contents, config: &EvaluateConfig) -> Vec<&'a str> {
    if config.dataset.name != DatasetName::Sequences {
        return Vec::new();
    }
    let mut names: Vec<&str> = contents.episodes.iter().map(|(r, _)| r.key.object.as_str()).collect();
    names.dedup();
    names
}

/// The episodes of a policy on a sequence in which something was expected.
fn told<'a>(contents: &'a Contents, sequence: &str, policy: &str) -> Vec<&'a EpisodeRecord> {
    let of = |r: &&EpisodeRecord| r.key.object == sequence && r.key.policy == policy && !r.forecasts.is_empty();
    contents.episodes.iter().map(|(r, _)| r).filter(of).collect()
}

/// What was expected of the views taken, step by step and over all steps.
pub fn forecasts(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<ForecastRow> {
    let mut rows = Vec::new();
    for sequence in sequences(contents, config) {
        for policy in policies {
            let episodes = told(contents, sequence, policy);
            let steps: Vec<(usize, f64, f64)> = episodes
                .iter()
                .flat_map(|r| {
                    let gains = r.coverages.windows(2).map(|c| c[1] - c[0]);
                    let both = r.forecasts.iter().zip(gains).enumerate();
                    both.filter_map(|(i, (forecast, gain))| Some((i + 1, forecast.gain?, gain)))
                })
                .collect();
            let of = |after: Option<usize>| {
                let chosen: Vec<_> = steps.iter().filter(|(i, ..)| after.is_none_or(|a| a == *i)).collect();
                let ratios: Vec<f64> =
                    chosen.iter().filter(|(.., gain)| *gain >= LEAST_GAIN).map(|(_, e, gain)| e / gain).collect();
                let at = |share: f64| quantile(ratios.clone(), share);
                let near = ratios.iter().filter(|r| (0.5..=2.0).contains(*r)).count();
                ForecastRow {
                    sequence: sequence.to_owned(),
                    policy: policy.clone(),
                    after_scans: after.map_or_else(|| ALL.to_owned(), |a| a.to_string()),
                    steps: chosen.len(),
                    expected_gain_percent: mean(chosen.iter().map(|(_, expected, _)| 100.0 * expected)),
                    true_gain_percent: mean(chosen.iter().map(|(.., gain)| 100.0 * gain)),
                    steps_in_ratio: ratios.len(),
                    ratio_median: at(0.5),
                    ratio_quartile_low: at(0.25),
                    ratio_quartile_high: at(0.75),
                    within_factor_2_percent: (!ratios.is_empty()).then(|| 100.0 * near as f64 / ratios.len() as f64),
                }
            };
            let each = (1..=STEPS).map(Some).chain([None]).map(of).filter(|row| row.steps > 0);
            rows.extend(each);
        }
    }
    rows
}

/// The most that was expected at each decision that a scan followed: where none is left, none can add anything.
fn most(record: &EpisodeRecord) -> impl Iterator<Item = Option<f64>> {
    record.forecasts.iter().zip(record.coverages.iter().skip(1)).map(|(forecast, _)| forecast.most)
}

/// Where each policy that predicts anything would have stopped.
pub fn stops(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<StopRow> {
    let mut rows = Vec::new();
    for sequence in sequences(contents, config) {
        for policy in policies {
            let episodes = told(contents, sequence, policy);
            if !episodes.iter().any(|r| most(r).any(|expected| expected.is_some())) {
                continue;
            }
            // The decision after `i + 1` scans.
            let at = |r: &&EpisodeRecord| {
                most(r).position(|m| m.is_some_and(|m| m < STOP_BELOW)).map(|i| (i, r.coverages[i]))
            };
            let stops: Vec<(usize, f64)> = episodes.iter().filter_map(at).collect();
            let missing = |coverage: f64| 100.0 * (1.0 - coverage);
            rows.push(StopRow {
                sequence: sequence.to_owned(),
                policy: policy.clone(),
                episodes: episodes.len(),
                stopped: stops.len(),
                scans_at_stop: mean(stops.iter().map(|(i, _)| (i + 1) as f64)),
                missing_at_stop_percent: mean(stops.iter().map(|(_, c)| missing(*c))),
                missing_at_stop_most_percent: stops.iter().map(|(_, c)| missing(*c)).max_by(f64::total_cmp),
            });
        }
    }
    rows
}

/// [`rows`] for readers.
pub fn table(rows: &[RecordedRow]) -> Table {
    Table::of(
        "Recorded sequences",
        "Views, the first included, to this share of the union of all scans: its points averaged in voxels as wide as the \
         tolerance, covered where a point of a scan taken lies within the tolerance. Means over starts, and of `all` over \
         sequences of these. Overlap: share of what the scan covers that was covered before, next views 1 to 3, percent.",
        rows,
    )
}

/// [`forecasts`] for readers.
pub fn forecast_table(rows: &[ForecastRow]) -> Table {
    Table::of(
        "Expected and true gain",
        "Of the views taken, as shares of the whole. Ratios are of the steps that add 1 % at least.",
        rows,
    )
}

/// [`stops`] for readers.
pub fn stop_table(rows: &[StopRow]) -> Table {
    let note = format!(
        "Episodes in which no view was expected to add {STOP_BELOW}, nor did the last scan, and what was missing \
         there first. Decisions that no scan followed do not count."
    );
    Table::of(&format!("What --stop-below {STOP_BELOW} would have left"), &note, rows)
}

#[cfg(test)]
mod tests;
