//! The tables of a run.

use super::arm::{self, ArmRow};
use super::missing::Missing;
use super::recorded::{self, ForecastRow, RecordedRow, StopRow};
use super::registration::{self, FailureRow, RegistrationRow};
use super::rows::{ObjectRow, PairedRow, PolicyRow, SkippedRow, TimeRow};
use super::table::Table;
use crate::bootstrap::{
    Interval, ResampleUnit, difference, draws, efficiency_interval, efficiency_ratio, mean_interval,
};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, efficiency, mean, quantile};
use crate::record::{EpisodeRecord, Skipped};
use datagen::End;
use serde::Serialize;

/// The rows of a run: what `--json` prints and the CSV files hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rows {
    /// Policies over all objects.
    pub policies: Vec<PolicyRow>,
    /// Policies paired with the baseline; empty without episodes of the baseline.
    pub paired: Vec<PairedRow>,
    /// Policies object by object.
    pub objects: Vec<ObjectRow>,
    /// What was not run: objects that cannot be used, then episodes.
    pub skipped: Vec<SkippedRow>,
    /// Policies on recorded sequences.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub recorded: Vec<RecordedRow>,
    /// What was expected of views of recorded sequences, and what they brought.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub forecasts: Vec<ForecastRow>,
    /// Where `stop` would have ended.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stops: Vec<StopRow>,
    /// How scans were registered.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub registration: Vec<RegistrationRow>,
    /// What views ask of an arm.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub arm: Vec<ArmRow>,
    /// How often that failed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<FailureRow>,
}

impl Rows {
    /// Of a run.
    pub fn of(contents: &Contents, config: &EvaluateConfig, policies: &[String], missing: &Missing) -> Self {
        let unusable = |(object, reason): &(String, String)| SkippedRow {
            object: object.clone(),
            policy: None,
            episode: None,
            reason: reason.clone(),
        };
        let skipped = |s: &Skipped| SkippedRow {
            object: s.key.object.clone(),
            policy: Some(s.key.policy.clone()),
            episode: Some(s.key.episode),
            reason: s.reason.clone(),
        };
        Self {
            policies: policies.iter().map(|policy| overall(&runs(contents, policy), config, policy)).collect(),
            paired: against_baseline(contents, config, policies),
            objects: per_object(contents, config, policies),
            skipped: missing.unusable.iter().map(unusable).chain(contents.skipped.iter().map(skipped)).collect(),
            recorded: recorded::rows(contents, config, policies),
            forecasts: recorded::forecasts(contents, config, policies),
            stops: recorded::stops(contents, config, policies),
            registration: registration::rows(contents, config, policies),
            arm: arm::rows(contents, config, policies),
            failures: registration::failures(contents),
        }
    }

    /// How many objects cannot be used.
    pub fn unusable(&self) -> usize {
        self.skipped.iter().filter(|row| row.policy.is_none()).count()
    }

    /// The first table of recorded sequences, if they were run.
    pub fn recorded_table(&self) -> Option<Table> {
        (!self.recorded.is_empty()).then(|| recorded::table(&self.recorded))
    }

    /// The overall table.
    pub fn overall(&self) -> Table {
        Table::of(
            "All objects",
            "Means over objects of means over episodes. Efficiency = mean final coverage / mean views to 90 %; its intervals are \
             over episodes (objects fixed) and over objects. cv3: coefficient of variation of overlaps 1 to 3 per episode; \
             area: under the curve of coverage over all views, of the whole; path: straight from camera position to camera position. \
             cv all: of all overlaps; cv list: of the list averaged over episodes. never: episodes that do not reach 90 %.",
            &self.policies,
        )
    }

