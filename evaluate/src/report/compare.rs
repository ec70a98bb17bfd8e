//! Result folders side by side: how each policy changes from one setting to another.

use super::policy_order;
use super::table::{Table, number};
use crate::bootstrap::{ResampleUnit, efficiency_ratio};
use crate::journal::Contents;
use crate::metrics::{Figure, Runs, efficiency};

/// A folder's name and what it holds.
pub struct Folder {
    /// Name in the header.
    pub name: String,
    /// Its journal.
    pub contents: Contents,
}

/// Under the tables of ratios.
const PAIRED: &str = "Paired, on the episodes that both have; 95 % intervals over episodes, then over objects.";

/// Tables with one column per folder: each figure by policy, and the efficiency relative to the same policy in the first folder, to
/// the baseline there, and to the baseline within each folder, on the episodes that both have.
pub fn tables(folders: &[Folder], baseline: &str, views_if_unreached: usize) -> Vec<Table> {
    let mut policies: Vec<String> = Vec::new();
    for folder in folders {
        for policy in policy_order(&folder.contents, &policies) {
            if !policies.contains(&policy) {
                policies.push(policy);
            }
        }
    }
    let header: Vec<&str> = std::iter::once("policy").chain(folders.iter().map(|f| f.name.as_str())).collect();
    let build = |title: &str, note: &str, cell: &dyn Fn(&Folder, &str) -> String| {
        let mut table = Table::new(title, note, &header);
        for policy in &policies {
            let cells = folders.iter().map(|f| cell(f, policy));
            table.rows.push(std::iter::once(policy.clone()).chain(cells).collect());
        }
        table
    };
    let figure = |figure: Figure, decimals: usize| {
        move |f: &Folder, policy: &str| number(runs(f, policy).column(figure, views_if_unreached).mean(), decimals)
    };
    let eff = |f: &Folder, policy: &str| {
        let runs = runs(f, policy);
        let m = |figure| runs.column(figure, views_if_unreached).mean();
        efficiency(m(Figure::FinalCoverage), m(Figure::ViewsTo(90)))
    };
    let first = &folders[0];
    let ratio = |a: &Runs, b: &Runs| {
        let ratio = |over| efficiency_ratio(a, b, views_if_unreached, over, 1000, 0);
        let (episodes, objects) = (ratio(ResampleUnit::Episodes), ratio(ResampleUnit::Objects));
        episodes.zip(objects).map_or_else(
            || "-".to_owned(),
            |(e, o)| format!("{:.3} [{:.3}, {:.3}], [{:.3}, {:.3}]", e.value, e.low, e.high, o.low, o.high),
        )
    };
    vec![
        build("Efficiency", "", &|f, p| number(eff(f, p), 2)),
        build(&format!("Efficiency relative to {}", first.name), PAIRED, &|f, p| ratio(&runs(f, p), &runs(first, p))),
        build(&format!("Efficiency relative to {baseline} of {}", first.name), PAIRED, &|f, p| {
            ratio(&runs(f, p), &runs(first, baseline))
        }),
        build(&format!("Efficiency relative to {baseline} of the same folder"), PAIRED, &|f, p| {
            ratio(&runs(f, p), &runs(f, baseline))
        }),
        build("Final coverage, %", "", &figure(Figure::FinalCoverage, 2)),
        build("Views to 90 %", "", &figure(Figure::ViewsTo(90), 2)),
        build("cv3, %", "", &figure(Figure::Cv3, 1)),
        build("Overlap of next view 1, %", "", &figure(Figure::Overlap(1), 1)),
        build("Chamfer distance, mm", "", &figure(Figure::Chamfer, 3)),
    ]
}

fn runs<'a>(folder: &'a Folder, policy: &str) -> Runs<'a> {
    Runs::of(folder.contents.episodes.iter().map(|(r, _)| r), policy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::tests::record;
    use crate::record::Timing;

    #[test]
    fn folders_stand_side_by_side() {
        let folder = |name: &str, c: f64| Folder {
            name: name.to_owned(),
            contents: Contents {
                episodes: ["benbv", "see"]
                    .map(|p| {
                        (record("a", p, 0, &[0.5, c], &[Some(0.4)]), Timing { episode_s: 0.0, decisions_s: vec![] })
                    })
                    .to_vec(),
                skipped: Vec::new(),
            },
        };
        let tables = tables(&[folder("plain", 0.95), folder("noise", 0.91)], "benbv", 17);
        assert_eq!(tables[0].header, ["policy", "plain", "noise"]);
        assert_eq!(tables[0].rows[0], ["benbv", "47.50", "45.50"]);
        assert!(tables[1].rows[1][2].starts_with("0.958 ["), "{:?}", tables[1].rows[1]);
        assert!(tables[2].rows[1][1].starts_with("1.000 ["), "see beside benbv of plain: {:?}", tables[2].rows[1]);
    }
}
