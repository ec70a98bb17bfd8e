//! Result folders side by side: how each policy changes from one setting to another.

use super::folder::{Folder, Settings};
use super::policy_order;
use super::table::{Table, number, range};
use crate::bootstrap::{ResampleUnit, efficiency_ratio};
use crate::config::EvaluateConfig;
use crate::metrics::{Figure, Runs, efficiency};
use std::collections::{BTreeMap, BTreeSet};

/// Runs that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unlike {
    /// They have no episodes in common.
    #[error(
        "--compare: {simulated} was run in the simulator and {recorded} on recorded sequences: their episodes have nothing \
         in common; compare directories of one kind"
    )]
    Kinds {
        /// A folder.
        simulated: String,
        /// Another one.
        recorded: String,
    },
    /// An object is another one.
    #[error(
        "--compare: {object} of {first} and {object} of {other} are other meshes or scans of one name: their episodes are no \
         pairs; compare runs on the same files"
    )]
    Objects {
        /// The object.
        object: String,
        /// A folder.
        first: String,
        /// Another one.
        other: String,
    },
}

/// Refuses a run in the simulator beside one on recordings, and runs on other objects of the same names. Older programs did not
/// note which these were.
///
/// # Errors
/// The first of each kind, the first object.
pub fn check(folders: &[Folder]) -> Result<(), Unlike> {
    let first = |recorded: bool| {
        let of_kind = |folder: &&Folder| folder.settings.as_ref().is_some_and(|s| s.recorded() == recorded);
        folders.iter().find(of_kind).map(|folder| folder.name.clone())
    };
    if let (Some(simulated), Some(recorded)) = (first(false), first(true)) {
        return Err(Unlike::Kinds { simulated, recorded });
    }
    let mut known: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for folder in folders {
        for (record, _) in &folder.contents.episodes {
            let Some(files) = &record.files else { continue };
            let (first, of_first) =
                *known.entry(record.key.object.as_str()).or_insert((folder.name.as_str(), files.as_str()));
            if of_first != files {
                let (object, first, other) = (record.key.object.clone(), first.to_owned(), folder.name.clone());
                return Err(Unlike::Objects { object, first, other });
            }
        }
    }
    Ok(())
}

/// Seeds of runs whose episodes are no pairs, one per folder: in the simulator the first views depend on the seed, while
/// recordings start with the same scan whatever it is.
fn unpaired_seeds(folders: &[Folder]) -> Option<Vec<u64>> {
    let seeds: Option<Vec<u64>> = folders.iter().map(|f| f.settings.as_ref().map(|s| s.seed)).collect();
    let recorded = folders.iter().all(|f| f.settings.as_ref().is_some_and(Settings::recorded));
    seeds.filter(|seeds| !recorded && seeds.iter().any(|seed| *seed != seeds[0]))
}

/// That a policy's means in these folders are over other objects or episodes; of the first such policy.
fn unlike_means(folders: &[Folder]) -> Option<String> {
    policies(folders).iter().find_map(|policy| {
        let episodes_of = |folder: &Folder| -> BTreeSet<(String, usize)> {
            runs(folder, policy).records().map(|r| (r.key.object.clone(), r.key.episode)).collect()
        };
        let each: Vec<_> = folders.iter().map(|f| (f, episodes_of(f))).filter(|(_, e)| !e.is_empty()).collect();
        if each.iter().all(|(_, episodes)| *episodes == each[0].1) {
            return None;
        }
        let count = |(folder, episodes): &(&Folder, BTreeSet<(String, usize)>)| {
            let objects: BTreeSet<&str> = episodes.iter().map(|(object, _)| object.as_str()).collect();
            format!("{}: episodes {}, objects {}", folder.name, episodes.len(), objects.len())
        };
        let counts: Vec<String> = each.iter().map(count).collect();
        Some(format!(
            "The objects or episodes differ ({policy} in {}): means are over those of each directory, and only ratios are over \
             those that both have.",
            counts.join("; ")
        ))
    })
}

