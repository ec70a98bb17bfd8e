//! `evaluate`: policies against each other on simulated objects.

use anyhow::{Context, bail};
use clap::Parser;
use evaluate::benchmark;
use evaluate::config::{EvaluateConfig, PaperConfig};
use evaluate::journal::{self, Journal};
use evaluate::networks::Networks;
use evaluate::objects;
use evaluate::policies::{PAPER_POLICIES, POLICIES, weights_of};
use evaluate::report::{self, compare};
use formats::config::Flag;
use formats::run::{RunDir, atomic_write};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Runs next-best-view policies on simulated objects and reports the paper's metrics with confidence intervals.
///
/// A run can be stopped at any moment and goes on with the same command. Example:
///   evaluate --dataset repository3d --root data/repository3d --policies benbv,see,farthest --out runs/eval/first
#[derive(Parser)]
#[command(version, verbatim_doc_comment)]
struct Args {
    /// Set of objects: repository3d, folder, modelnet40, shapenet, procedural
    #[arg(long)]
    dataset: Option<String>,
    /// Directory of the set [default: data/<dataset>]
    #[arg(long)]
    root: Option<String>,
    /// Only these objects, by name
    #[arg(long, value_delimiter = ',')]
    only: Option<Vec<String>>,
    /// Take this many objects of the set [default: all; 20 of procedural]
    #[arg(long)]
    objects: Option<i64>,
    /// Policies, by name; `all` for every one (see --list-policies)
    #[arg(long, value_delimiter = ',')]
    policies: Option<Vec<String>>,
    /// Episodes per object and policy [default: 60]
    #[arg(long)]
    episodes: Option<i64>,
    /// Seed of everything random [default: 0]
    #[arg(long)]
    seed: Option<i64>,
    /// Directory of the results
    #[arg(long, default_value = "runs/evaluate")]
    out: PathBuf,
    /// Start from the publication's simulator, policies and counting instead of the correct defaults
    #[arg(long, value_parser = ["paper"])]
    preset: Option<String>,
    /// Distance from target to camera, metres [default: 1.2]
    #[arg(long)]
    distance: Option<f64>,
    /// Policy that the others are compared with [default: benbv]
    #[arg(long)]
    baseline: Option<String>,
    /// Threads [default: all]
    #[arg(long)]
    jobs: Option<usize>,
    /// Settings from a TOML file, e.g. configs/studies/noise.toml
    #[arg(long)]
    config: Option<PathBuf>,
    /// One setting, e.g. --set episode.tolerance_m=0.003
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Compare result directories, the first being the reference, instead of running anything
    #[arg(long, num_args = 2.., value_name = "DIR")]
    compare: Vec<PathBuf>,
    /// List the policies
    #[arg(long)]
    list_policies: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
    /// More messages; twice for all
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
}

fn main() -> std::process::ExitCode {
    let args = Args::parse();
    let level = ["warn", "info", "debug"][usize::from(args.verbose.min(2))];
    tracing_subscriber::fmt().with_env_filter(level).with_writer(std::io::stderr).init();
    match run(&args) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e:#}");
            std::process::ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> anyhow::Result<()> {
    if args.list_policies {
        for (name, what) in POLICIES {
            println!("{name:<18} {what}");
        }
        return Ok(());
    }
    if !args.compare.is_empty() {
        return compare_folders(args);
    }
    let config = settings(args)?;
    if let Some(jobs) = args.jobs {
        rayon::ThreadPoolBuilder::new().num_threads(jobs.max(1)).build_global().context("cannot start the threads")?;
    }
    let sources = objects::list(&config)?;
    let networks = Networks::new(&config);
    let policies = policies(&config, args.preset.is_some(), &networks)?;
    let (journal, mut contents) = Journal::open(&args.out, &config.outcome_hash()?)?;
    for policy in &policies {
        let outdated = contents.forget_other_weights(policy, weights_of(policy, &config, &networks).as_deref());
        if outdated > 0 {
            eprintln!("{policy}: {outdated} episodes were run with other weights, and are run again");
        }
    }
    let mut directory = RunDir::create(&args.out, "evaluate", &config)?;
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed)).context("cannot listen for Ctrl-C")?;

    let total = sources.len() * policies.len() * config.episodes;
    let have = contents.keys();
    let wanted = |key: &evaluate::record::EpisodeKey| policies.contains(&key.policy) && key.episode < config.episodes;
    let bar = progress(total as u64, have.iter().filter(|k| wanted(k)).count() as u64);
    let mut shown = Vec::new();
    // As many objects at a time as keep the cores busy; the first ones stay for the replay.
    for group in sources.chunks(4 * rayon::current_num_threads()) {
        let ready: Vec<_> = group.par_iter().map(|source| objects::load(source, &config)).collect();
        let mut usable = Vec::new();
        for (source, object) in group.iter().zip(ready) {
            match object {
                Ok(object) => usable.push(object),
                Err(reason) => bar.suspend(|| eprintln!("skipped {}: {reason}", source.name)),
            }
        }
        benchmark::run(&usable, &policies, &config, &networks, &journal, &mut contents, &stop, |_| bar.inc(1))?;
        if shown.is_empty() {
            shown = usable;
        }
        if stop.load(Ordering::Relaxed) {
            directory.finish("stopped; the same command goes on")?;
            bail!("stopped after {} episodes; the same command goes on from here", contents.episodes.len());
        }
    }
    bar.finish_and_clear();
    contents.episodes.retain(|(r, _)| wanted(&r.key));
    contents.skipped.retain(|s| wanted(&s.key));
    report::write(&args.out, &contents, &config, &policies, &shown)?;
    directory.finish("finished")?;
    summary(args, &contents, &config, &policies);
    Ok(())
}

