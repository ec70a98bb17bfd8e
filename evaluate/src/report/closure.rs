//! How much of what the search leads the simple rules by a policy closes.

use super::rows::ClosureRow;
use super::table::Table;
use crate::bootstrap::{efficiency_lead, gap_closure};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, efficiency};

/// The rules without a model that a planner must beat, at the working distance.
const SIMPLE: [&str; 4] = ["random-boundary", "random-u-sphere", "see", "farthest"];
/// Standard errors that the search must lead by for its lead to be a measure.
const CLEAR: f64 = 3.0;

/// Gap closure (E - E_best) / (E_baseline - E_best), E the efficiency and E_best that of the best simple rule at hand.
/// Absent where there is none, or where the baseline's lead is not clear.
pub fn gap_closures(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Option<Table> {
    let (views_if_unreached, n, seed) = (config.views_if_unreached(), config.resamples, config.seed);
    let runs = |policy: &str| Runs::of(contents.episodes.iter().map(|(r, _)| r), policy);
    let baseline = runs(&config.baseline);
    let simple = SIMPLE.iter().filter(|p| policies.iter().any(|q| q == *p));
    let mean = |r: &Runs, figure| r.column(figure, views_if_unreached).mean();
    let value = |r: &Runs| efficiency(mean(r, Figure::FinalCoverage), mean(r, Figure::ViewsTo(90)));
    let (name, best, _) =
        simple.filter_map(|p| Some((*p, runs(p), value(&runs(p))?))).max_by(|a, b| a.2.total_cmp(&b.2))?;
    let lead = efficiency_lead(&baseline, &best, views_if_unreached, n, seed)?;
    // Without an interval there is no standard error to lead by.
    let (low, high) = lead.low.zip(lead.high)?;
    // A 95 % interval is 3.92 standard errors wide.
    if lead.value <= CLEAR * (high - low) / 3.92 {
        return None;
    }
    let title = format!("Gap closure from {name}");
    let note = format!(
        "(E - E_best) / (E_{0} - E_best), E the efficiency, E_best that of {name}, the best simple rule of this run; {0} \
         leads it by {1:.2} [{low:.2}, {high:.2}]. Intervals over episodes.",
        config.baseline, lead.value
    );
    let of = |policy: &String| {
        let closure = gap_closure(&runs(policy), &best, &baseline, views_if_unreached, n, seed);
        ClosureRow {
            policy: policy.clone(),
            closure: closure.map(|i| i.value),
            closure_ci_episodes_low: closure.and_then(|i| i.low),
            closure_ci_episodes_high: closure.and_then(|i| i.high),
        }
    };
    let rows: Vec<_> = policies.iter().filter(|p| **p != config.baseline && *p != name).map(of).collect();
    Some(Table::of(&title, &note, &rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::tests::record;
    use crate::record::Timing;

    /// Episodes of Farthest View that reach 90 % at view 6, of BENBV at 6 - `lead`, or at 6 + `lead` in every `worse`-th,
    /// and of a policy halfway.
    fn closures(episodes: usize, lead: usize, worse: usize) -> Option<Table> {
        let reach = |name: &str, e: usize, view: usize| {
            let coverages: Vec<f64> = (1..=12).map(|v| if v >= view { 0.95 } else { 0.5 }).collect();
            (record("a", name, e, &coverages, &[]), Timing { episode_s: 0.0, decisions_s: Vec::new() })
        };
        let of = |e: usize| {
            let benbv = if (e + 1).is_multiple_of(worse) { 6 + lead } else { 6 - lead };
            [reach("farthest", e, 6), reach("benbv", e, benbv), reach("mine", e, 6 - lead / 2)]
        };
        let contents = Contents { episodes: (0..episodes).flat_map(of).collect(), skipped: Vec::new() };
        let policies = ["benbv", "farthest", "mine"].map(str::to_owned);
        gap_closures(&contents, &EvaluateConfig::default(), &policies)
    }

    #[test]
    fn a_lead_under_three_standard_errors_is_no_measure() {
        // Eight of 24 a view pair worse: views differ by 0.67 on the mean, with a standard error of 0.39.
        assert_eq!(closures(24, 2, 3).map(|t| t.title), None);
        // One of 24: 1.83 and 0.16.
        let table = closures(24, 2, 24).expect("a clear lead");
        assert_eq!((table.title.as_str(), table.rows.len()), ("Gap closure from farthest", 1));
        let closure: f64 = table.rows[0][1].parse().expect("a number");
        assert!((0.4..0.7).contains(&closure), "{:?}", table.rows);
        // A single episode, in which BENBV leads by far.
        assert_eq!(closures(1, 2, usize::MAX).map(|t| t.title), None, "it has no standard error");
    }
}
