//! The rows of a run's tables. CSV, JSON and Markdown are made from the same ones: CSV and JSON name every number with its
//! unit and give all its digits, Markdown rounds. `se` is the standard error over episodes, `ci` a 95 % interval.

use super::table::{Row, number, range};
use serde::Serialize;

/// A policy over all objects.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct PolicyRow {
    pub policy: String,
    pub episodes: usize,
    pub coverage_percent: Option<f64>,
    pub coverage_percent_ci_episodes_low: Option<f64>,
    pub coverage_percent_ci_episodes_high: Option<f64>,
    pub efficiency: Option<f64>,
    pub efficiency_ci_episodes_low: Option<f64>,
    pub efficiency_ci_episodes_high: Option<f64>,
    pub efficiency_ci_objects_low: Option<f64>,
    pub efficiency_ci_objects_high: Option<f64>,
    pub views_to_50: Option<f64>,
    pub views_to_80: Option<f64>,
    pub views_to_90: Option<f64>,
    /// Area under the curve of coverage over all views, as a share of the whole.
    pub coverage_area_percent: Option<f64>,
    /// From camera position to camera position.
    pub path_m: Option<f64>,
    pub overlap_1_percent: Option<f64>,
    pub overlap_2_percent: Option<f64>,
    pub overlap_3_percent: Option<f64>,
    /// Coefficient of variation of overlaps 1 to 3.
    pub cv3_percent: Option<f64>,
    pub cv_all_percent: Option<f64>,
    pub cv_list_percent: Option<f64>,
    pub chamfer_mm: Option<f64>,
    pub hausdorff_mm: Option<f64>,
    pub episodes_below_90: usize,
    pub empty_scans: usize,
    pub episodes_ended_early: usize,
}

impl Row for PolicyRow {
    const HEADINGS: &'static [&'static str] = &[
        "policy",
        "episodes",
        "coverage %",
        "coverage, 95 % episodes",
        "efficiency",
        "efficiency, 95 % episodes",
        "efficiency, 95 % objects",
        "v50",
        "v80",
        "v90",
        "area %",
        "path m",
        "overlap 1",
        "overlap 2",
        "overlap 3",
        "cv3",
        "cv all",
        "cv list",
        "CD mm",
        "HD mm",
        "never",
        "empty scans",
        "ended early",
    ];

    fn cells(&self) -> Vec<String> {
        vec![
            self.policy.clone(),
            self.episodes.to_string(),
            number(self.coverage_percent, 2),
            range(self.coverage_percent_ci_episodes_low, self.coverage_percent_ci_episodes_high, 2),
            number(self.efficiency, 2),
            range(self.efficiency_ci_episodes_low, self.efficiency_ci_episodes_high, 2),
            range(self.efficiency_ci_objects_low, self.efficiency_ci_objects_high, 2),
            number(self.views_to_50, 2),
            number(self.views_to_80, 2),
            number(self.views_to_90, 2),
            number(self.coverage_area_percent, 1),
            number(self.path_m, 2),
            number(self.overlap_1_percent, 1),
            number(self.overlap_2_percent, 1),
            number(self.overlap_3_percent, 1),
            number(self.cv3_percent, 1),
            number(self.cv_all_percent, 1),
            number(self.cv_list_percent, 1),
            number(self.chamfer_mm, 3),
            number(self.hausdorff_mm, 2),
            self.episodes_below_90.to_string(),
            self.empty_scans.to_string(),
            self.episodes_ended_early.to_string(),
        ]
    }
}

/// A policy paired with the baseline.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct PairedRow {
    pub policy: String,
    pub baseline: String,
    pub pairs: usize,
    /// Of efficiencies.
    pub ratio: Option<f64>,
    pub ratio_ci_episodes_low: Option<f64>,
    pub ratio_ci_episodes_high: Option<f64>,
    pub ratio_ci_objects_low: Option<f64>,
    pub ratio_ci_objects_high: Option<f64>,
    pub coverage_difference_points: Option<f64>,
    pub coverage_difference_points_ci_episodes_low: Option<f64>,
    pub coverage_difference_points_ci_episodes_high: Option<f64>,
    pub views_to_90_difference: Option<f64>,
    pub views_to_90_difference_ci_episodes_low: Option<f64>,
    pub views_to_90_difference_ci_episodes_high: Option<f64>,
    pub cv3_difference_points: Option<f64>,
    pub cv3_difference_points_ci_episodes_low: Option<f64>,
    pub cv3_difference_points_ci_episodes_high: Option<f64>,
}

impl Row for PairedRow {
    const HEADINGS: &'static [&'static str] = &[
        "policy",
        "pairs",
        "efficiency ratio",
        "ratio, 95 % episodes",
        "ratio, 95 % objects",
        "coverage, points",
        "coverage, 95 %",
        "v90, views",
        "v90, 95 %",
        "cv3, points",
        "cv3, 95 %",
    ];

    fn cells(&self) -> Vec<String> {
        vec![
            self.policy.clone(),
            self.pairs.to_string(),
            number(self.ratio, 3),
            range(self.ratio_ci_episodes_low, self.ratio_ci_episodes_high, 3),
            range(self.ratio_ci_objects_low, self.ratio_ci_objects_high, 3),
            number(self.coverage_difference_points, 2),
            range(self.coverage_difference_points_ci_episodes_low, self.coverage_difference_points_ci_episodes_high, 2),
            number(self.views_to_90_difference, 2),
            range(self.views_to_90_difference_ci_episodes_low, self.views_to_90_difference_ci_episodes_high, 2),
            number(self.cv3_difference_points, 1),
            range(self.cv3_difference_points_ci_episodes_low, self.cv3_difference_points_ci_episodes_high, 1),
        ]
    }
}

