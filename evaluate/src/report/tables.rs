//! The tables of a run.

use super::table::{Table, number};
use crate::bootstrap::{Interval, Over, difference, draws, efficiency_interval, efficiency_ratio, mean_interval};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, efficiency, mean};
use datagen::End;

/// The overall table, differences from the baseline, the paper's rows beside them, objects, and what was skipped.
pub fn results(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<Table> {
    let mut list = vec![overall(contents, config, policies)];
    list.extend(against_baseline(contents, config, policies));
    list.extend(super::closure::gap_closures(contents, config, policies));
    if config.episode.render.pixel_shift {
        list.push(super::paper::beside_the_paper(contents, config, policies));
        list.push(super::paper::beside_the_published_code(contents, config, policies));
    }
    list.push(per_object(contents, config, policies));
    list.extend(skipped(contents));
    list
}

fn runs<'a>(contents: &'a Contents, policy: &str) -> Runs<'a> {
    Runs::of(contents.episodes.iter().map(|(r, _)| r), policy)
}

fn range(interval: Option<Interval>, decimals: usize) -> String {
    interval.map_or_else(|| "-".to_owned(), |i| format!("[{:.decimals$}, {:.decimals$}]", i.low, i.high))
}

fn overall(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Table {
    let mut table = Table::new(
        "All objects",
        "Means over objects of means over episodes. Efficiency = mean final coverage / mean views to 90 %; its intervals are \
         over episodes (objects fixed) and over objects. cv3: coefficient of variation of overlaps 1 to 3 per episode; \
         cv all: of all overlaps; cv list: of the list averaged over episodes. never: episodes that do not reach 90 %.",
        &[
            "policy",
            "episodes",
            "coverage %",
            "95 % episodes",
            "efficiency",
            "95 % episodes",
            "95 % objects",
            "v50",
            "v80",
            "v90",
            "overlap 1",
            "2",
            "3",
            "cv3",
            "cv all",
            "cv list",
            "CD mm",
            "HD mm",
            "never",
            "empty scans",
            "ended early",
        ],
    );
    for policy in policies {
        let runs = runs(contents, policy);
        let never = config.never;
        let column = |f| runs.column(f, never);
        let m = |f| column(f).mean();
        let final_coverage = column(Figure::FinalCoverage);
        let drawn = |over| draws(&final_coverage.sizes(), over, config.resamples, config.seed);
        let (episodes, objects) = (drawn(Over::Episodes), drawn(Over::Objects));
        let count =
            |f: &dyn Fn(&crate::record::EpisodeRecord) -> usize| runs.records().map(f).sum::<usize>().to_string();
        table.rows.push(vec![
            policy.clone(),
            runs.len().to_string(),
            number(final_coverage.mean(), 2),
            range(mean_interval(&final_coverage, &episodes), 2),
            number(efficiency(final_coverage.mean(), m(Figure::ViewsTo(90))), 2),
            range(efficiency_interval(&runs, never, &episodes), 2),
            range(efficiency_interval(&runs, never, &objects), 2),
            number(m(Figure::ViewsTo(50)), 2),
            number(m(Figure::ViewsTo(80)), 2),
            number(m(Figure::ViewsTo(90)), 2),
            number(m(Figure::Overlap(1)), 1),
            number(m(Figure::Overlap(2)), 1),
            number(m(Figure::Overlap(3)), 1),
            number(m(Figure::Cv3), 1),
            number(m(Figure::CvAll), 1),
            number(runs.cv_of_mean_list(), 1),
            number(m(Figure::Chamfer), 3),
            number(m(Figure::Hausdorff), 2),
            count(&|r| usize::from(geometry::metrics::views_to(&r.coverages, 0.9).is_none())),
            count(&|r| r.overlaps.iter().filter(|o| o.is_none()).count()),
            count(&|r| usize::from(r.end == End::NoView)),
        ]);
    }
    table
}

fn against_baseline(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Option<Table> {
    let baseline = runs(contents, &config.baseline);
    if baseline.is_empty() {
        return None;
    }
    let title = format!("Paired with {}", config.baseline);
    let mut table = Table::new(
        &title,
        "Episodes of one object and number start from the same view. Ratio of efficiencies with intervals over episodes and \
         over objects; differences with intervals over episodes.",
        &[
            "policy",
            "pairs",
            "efficiency ratio",
            "95 % episodes",
            "95 % objects",
            "coverage, points",
            "95 %",
            "v90, views",
            "95 %",
            "cv3, points",
            "95 %",
        ],
    );
    for policy in policies.iter().filter(|p| **p != config.baseline) {
        let runs = runs(contents, policy);
        let (never, n, seed) = (config.never, config.resamples, config.seed);
        let pairs = runs.paired(&baseline).0.len();
        let ratio = |over| efficiency_ratio(&runs, &baseline, never, over, n, seed);
        let differ = |figure| difference(&runs, &baseline, figure, never, Over::Episodes, n, seed);
        let value = |i: Option<Interval>, decimals| number(i.map(|i| i.value), decimals);
        let (episodes, objects) = (ratio(Over::Episodes), ratio(Over::Objects));
        let [c, v, cv] = [Figure::FinalCoverage, Figure::ViewsTo(90), Figure::Cv3].map(differ);
        table.rows.push(vec![
            policy.clone(),
            pairs.to_string(),
            value(episodes, 3),
            range(episodes, 3),
            range(objects, 3),
            value(c, 2),
            range(c, 2),
            value(v, 2),
            range(v, 2),
            value(cv, 1),
            range(cv, 1),
        ]);
    }
    Some(table)
}

/// One row per object and policy, with standard errors.
pub fn per_object(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Table {
    let mut table = Table::new(
        "Object by object",
        "se: standard error over episodes.",
        &[
            "object",
            "policy",
            "episodes",
            "coverage %",
            "se",
            "efficiency",
            "v50",
            "v80",
            "v90",
            "se",
            "overlap 1",
            "se",
            "2",
            "se",
            "3",
            "se",
            "cv3",
            "cv all",
            "CD mm",
            "HD mm",
            "first scan %",
            "void draws",
        ],
    );
    let mut objects: Vec<&str> = contents.episodes.iter().map(|(r, _)| r.key.object.as_str()).collect();
    objects.dedup();
    for object in objects {
        for policy in policies {
            let runs = runs(contents, policy).object(object);
            if runs.is_empty() {
                continue;
            }
            let column = |f| runs.column(f, config.never);
            let m = |f| column(f).mean();
            let se = |f, d| number(column(f).standard_error(), d);
            let mut row = vec![object.to_owned(), policy.clone(), runs.len().to_string()];
            row.extend([number(m(Figure::FinalCoverage), 2), se(Figure::FinalCoverage, 2)]);
            row.push(number(efficiency(m(Figure::FinalCoverage), m(Figure::ViewsTo(90))), 2));
            row.extend([50, 80, 90].map(|level| number(m(Figure::ViewsTo(level)), 2)));
            row.push(se(Figure::ViewsTo(90), 2));
            for n in 1..=3 {
                row.extend([number(m(Figure::Overlap(n)), 1), se(Figure::Overlap(n), 1)]);
            }
            row.extend([Figure::Cv3, Figure::CvAll].map(|f| number(m(f), 1)));
            row.extend([number(m(Figure::Chamfer), 3), number(m(Figure::Hausdorff), 2)]);
            row.push(number(m(Figure::FirstCoverage), 2));
            row.push(runs.records().map(|r| r.void_draws).sum::<usize>().to_string());
            table.rows.push(row);
        }
    }
    table
}

/// Times: differ from run to run.
pub fn timing(contents: &Contents, policies: &[String]) -> Table {
    let mut table = Table::new(
        "Time",
        "Processor seconds of an episode on one thread, the simulated scans included; decisions in wall time on the machine of \
         the run, other threads busy. Unlike all else here these differ from run to run.",
        &["policy", "s per episode", "objects per core second", "ms per decision, mean", "median"],
    );
    for policy in policies {
        let times = || contents.episodes.iter().filter(|(r, _)| r.key.policy == *policy).map(|(_, t)| t);
        let seconds = mean(times().map(|t| t.episode_s));
        let mut decisions: Vec<f64> = times().flat_map(|t| t.decisions_s.iter().copied()).collect();
        decisions.sort_by(f64::total_cmp);
        table.rows.push(vec![
            policy.clone(),
            number(seconds, 3),
            number(seconds.map(|s| 1.0 / s), 1),
            number(mean(decisions.iter().map(|d| 1e3 * d)), 2),
            number(decisions.get(decisions.len() / 2).map(|d| 1e3 * d), 2),
        ]);
    }
    table
}

fn skipped(contents: &Contents) -> Option<Table> {
    let mut table = Table::new("Not run", "", &["object", "policy", "episode", "why"]);
    for s in &contents.skipped {
        table.rows.push(vec![s.key.object.clone(), s.key.policy.clone(), s.key.episode.to_string(), s.reason.clone()]);
    }
    (!table.rows.is_empty()).then_some(table)
}