fn settings(args: &Args) -> anyhow::Result<EvaluateConfig> {
    let list = |names: &Option<Vec<String>>| names.clone();
    let flags: Vec<Flag> = [
        Flag::given("--dataset", "dataset.name", args.dataset.clone()),
        Flag::given("--root", "dataset.root", args.root.clone()),
        Flag::given("--objects", "dataset.objects", args.objects),
        Flag::given("--only", "only", list(&args.only)),
        Flag::given("--policies", "policies", list(&args.policies)),
        Flag::given("--episodes", "episodes", args.episodes),
        Flag::given("--seed", "seed", args.seed),
        Flag::given("--distance", "episode.working_distance_m", args.distance),
        Flag::given("--baseline", "baseline", args.baseline.clone()),
    ]
    .into_iter()
    .flatten()
    .collect();
    let file = args.config.as_deref();
    let config: EvaluateConfig = match args.preset {
        Some(_) => formats::config::load::<PaperConfig>(file, &args.set, &flags)?.0,
        None => formats::config::load(file, &args.set, &flags)?,
    };
    if config.episodes == 0 {
        bail!("--episodes 0: found no episode to run, expected at least 1");
    }
    Ok(config)
}

/// The policies asked for, each checked before any long work. `all` leaves out networks without weights, saying so.
fn policies(config: &EvaluateConfig, paper: bool, networks: &Networks) -> anyhow::Result<Vec<String>> {
    let mut list: Vec<String> = Vec::new();
    for policy in &config.policies {
        let names: Vec<&str> = match (policy.as_str(), paper) {
            ("all", true) => PAPER_POLICIES.to_vec(),
            ("all", false) => POLICIES.iter().map(|(name, _)| *name).collect(),
            (name, _) => vec![name],
        };
        for name in names {
            match objects::try_policy(name, config, networks) {
                Ok(()) if list.iter().any(|p| p == name) => {}
                Ok(()) => list.push(name.to_owned()),
                Err(e) if policy == "all" => eprintln!("left out of `all`: {e}"),
                Err(e) => return Err(e.into()),
            }
        }
    }
    if list.is_empty() {
        bail!("--policies: found none, expected names or `all`");
    }
    Ok(list)
}

fn progress(total: u64, done: u64) -> ProgressBar {
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(total) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} episodes, {per_sec}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_position(done);
    bar.reset_eta();
    bar
}

fn summary(args: &Args, contents: &journal::Contents, config: &EvaluateConfig, policies: &[String]) {
    let order = report::policy_order(contents, policies);
    let tables = report::tables::results(contents, config, &order);
    if args.json {
        let rows: Vec<serde_json::Value> = tables[0]
            .rows
            .iter()
            .map(|row| {
                tables[0].header.iter().cloned().zip(row.iter().cloned().map(serde_json::Value::String)).collect()
            })
            .collect();
        println!("{}", serde_json::Value::Array(rows));
        return;
    }
    println!("{}", tables[0].to_markdown());
    println!(
        "{} episodes, {} skipped; see {:?}",
        contents.episodes.len(),
        contents.skipped.len(),
        args.out.join("report.html")
    );
}

fn compare_folders(args: &Args) -> anyhow::Result<()> {
    let folders: Vec<compare::Folder> = args
        .compare
        .iter()
        .map(|path| {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            Ok(compare::Folder { name, contents: journal::read(path)? })
        })
        .collect::<Result<_, journal::JournalError>>()?;
    let baseline = args.baseline.clone().unwrap_or_else(|| EvaluateConfig::default().baseline);
    let tables = compare::tables(&folders, &baseline, EvaluateConfig::default().never);
    let text: String = tables.iter().map(report::table::Table::to_markdown).collect();
    println!("{text}");
    if args.out != Path::new("runs/evaluate") {
        atomic_write(&args.out.join("compare.md"), format!("# Comparison\n\n{text}").as_bytes())?;
    }
    Ok(())
}
