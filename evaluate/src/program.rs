//! The program `evaluate`: policies against each other on simulated objects.

use crate::args::Args;
use crate::batches::Watch;
use crate::config::EvaluateConfig;
use crate::idle;
use crate::journal;
use crate::networks::Networks;
use crate::objects::ObjectError;
use crate::policies::{PAPER_POLICIES, POLICIES, Policy, RECORDED_POLICIES, check};
use crate::record::EpisodeKey;
use crate::report::folder;
use crate::report::{self, compare, tables::Rows};
use crate::run::{self, Ended};
use anyhow::{Context, bail};
use datagen::dataset::DatasetName;
use formats::program;
use formats::run::atomic_write;
use indicatif::{ProgressBar, ProgressStyle};
use std::ffi::OsString;
use std::io::IsTerminal;
use std::process::ExitCode;

/// The program with this command line, its own name first.
pub fn main(words: impl Iterator<Item = OsString>) -> ExitCode {
    let args: Args = program::parse_from(words).unwrap_or_else(|error| error.exit());
    args.common.start_messages(["warn", "info", "debug"]);
    program::finish(run(&args))
}

fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if args.list_policies {
        let lines = |policies: &[(&str, &str)], width: usize| -> String {
            policies.iter().map(|(name, what)| format!("{name:<width$} {what}\n")).collect()
        };
        let recorded = lines(RECORDED_POLICIES, 27);
        program::print(format!("{}\nOn recorded sequences (--dataset sequences):\n{recorded}", lines(POLICIES, 18)))?;
        return Ok(ExitCode::SUCCESS);
    }
    if !args.compare.is_empty() {
        return compare_folders(args);
    }
    let config = args.settings()?;
    if config.dataset.name == DatasetName::Sequences && args.distance.is_some() {
        program::misuse::<Args>("--distance has no effect on recorded sequences, which say their own in sequence.json");
    }
    if config.episodes == 0 {
        bail!("--episodes 0: found no episode to run, expected at least 1");
    }
    config.validate()?;
    let baseline: Policy = config.baseline.parse().context("baseline")?;
    args.common.start_threads()?;
    let networks = Networks::new(&config);
    networks.check_device()?;
    let policies = policies(&config, args.preset.is_some(), &networks)?;
    check_baseline(&baseline, &policies, args.baseline.is_some())?;
    if let Some(note) = idle::note(&config, &policies) {
        eprintln!("{note}");
    }
    let stop = program::stop_when_asked("stopping after the current episodes; press again to stop immediately")?;
    let bar = Bar(progress());
    let ended = run::run(args.results(), &policies, &config, &networks, stop, &bar)?;
    bar.0.finish_and_clear();
    match ended {
        Ended::Stopped { done, left } => {
            eprintln!("stopped after {done} episodes, {left} left; the same command resumes from here");
            if done > 0 {
                eprintln!("preliminary report: {:?}", args.results().join("report.html"));
            }
            Ok(ExitCode::from(program::STOPPED))
        }
        Ended::Finished { rows, contents } => summary(args, &config, &rows, &contents).map(|()| ExitCode::SUCCESS),
    }
}

/// The policies asked for, each checked before any long work. `all` leaves out networks without weights, saying so.
fn policies(config: &EvaluateConfig, paper: bool, networks: &Networks) -> anyhow::Result<Vec<Policy>> {
    let mut list: Vec<Policy> = Vec::new();
    for asked in &config.policies {
        let names: Vec<&str> = match (asked.as_str(), paper) {
            ("all", _) if config.dataset.name == DatasetName::Sequences => {
                RECORDED_POLICIES.iter().map(|(name, _)| *name).collect()
            }
            ("all", true) => PAPER_POLICIES.to_vec(),
            ("all", false) => POLICIES.iter().map(|(name, _)| *name).collect(),
            (name, _) => vec![name],
        };
        for name in names {
            let policy: Policy = name.parse()?;
            match check(&policy, config, networks) {
                Ok(()) if list.contains(&policy) => {}
                Ok(()) => list.push(policy),
                Err(e) if asked == "all" => eprintln!("left out of `all`: {e}"),
                Err(e) => return Err(e.into()),
            }
        }
    }
    if list.is_empty() {
        bail!("--policies: found none, expected names or `all`");
    }
    Ok(list)
}