/// What a reader must know before the tables, a sentence each: runs that are unfinished, episodes and seeds that differ.
pub fn notes(folders: &[Folder]) -> Vec<String> {
    let unfinished = |f: &Folder| f.unfinished.as_ref().map(|text| format!("{}: {text}.", f.name));
    let mut notes: Vec<String> = folders.iter().filter_map(unfinished).collect();
    notes.extend(unlike_means(folders));
    notes.extend(unpaired_seeds(folders).map(|seeds| {
        let each: Vec<String> = folders.iter().zip(seeds).map(|(f, seed)| format!("{}: {seed}", f.name)).collect();
        format!(
            "The seeds differ ({}): episodes of the same number start from different views and are not pairs, so there is no \
             table relative to {}.",
            each.join(", "),
            folders[0].name
        )
    }));
    notes
}

/// What a level that was never reached counts as, in views: the default for the most views of these runs, so that all count
/// alike.
fn views_if_unreached(folders: &[Folder]) -> usize {
    let most = folders.iter().filter_map(|f| f.settings.as_ref()).map(|s| s.episode.num_views).max().filter(|n| *n > 0);
    let mut config = EvaluateConfig::default();
    config.episode.num_views = most.unwrap_or(config.episode.num_views);
    config.views_if_unreached()
}

/// Under the tables of ratios.
const PAIRED: &str = "Paired, on the episodes that both have; 95 % intervals over episodes, then over objects.";

/// Tables with one column per folder: each figure by policy, and the efficiency relative to the same policy in the first folder, to
/// the baseline there, and to the baseline within each folder, on the episodes that both have. Between folders whose seeds differ
/// there are no such episodes.
pub fn tables(folders: &[Folder], baseline: &str) -> Vec<Table> {
    let (policies, views_if_unreached) = (policies(folders), views_if_unreached(folders));
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
            |(e, o)| format!("{:.3} {}, {}", e.value, range(e.low, e.high, 3), range(o.low, o.high, 3)),
        )
    };
    let mut tables = vec![build("Efficiency", "", &|f, p| number(eff(f, p), 2))];
    if unpaired_seeds(folders).is_none() {
        let title = format!("Efficiency relative to {}", first.name);
        tables.push(build(&title, PAIRED, &|f, p| ratio(&runs(f, p), &runs(first, p))));
        let title = format!("Efficiency relative to {baseline} of {}", first.name);
        tables.push(build(&title, PAIRED, &|f, p| ratio(&runs(f, p), &runs(first, baseline))));
    }
    tables.extend([
        build(&format!("Efficiency relative to {baseline} of the same folder"), PAIRED, &|f, p| {
            ratio(&runs(f, p), &runs(f, baseline))
        }),
        build("Final coverage, %", "", &figure(Figure::FinalCoverage, 2)),
        build("Views to 90 %", "", &figure(Figure::ViewsTo(90), 2)),
        build("cv3, %", "", &figure(Figure::Cv3, 1)),
        build("Overlap of next view 1, %", "", &figure(Figure::Overlap(1), 1)),
        build("Chamfer distance, mm", "", &figure(Figure::Chamfer, 3)),
    ]);
    tables
}

/// Policies of any folder, each once.
pub fn policies(folders: &[Folder]) -> Vec<String> {
    let mut policies: Vec<String> = Vec::new();
    for folder in folders {
        for policy in policy_order(&folder.contents, &policies) {
            if !policies.contains(&policy) {
                policies.push(policy);
            }
        }
    }
    policies
}

