//! Tables of episodes whose scans had to be registered.

use super::table::{Row, Table, number, range};
use crate::bootstrap::{ResampleUnit, draws, mean_interval};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, quantile};
use crate::record::EpisodeRecord;
use datagen::registration::{Refused, ViewRegistration};
use serde::Serialize;

/// Edges of the bins of overlaps, percent, and of lambda; the last one is open.
const OVERLAPS: [f64; 7] = [0.0, 5.0, 10.0, 20.0, 30.0, 40.0, 60.0];
const LAMBDAS: [f64; 7] = [0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 25.0];

/// How the scans of a policy were registered. Coverage, efficiency and views in the other tables count points that are off by less
/// than the tolerance alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct RegistrationRow {
    pub policy: String,
    pub episodes: usize,
    /// After so many next views; absent where there are fewer in an episode.
    pub coverage_after_5_percent: Option<f64>,
    pub coverage_after_8_percent: Option<f64>,
    pub coverage_after_15_percent: Option<f64>,
    /// Episodes with a merged scan that is off by more than the tolerance, among next views 1 to 5.
    pub failed_in_first_5_percent: Option<f64>,
    pub failed_in_first_5_percent_ci_episodes_low: Option<f64>,
    pub failed_in_first_5_percent_ci_episodes_high: Option<f64>,
    pub failed_ever_percent: Option<f64>,
    /// Episodes where one of next views 1 to 5 is off by more than the tolerance at the end, after all adjustments.
    pub off_at_end_in_first_5_percent: Option<f64>,
    pub refused_views: Option<f64>,
    /// Root mean square of how far merged points are off.
    pub left_mm: Option<f64>,
    pub off_percent: Option<f64>,
    /// This and what follows: over scans that have points.
    pub overlap_percent: Option<f64>,
    pub like_overlap_percent: Option<f64>,
    pub lambda_median: Option<f64>,
    pub expected_lambda_median: Option<f64>,
}

impl Row for RegistrationRow {
    const HEADINGS: &'static [&'static str] = &[
        "policy",
        "episodes",
        "coverage after 5",
        "after 8",
        "after 15",
        "failed in first 5, %",
        "failed, 95 % episodes",
        "failed ever, %",
        "of first 5 off at the end, %",
        "refused views",
        "left mm",
        "off %",
        "overlap %",
        "like normals %",
        "lambda",
        "lambda expected",
    ];

    fn cells(&self) -> Vec<String> {
        let (low, high) =
            (self.failed_in_first_5_percent_ci_episodes_low, self.failed_in_first_5_percent_ci_episodes_high);
        vec![
            self.policy.clone(),
            self.episodes.to_string(),
            number(self.coverage_after_5_percent, 1),
            number(self.coverage_after_8_percent, 1),
            number(self.coverage_after_15_percent, 1),
            number(self.failed_in_first_5_percent, 0),
            range(low, high, 0),
            number(self.failed_ever_percent, 0),
            number(self.off_at_end_in_first_5_percent, 1),
            number(self.refused_views, 2),
            number(self.left_mm, 2),
            number(self.off_percent, 1),
            number(self.overlap_percent, 1),
            number(self.like_overlap_percent, 1),
            number(self.lambda_median, 1),
            number(self.expected_lambda_median, 1),
        ]
    }
}

/// How often scans failed that were registered onto a sound cloud, of all policies together.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct FailureRow {
    /// What they are sorted by: `overlap`, `like_overlap` (percent), `lambda`, `expected_lambda`.
    pub by: &'static str,
    pub from: f64,
    pub to: Option<f64>,
    pub scans: usize,
    pub failed_percent: Option<f64>,
    pub left_median_mm: Option<f64>,
}

impl FailureRow {
    /// The 95 % interval of [`Self::failed_percent`], as if scans were independent (Wilson 1927).
    pub fn interval(&self) -> Option<[f64; 2]> {
        const Z: f64 = 1.96;
        let (share, n) = (self.failed_percent? / 100.0, self.scans as f64);
        let middle = share + Z * Z / (2.0 * n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        Some([middle - half, middle + half].map(|x| 100.0 * x / (1.0 + Z * Z / n)))
    }
}

impl Row for FailureRow {
    const HEADINGS: &'static [&'static str] = &["by", "from", "to", "scans", "failed %", "left mm, median"];

    fn cells(&self) -> Vec<String> {
        vec![
            self.by.replace('_', " "),
            number(Some(self.from), 0),
            number(self.to, 0),
            self.scans.to_string(),
            number(self.failed_percent, 0),
            number(self.left_median_mm, 2),
        ]
    }
}