    /// Every table of a run: the overall one, differences from the baseline, the paper's rows beside ours, objects, and
    /// what was skipped.
    pub fn tables(&self, contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<Table> {
        let mut list: Vec<Table> = self.recorded_table().into_iter().collect();
        list.extend((!self.forecasts.is_empty()).then(|| recorded::forecast_table(&self.forecasts)));
        list.extend((!self.stops.is_empty()).then(|| recorded::stop_table(&self.stops)));
        list.push(self.overall());
        list.extend(registration::tables(&self.registration, &self.failures));
        list.extend((!self.arm.is_empty()).then(|| arm::table(&self.arm)));
        if !runs(contents, &config.baseline).is_empty() {
            list.push(Table::of(
                &format!("Paired with {}", config.baseline),
                "Episodes of one object and number start from the same view. Ratio of efficiencies with intervals over episodes and \
                 over objects; differences with intervals over episodes.",
                &self.paired,
            ));
        }
        list.extend(super::closure::gap_closures(contents, config, policies));
        if config.episode.render.pixel_shift {
            list.push(super::paper::beside_the_paper(contents, config, policies));
            list.push(super::paper::beside_the_published_code(contents, config, policies));
        }
        list.push(Table::of("Object by object", "se: standard error over episodes.", &self.objects));
        if !self.skipped.is_empty() {
            list.push(Table::of("Not run", "", &self.skipped));
        }
        list
    }
}

fn runs<'a>(contents: &'a Contents, policy: &str) -> Runs<'a> {
    Runs::of(contents.episodes.iter().map(|(r, _)| r), policy)
}

fn low(interval: Option<Interval>) -> Option<f64> {
    interval?.low
}

fn high(interval: Option<Interval>) -> Option<f64> {
    interval?.high
}

fn value(interval: Option<Interval>) -> Option<f64> {
    interval.map(|i| i.value)
}

fn overall(runs: &Runs, config: &EvaluateConfig, policy: &str) -> PolicyRow {
    let views_if_unreached = config.views_if_unreached();
    let column = |f| runs.column(f, views_if_unreached);
    let m = |f| column(f).mean();
    let final_coverage = column(Figure::FinalCoverage);
    let drawn = |over| draws(&final_coverage.sizes(), over, config.resamples, config.seed);
    let (episodes, objects) = (drawn(ResampleUnit::Episodes), drawn(ResampleUnit::Objects));
    let count = |f: &dyn Fn(&EpisodeRecord) -> usize| runs.records().map(f).sum::<usize>();
    let coverage = mean_interval(&final_coverage, &episodes);
    let over_episodes = efficiency_interval(runs, views_if_unreached, &episodes);
    let over_objects = efficiency_interval(runs, views_if_unreached, &objects);
    PolicyRow {
        policy: policy.to_owned(),
        episodes: runs.len(),
        coverage_percent: final_coverage.mean(),
        coverage_percent_ci_episodes_low: low(coverage),
        coverage_percent_ci_episodes_high: high(coverage),
        efficiency: efficiency(final_coverage.mean(), m(Figure::ViewsTo(90))),
        efficiency_ci_episodes_low: low(over_episodes),
        efficiency_ci_episodes_high: high(over_episodes),
        efficiency_ci_objects_low: low(over_objects),
        efficiency_ci_objects_high: high(over_objects),
        views_to_50: m(Figure::ViewsTo(50)),
        views_to_80: m(Figure::ViewsTo(80)),
        views_to_90: m(Figure::ViewsTo(90)),
        coverage_area_percent: m(Figure::CoverageArea(config.episode.num_views + 1)),
        path_m: m(Figure::Path),
        overlap_1_percent: m(Figure::Overlap(1)),
        overlap_2_percent: m(Figure::Overlap(2)),
        overlap_3_percent: m(Figure::Overlap(3)),
        cv3_percent: m(Figure::Cv3),
        cv_all_percent: m(Figure::CvAll),
        cv_list_percent: runs.cv_of_mean_list(),
        chamfer_mm: m(Figure::Chamfer),
        hausdorff_mm: m(Figure::Hausdorff),
        episodes_below_90: count(&|r| usize::from(geometry::metrics::views_to(&r.coverages, 0.9).is_none())),
        empty_scans: count(&|r| r.overlaps.iter().filter(|o| o.is_none()).count()),
        episodes_ended_early: count(&|r| usize::from(r.end == End::NoView)),
    }
}