fn runs<'a>(folder: &'a Folder, policy: &str) -> Runs<'a> {
    Runs::of(folder.contents.episodes.iter().map(|(r, _)| r), policy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::Contents;
    use crate::metrics::tests::record;
    use crate::record::Timing;
    use crate::report::folder::{Dataset, Episode};

    fn folder(name: &str, c: f64, seed: u64, dataset: &str) -> Folder {
        let of = |(policy, episode): (&str, usize)| {
            let timing = Timing { episode_s: 0.0, decisions_s: vec![] };
            (record("a", policy, episode, &[0.5, c], &[Some(0.4)]), timing)
        };
        let episodes = [("benbv", 0), ("benbv", 1), ("see", 0), ("see", 1)].map(of).to_vec();
        let (dataset, episode) = (Dataset { name: dataset.to_owned() }, Episode { num_views: 15 });
        Folder {
            name: name.to_owned(),
            contents: Contents { episodes, skipped: Vec::new() },
            settings: Some(Settings { seed, dataset, episode }),
            unfinished: None,
        }
    }

    #[test]
    fn folders_stand_side_by_side() {
        let mut folders = [folder("plain", 0.95, 0, "folder"), folder("noise", 0.91, 0, "folder")];
        let of_both = tables(&folders, "benbv");
        assert_eq!(of_both[0].header, ["policy", "plain", "noise"]);
        assert_eq!(of_both[0].rows[0], ["benbv", "47.50", "45.50"]);
        assert_eq!(of_both[1].rows[1][2], "0.958 [0.958, 0.958], -", "one object");
        assert!(of_both[2].rows[1][1].starts_with("1.000 ["), "see beside benbv of plain: {:?}", of_both[2].rows[1]);
        assert_eq!((check(&folders), notes(&folders).len()), (Ok(()), 0));
        folders.iter_mut().for_each(|f| f.settings = None);
        assert_eq!((tables(&folders, "benbv"), check(&folders)), (of_both, Ok(())), "older folders");
        folders[1].unfinished = Some("unfinished: 3 of 4 episodes left".to_owned());
        assert_eq!(notes(&folders), ["noise: unfinished: 3 of 4 episodes left."]);
    }

    #[test]
    fn episodes_of_other_seeds_are_no_pairs() {
        let folders = [folder("plain", 0.95, 0, "folder"), folder("again", 0.95, 1, "folder")];
        let titles: Vec<String> = tables(&folders, "benbv").into_iter().map(|t| t.title).collect();
        assert!(!titles.iter().any(|t| t.ends_with(" plain")), "{titles:?}");
        assert!(titles.contains(&"Efficiency relative to benbv of the same folder".to_owned()), "{titles:?}");
        let notes = notes(&folders);
        assert!(notes[0].contains("plain: 0, again: 1") && notes[0].contains("not pairs"), "{notes:?}");
        let recorded = [folder("a", 0.95, 0, "sequences"), folder("b", 0.95, 1, "sequences")];
        assert_eq!(unpaired_seeds(&recorded), None, "they start with the same scans");
        let error = check(&[folder("s", 0.9, 0, "folder"), folder("r", 0.9, 0, "sequences")]).expect_err("unlike");
        assert_eq!(error, Unlike::Kinds { simulated: "s".to_owned(), recorded: "r".to_owned() });
    }

    #[test]
    fn means_over_other_episodes_are_noted() {
        let mut folders = [folder("plain", 0.95, 0, "folder"), folder("short", 0.95, 0, "folder")];
        folders[1].contents.episodes.retain(|(r, _)| r.key.policy != "see");
        assert_eq!(notes(&folders), [""; 0], "a policy that only one has");
        folders[1].contents.episodes.retain(|(r, _)| r.key.episode == 0);
        let found = notes(&folders);
        assert!(
            found[0].contains("(benbv in plain: episodes 2, objects 1; short: episodes 1, objects 1)"),
            "{found:?}"
        );
        let mut folders = [folder("plain", 0.95, 0, "folder"), folder("other", 0.95, 0, "folder")];
        folders[1].contents.episodes.iter_mut().for_each(|(r, _)| "b".clone_into(&mut r.key.object));
        assert_eq!(notes(&folders).len(), 1, "as many episodes of another object");
    }

    #[test]
    fn other_objects_of_the_same_name_are_no_pairs() {
        let of = |name: &str, files: Option<&str>| {
            let mut folder = folder(name, 0.95, 0, "folder");
            folder.contents.episodes.iter_mut().for_each(|(record, _)| record.files = files.map(str::to_owned));
            folder
        };
        assert_eq!(check(&[of("x", Some("m1")), of("older", None), of("y", Some("m1"))]), Ok(()));
        let error = check(&[of("x", Some("m1")), of("older", None), of("y", Some("m2"))]).expect_err("other meshes");
        let text = error.to_string();
        assert!(text.contains("a of x and a of y are other meshes or scans of one name"), "{text}");
    }

    #[test]
    fn never_counts_alike_in_all_folders() {
        let mut folders = [folder("plain", 0.8, 0, "folder"), folder("long", 0.8, 0, "folder")];
        assert_eq!(views_if_unreached(&folders), 17);
        folders[1].settings.as_mut().expect("settings").episode.num_views = 40;
        assert_eq!(views_if_unreached(&folders), 42);
    }
}