/// One row per policy whose scans were registered.
pub fn rows(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<RegistrationRow> {
    let registered = || contents.episodes.iter().map(|(r, _)| r).filter(|r| r.registration.is_some());
    let all = policies.iter().map(|policy| (policy, Runs::of(registered(), policy)));
    all.filter(|(_, runs)| !runs.is_empty()).map(|(policy, runs)| row(policy, &runs, config)).collect()
}

fn row(policy: &str, runs: &Runs, config: &EvaluateConfig) -> RegistrationRow {
    let column = |figure| runs.column(figure, config.views_if_unreached());
    let m = |figure| column(figure).mean();
    let after = |views: usize| m(Figure::CoverageAfter(views)).filter(|_| views <= config.episode.num_views);
    let failed = column(Figure::FailedIn(5));
    let interval =
        mean_interval(&failed, &draws(&failed.sizes(), ResampleUnit::Episodes, config.resamples, config.seed));
    // A scan without points has nothing to register by.
    let views = || runs.records().flat_map(views_of).filter(|(_, _, v)| v.refused != Some(Refused::Empty));
    let percent = |of: &dyn Fn(&EpisodeRecord, usize, &ViewRegistration) -> Option<f64>| {
        crate::metrics::mean(views().filter_map(|(r, i, v)| of(r, i, v))).map(|share| 100.0 * share)
    };
    RegistrationRow {
        policy: policy.to_owned(),
        episodes: runs.len(),
        coverage_after_5_percent: after(5),
        coverage_after_8_percent: after(8),
        coverage_after_15_percent: after(15),
        failed_in_first_5_percent: failed.mean(),
        failed_in_first_5_percent_ci_episodes_low: interval.and_then(|i| i.low),
        failed_in_first_5_percent_ci_episodes_high: interval.and_then(|i| i.high),
        failed_ever_percent: m(Figure::FailedIn(u8::MAX)),
        off_at_end_in_first_5_percent: m(Figure::OffAtEnd(5)),
        refused_views: m(Figure::RefusedViews),
        left_mm: m(Figure::Left),
        off_percent: m(Figure::Off),
        overlap_percent: percent(&|r, i, _| r.overlaps.get(i).copied().flatten()),
        like_overlap_percent: percent(&|_, _, v| Some(v.like_overlap)),
        lambda_median: median(views().map(|(_, _, v)| v.lambda).collect()),
        expected_lambda_median: median(views().map(|(_, _, v)| v.expected_lambda).collect()),
    }
}

/// The next views of an episode, each with its number from 0 and its outcome.
fn views_of(record: &EpisodeRecord) -> impl Iterator<Item = (&EpisodeRecord, usize, &ViewRegistration)> {
    let views = record.registration.iter().flat_map(|outcome| &outcome.views);
    views.enumerate().map(move |(i, view)| (record, i, view))
}

/// Failures by what there was to register by.
pub fn failures(contents: &Contents) -> Vec<FailureRow> {
    // Once a scan is off, those after it are registered onto a cloud that is wrong.
    let mut scans: Vec<(f64, &ViewRegistration, f64)> = Vec::new();
    for (record, _) in &contents.episodes {
        for (_, i, view) in views_of(record) {
            let Some(left) = view.left_m else { continue };
            // What one that waited overlapped with when it came is not what it was registered by.
            if view.waited == 0 {
                scans.push((record.overlaps.get(i).copied().flatten().unwrap_or(0.0), view, left));
            }
            if view.failed {
                break;
            }
        }
    }
    if scans.is_empty() {
        return Vec::new();
    }
    type By = (&'static str, [f64; 7], fn(f64, &ViewRegistration) -> f64);
    let by: [By; 4] = [
        ("overlap", OVERLAPS, |overlap, _| 100.0 * overlap),
        ("like_overlap", OVERLAPS, |_, view| 100.0 * view.like_overlap),
        ("lambda", LAMBDAS, |_, view| view.lambda),
        ("expected_lambda", LAMBDAS, |_, view| view.expected_lambda),
    ];
    let mut rows = Vec::new();
    for (by, edges, value) in by {
        for (k, &from) in edges.iter().enumerate() {
            let to = edges.get(k + 1).copied();
            let within = |x: f64| x >= from && to.is_none_or(|to| x < to);
            let inside = || scans.iter().filter(|(o, v, _)| within(value(*o, v)));
            let left: Vec<f64> = inside().map(|s| s.2).collect();
            let failed = inside().filter(|s| s.1.failed).count() as f64;
            rows.push(FailureRow {
                by,
                from,
                to,
                scans: left.len(),
                failed_percent: (!left.is_empty()).then(|| 100.0 * failed / left.len() as f64),
                left_median_mm: median(left).map(|l| 1e3 * l),
            });
        }
    }
    rows
}

fn median(values: Vec<f64>) -> Option<f64> {
    quantile(values, 0.5)
}

/// The tables; none where nothing was registered.
pub fn tables(rows: &[RegistrationRow], failures: &[FailureRow]) -> Vec<Table> {
    if rows.is_empty() {
        return Vec::new();
    }
    vec![
        Table::of(
            "Registration",
            "Scans were given poses that are off, and registered. Coverage, here and everywhere in this run, counts points that are \
             off by less than the tolerance. Failed: episodes with a merged scan that is off by more (root mean square). left: how far \
             merged points are off in the end. Over scans that have points: overlap and like normals (means), lambda (medians).",
            rows,
        ),
        Table::of(
            "Failures of scans onto a sound cloud",
            "Merged scans of all policies, up to the first that failed in each episode. Overlaps in percent.",
            failures,
        ),
    ]
}

#[cfg(test)]
mod tests;