fn against_baseline(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<PairedRow> {
    let baseline = runs(contents, &config.baseline);
    if baseline.is_empty() {
        return Vec::new();
    }
    let (views_if_unreached, n, seed) = (config.views_if_unreached(), config.resamples, config.seed);
    let of = |policy: &String| {
        let runs = runs(contents, policy);
        let ratio = |over| efficiency_ratio(&runs, &baseline, views_if_unreached, over, n, seed);
        let differ = |figure| difference(&runs, &baseline, figure, views_if_unreached, ResampleUnit::Episodes, n, seed);
        let (episodes, objects) = (ratio(ResampleUnit::Episodes), ratio(ResampleUnit::Objects));
        let [c, v, cv] = [Figure::FinalCoverage, Figure::ViewsTo(90), Figure::Cv3].map(differ);
        PairedRow {
            policy: policy.clone(),
            baseline: config.baseline.clone(),
            pairs: runs.paired(&baseline).0.len(),
            ratio: value(episodes),
            ratio_ci_episodes_low: low(episodes),
            ratio_ci_episodes_high: high(episodes),
            ratio_ci_objects_low: low(objects),
            ratio_ci_objects_high: high(objects),
            coverage_difference_points: value(c),
            coverage_difference_points_ci_episodes_low: low(c),
            coverage_difference_points_ci_episodes_high: high(c),
            views_to_90_difference: value(v),
            views_to_90_difference_ci_episodes_low: low(v),
            views_to_90_difference_ci_episodes_high: high(v),
            cv3_difference_points: value(cv),
            cv3_difference_points_ci_episodes_low: low(cv),
            cv3_difference_points_ci_episodes_high: high(cv),
        }
    };
    policies.iter().filter(|p| **p != config.baseline).map(of).collect()
}

/// One row per object and policy, with standard errors.
fn per_object(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<ObjectRow> {
    let mut objects: Vec<&str> = contents.episodes.iter().map(|(r, _)| r.key.object.as_str()).collect();
    objects.dedup();
    let mut rows = Vec::new();
    for object in objects {
        for policy in policies {
            let runs = runs(contents, policy).object(object);
            if runs.is_empty() {
                continue;
            }
            let column = |f| runs.column(f, config.views_if_unreached());
            let m = |f| column(f).mean();
            let se = |f| column(f).standard_error();
            rows.push(ObjectRow {
                object: object.to_owned(),
                policy: policy.clone(),
                episodes: runs.len(),
                coverage_percent: m(Figure::FinalCoverage),
                coverage_percent_se: se(Figure::FinalCoverage),
                efficiency: efficiency(m(Figure::FinalCoverage), m(Figure::ViewsTo(90))),
                views_to_50: m(Figure::ViewsTo(50)),
                views_to_80: m(Figure::ViewsTo(80)),
                views_to_90: m(Figure::ViewsTo(90)),
                views_to_90_se: se(Figure::ViewsTo(90)),
                overlap_1_percent: m(Figure::Overlap(1)),
                overlap_1_percent_se: se(Figure::Overlap(1)),
                overlap_2_percent: m(Figure::Overlap(2)),
                overlap_2_percent_se: se(Figure::Overlap(2)),
                overlap_3_percent: m(Figure::Overlap(3)),
                overlap_3_percent_se: se(Figure::Overlap(3)),
                cv3_percent: m(Figure::Cv3),
                cv_all_percent: m(Figure::CvAll),
                chamfer_mm: m(Figure::Chamfer),
                hausdorff_mm: m(Figure::Hausdorff),
                first_coverage_percent: m(Figure::FirstCoverage),
                void_draws: runs.records().map(|r| r.void_draws).sum(),
            });
        }
    }
    rows
}

/// Times: differ from run to run.
pub fn timing(contents: &Contents, policies: &[String]) -> Table {
    let of = |policy: &String| {
        let times = || contents.episodes.iter().filter(|(r, _)| r.key.policy == *policy).map(|(_, t)| t);
        let seconds = mean(times().map(|t| t.episode_s));
        let decisions: Vec<f64> = times().flat_map(|t| t.decisions_s.iter().copied()).collect();
        TimeRow {
            policy: policy.clone(),
            episode_cpu_s: seconds,
            objects_per_cpu_s: seconds.map(|s| 1.0 / s),
            decision_mean_ms: mean(decisions.iter().map(|d| 1e3 * d)),
            decision_median_ms: quantile(decisions, 0.5).map(|d| 1e3 * d),
        }
    };
    Table::of(
        "Time",
        "Processor seconds of an episode on one thread, the simulated scans included; decisions in wall time on the machine of \
         the run, other threads busy. Unlike all else here these differ from run to run.",
        &policies.iter().map(of).collect::<Vec<_>>(),
    )
}

#[cfg(test)]
mod tests;