/// A policy on one object; a row of `summary.csv`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct ObjectRow {
    pub object: String,
    pub policy: String,
    pub episodes: usize,
    pub coverage_percent: Option<f64>,
    pub coverage_percent_se: Option<f64>,
    pub efficiency: Option<f64>,
    pub views_to_50: Option<f64>,
    pub views_to_80: Option<f64>,
    pub views_to_90: Option<f64>,
    pub views_to_90_se: Option<f64>,
    pub overlap_1_percent: Option<f64>,
    pub overlap_1_percent_se: Option<f64>,
    pub overlap_2_percent: Option<f64>,
    pub overlap_2_percent_se: Option<f64>,
    pub overlap_3_percent: Option<f64>,
    pub overlap_3_percent_se: Option<f64>,
    pub cv3_percent: Option<f64>,
    pub cv_all_percent: Option<f64>,
    pub chamfer_mm: Option<f64>,
    pub hausdorff_mm: Option<f64>,
    pub first_coverage_percent: Option<f64>,
    pub void_draws: usize,
}

impl Row for ObjectRow {
    const HEADINGS: &'static [&'static str] = &[
        "object",
        "policy",
        "episodes",
        "coverage %",
        "coverage se",
        "efficiency",
        "v50",
        "v80",
        "v90",
        "v90 se",
        "overlap 1",
        "overlap 1 se",
        "overlap 2",
        "overlap 2 se",
        "overlap 3",
        "overlap 3 se",
        "cv3",
        "cv all",
        "CD mm",
        "HD mm",
        "first scan %",
        "void draws",
    ];

    fn cells(&self) -> Vec<String> {
        vec![
            self.object.clone(),
            self.policy.clone(),
            self.episodes.to_string(),
            number(self.coverage_percent, 2),
            number(self.coverage_percent_se, 2),
            number(self.efficiency, 2),
            number(self.views_to_50, 2),
            number(self.views_to_80, 2),
            number(self.views_to_90, 2),
            number(self.views_to_90_se, 2),
            number(self.overlap_1_percent, 1),
            number(self.overlap_1_percent_se, 1),
            number(self.overlap_2_percent, 1),
            number(self.overlap_2_percent_se, 1),
            number(self.overlap_3_percent, 1),
            number(self.overlap_3_percent_se, 1),
            number(self.cv3_percent, 1),
            number(self.cv_all_percent, 1),
            number(self.chamfer_mm, 3),
            number(self.hausdorff_mm, 2),
            number(self.first_coverage_percent, 2),
            self.void_draws.to_string(),
        ]
    }
}

/// Times of a policy; a row of `timing.md`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct TimeRow {
    pub policy: String,
    pub episode_cpu_s: Option<f64>,
    pub objects_per_cpu_s: Option<f64>,
    pub decision_mean_ms: Option<f64>,
    pub decision_median_ms: Option<f64>,
}

impl Row for TimeRow {
    const HEADINGS: &'static [&'static str] =
        &["policy", "s per episode", "objects per core second", "ms per decision, mean", "ms per decision, median"];

    fn cells(&self) -> Vec<String> {
        vec![
            self.policy.clone(),
            number(self.episode_cpu_s, 3),
            number(self.objects_per_cpu_s, 1),
            number(self.decision_mean_ms, 2),
            number(self.decision_median_ms, 2),
        ]
    }
}

/// An episode that was not run, or an object that cannot be used: it has no policy and no episode.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct SkippedRow {
    pub object: String,
    pub policy: Option<String>,
    pub episode: Option<usize>,
    pub reason: String,
}

impl Row for SkippedRow {
    const HEADINGS: &'static [&'static str] = &["object", "policy", "episode", "why"];

    fn cells(&self) -> Vec<String> {
        let or_all = |text: Option<String>| text.unwrap_or_else(|| "all".to_owned());
        let episode = self.episode.map(|episode| episode.to_string());
        vec![self.object.clone(), or_all(self.policy.clone()), or_all(episode), self.reason.clone()]
    }
}

/// How much of the search's lead over a simple rule a policy closes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct ClosureRow {
    pub policy: String,
    pub closure: Option<f64>,
    pub closure_ci_episodes_low: Option<f64>,
    pub closure_ci_episodes_high: Option<f64>,
}

impl Row for ClosureRow {
    const HEADINGS: &'static [&'static str] = &["policy", "closure", "95 % episodes"];

    fn cells(&self) -> Vec<String> {
        let range = range(self.closure_ci_episodes_low, self.closure_ci_episodes_high, 2);
        vec![self.policy.clone(), number(self.closure, 2), range]
    }
}