/// Whether there is a policy to compare the others with. One that a flag names must be among those that run; a file of settings
/// may be used with other policies, and without any setting nothing was expected.
fn check_baseline(baseline: &Policy, policies: &[Policy], flag: bool) -> anyhow::Result<()> {
    let name = baseline.name();
    if policies.iter().any(|policy| policy.name() == name) {
        return Ok(());
    }
    let run: Vec<&str> = policies.iter().map(Policy::name).collect();
    let run = run.join(", ");
    if flag {
        bail!("--baseline {name}: not among the policies of this run; expected one of {run}, or add it to --policies");
    }
    if name != EvaluateConfig::default().baseline {
        eprintln!("baseline = {name:?} is not among the policies of this run ({run}): nothing is compared with it");
    }
    Ok(())
}

/// Shows how far a run is.
struct Bar(ProgressBar);

impl Watch for Bar {
    fn done(&self, _key: &EpisodeKey) {
        self.0.inc(1);
    }

    fn begun(&self, episodes: usize, done: usize) {
        self.0.set_length(episodes as u64);
        self.0.set_position(done as u64);
        self.0.reset_eta();
    }

    fn outdated(&self, policy: &str, episodes: usize) {
        self.0.suspend(|| {
            eprintln!(
                "{policy}: {episodes} episodes were run with other weights or settings of the network and are repeated"
            )
        });
    }

    fn left_out(&self, object: &str, policy: &str) {
        self.0.suspend(|| eprintln!("{object} lacks the inputs of {policy}: left out"));
    }

    fn unseeable(&self, object: &str, share: f64) {
        let percent = 100.0 * share;
        self.0.suspend(|| eprintln!("{object}: no camera sees {percent:.1} % of its surface, which does not count"));
    }

    fn unusable(&self, object: &str, reason: &ObjectError) {
        self.0.suspend(|| eprintln!("skipped {object}: {reason}"));
    }
}

fn progress() -> ProgressBar {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(0) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} episodes, {per_sec}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

fn summary(args: &Args, config: &EvaluateConfig, rows: &Rows, contents: &journal::Contents) -> anyhow::Result<()> {
    if args.json {
        return Ok(program::print_line(serde_json::to_string(rows)?)?);
    }
    let (episodes, skipped) = (contents.episodes.len(), contents.skipped.len());
    let unusable = match rows.unusable() {
        0 => String::new(),
        count => format!(", {count} objects could not be used"),
    };
    let place = args.results().join("report.html");
    let mut table = rows.recorded_table().unwrap_or_else(|| rows.overall()).to_markdown();
    if args.preset.is_some() {
        let order = report::policy_order(contents, &config.policies);
        table.push_str(&report::paper::beside_the_paper(contents, config, &order).to_markdown());
    }
    Ok(program::print_line(format_args!("{table}\n{episodes} episodes, {skipped} skipped{unusable}; see {place:?}"))?)
}

fn compare_folders(args: &Args) -> anyhow::Result<ExitCode> {
    let folders = folder::read_all(&args.compare)?;
    compare::check(&folders)?;
    let baseline = args.baseline.clone().unwrap_or_else(|| EvaluateConfig::default().baseline);
    let baseline: Policy = baseline.parse().context("--baseline")?;
    let policies = compare::policies(&folders);
    if args.baseline.is_some() && !policies.iter().any(|policy| policy == baseline.name()) {
        bail!("--baseline {}: no directory has this policy; expected one of {}", baseline.name(), policies.join(", "));
    }
    let mut text: String = compare::notes(&folders).iter().map(|note| format!("{note}\n\n")).collect();
    text.extend(compare::tables(&folders, baseline.name()).iter().map(report::table::Table::to_markdown));
    program::print_line(&text)?;
    if let Some(out) = &args.out {
        atomic_write(&out.join("compare.md"), format!("# Comparison\n\n{text}").as_bytes())?;
    }
    Ok(ExitCode::SUCCESS)
}
