//! The program `datagen`: from meshes to training shards.

mod progress;

use anyhow::{Context, bail};
use clap::{Args, Parser, Subcommand};
use datagen::config::DatagenConfig;
use datagen::dataset::{DatasetName, Source, list_objects};
use datagen::generate::{Job, Part, Summary, generate, prepare};
use formats::Flag;
use progress::Progress;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use tracing_subscriber::EnvFilter;

/// Scan meshes in simulation and write training shards of boundary-based next-best-view decisions.
#[derive(Parser)]
#[command(
    version,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  datagen                                            a few built-in objects into runs/data/procedural\n  datagen --dataset modelnet40 --per-category 20     meshes under data/modelnet40\n  datagen --dataset folder --root my/meshes --out runs/data/mine --set episode.working_distance_m=0.8\n  datagen verify runs/data/mine                      every byte against checksum and manifest\n  datagen inspect runs/data/mine                     what is inside\n\nA stopped run goes on with the same command. Exit codes: 0 done, 1 error, 2 wrong usage, 130 stopped."
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    run: RunArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Check every shard of a set against its checksum and the manifest
    Verify {
        /// Directory of the set
        directory: PathBuf,
        /// Print the verdict as JSON
        #[arg(long)]
        json: bool,
    },
    /// Show what is inside a set: counts, curves, score histogram, one sample
    Inspect {
        /// Directory of the set
        directory: PathBuf,
        /// Print it as JSON
        #[arg(long)]
        json: bool,
    },
    /// Turn the authors' frame histories (.bin) into a set
    Import {
        /// Files, or directories of files; the name of a file is that of its object
        #[arg(required = true)]
        inputs: Vec<PathBuf>,
        /// Directory of the set
        #[arg(long)]
        out: PathBuf,
        /// Share of the objects set aside for validation
        #[arg(long, default_value_t = 0.2)]
        validation_share: f64,
        /// Decides which objects are set aside
        #[arg(long, default_value_t = 0)]
        seed: u64,
    },
    /// Turn a set into the authors' frame histories, one .bin per object
    Export {
        /// Directory of the set
        directory: PathBuf,
        /// Directory of the files
        #[arg(long)]
        out: PathBuf,
    },
}

#[derive(Args)]
struct RunArgs {
    /// Data set: procedural (built in), modelnet40, shapenet, repository3d or folder
    #[arg(long, value_name = "NAME")]
    dataset: Option<String>,
    /// Where the data set lies [default: data/<NAME>]
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Where the shards go [default: runs/data/<NAME>, with -test for the test half]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Which half: train or test
    #[arg(long, value_name = "HALF")]
    split: Option<String>,
    /// Take this many objects of each category
    #[arg(long, value_name = "N")]
    per_category: Option<u32>,
    /// Take exactly the models that this file names, one per line
    #[arg(long, value_name = "FILE")]
    list: Option<PathBuf>,
    /// Take this many objects
    #[arg(long, value_name = "N")]
    objects: Option<u32>,
    /// Print the objects that would be taken, and stop
    #[arg(long)]
    list_objects: bool,
    /// Next views per object (15)
    #[arg(long, value_name = "N")]
    scans: Option<u32>,
    /// Boundary targets per decision (20)
    #[arg(long, value_name = "N")]
    candidates: Option<u32>,
    /// Distance from target to camera in metres (1.2)
    #[arg(long, value_name = "M")]
    distance: Option<f64>,
    /// Every random number follows from it (0)
    #[arg(long, value_name = "N")]
    seed: Option<u32>,
    /// Threads; 0: one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    jobs: usize,
    /// Configuration file (TOML); `configs/datagen.toml` spells out every setting
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// One setting, e.g. `--set episode.tolerance_m=0.003`; may be given again
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// This process's share of the objects, e.g. 0/4 of 0/4 to 3/4; taken by itself from a Slurm array task, or from
    /// JOB_COMPLETION_INDEX and JOB_COMPLETIONS of a Kubernetes indexed job
    #[arg(long, value_name = "I/N")]
    part: Option<String>,
    /// Print the closing summary as JSON
    #[arg(long)]
    json: bool,
    /// More messages
    #[arg(short, long)]
    verbose: bool,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let level = if cli.run.verbose { "debug" } else { "warn" };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .without_time()
        .with_target(false)
        .init();
    let result = match cli.command {
        None => run(&cli.run),
        Some(Command::Verify { directory, json }) => verify(&directory, json),
        Some(Command::Inspect { directory, json }) => inspect(&directory, json),
        Some(Command::Import { inputs, out, validation_share, seed }) => import(&inputs, &out, validation_share, seed),
        Some(Command::Export { directory, out }) => export(&directory, &out),
    };
    result.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::FAILURE
    })
}

fn load_config(args: &RunArgs) -> anyhow::Result<DatagenConfig> {
    let text = |path: &Option<PathBuf>| path.as_ref().map(|p| p.to_string_lossy().into_owned());
    let flags: Vec<Flag> = [
        Flag::given("--dataset", "dataset.name", args.dataset.clone()),
        Flag::given("--root", "dataset.root", text(&args.root)),
        Flag::given("--split", "dataset.split", args.split.clone()),
        Flag::given("--per-category", "dataset.per_category", args.per_category),
        Flag::given("--list", "dataset.list", text(&args.list)),
        Flag::given("--objects", "dataset.objects", args.objects),
        Flag::given("--scans", "episode.num_views", args.scans),
        Flag::given("--candidates", "candidates.num_targets", args.candidates),
        Flag::given("--distance", "episode.working_distance_m", args.distance),
        Flag::given("--seed", "seed", args.seed),
    ]
    .into_iter()
    .flatten()
    .collect();
    let config: DatagenConfig = formats::config::load(args.config.as_deref(), &args.set, &flags)?;
    config.validate().map_err(anyhow::Error::msg)?;
    Ok(config)
}

fn run(args: &RunArgs) -> anyhow::Result<ExitCode> {
    let config = load_config(args)?;
    let objects = list_objects(&config.dataset, config.seed, config.validation_share)?;
    if args.list_objects {
        for object in &objects {
            let place = match &object.source {
                Source::File(path) => path.display().to_string(),
                Source::Procedural { index, .. } => format!("built in, number {index}"),
            };
            println!("{}\t{}\t{:?}\t{place}", object.name, object.category, object.split);
        }
        return Ok(ExitCode::SUCCESS);
    }
    let part = part(args.part.as_deref(), |name| std::env::var(name).ok())?;
    let out = args.out.clone().unwrap_or_else(|| default_out(&config));
    let commit = formats::run::commit();
    let job = Job { config: &config, objects: &objects, part, out: &out, jobs: args.jobs, commit: &commit };
    let mut prepared = prepare(&job, "datagen")?;

    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130); // asked twice
        }
        eprintln!("stopping after the objects in hand; once more to stop at once (nothing finished is lost)");
    })
    .context("cannot watch for Ctrl-C")?;
    if !args.json {
        let threads = if args.jobs > 0 { args.jobs } else { prepared.run.provenance().threads };
        let name = config.dataset.name.as_str();
        eprintln!("{} objects of {name} into {}, {threads} threads", objects.len(), out.display());
    }
    let clock = Instant::now();
    let mine = objects.len().saturating_sub(part.index).div_ceil(part.count);
    let progress = Progress::new(mine);
    let summary = generate(&job, &STOP, |done, count, name| progress.step(done, count, name));
    progress.finish();
    let outcome = match &summary {
        Ok(summary) if summary.left == 0 => "done".to_owned(),
        Ok(summary) => format!("stopped, {} objects left", summary.left),
        Err(error) => error.to_string(),
    };
    prepared.run.finish(&outcome)?;
    let summary = summary.context("stopped; what is finished stays, and the same command goes on from there")?;
    let seconds = clock.elapsed().as_secs_f64();
    if args.json {
        println!("{}", serde_json::to_string(&summary)?);
    } else {
        print_summary(&summary, &out, seconds);
    }
    if summary.left > 0 {
        return Ok(ExitCode::from(130));
    }
    if summary.made + summary.kept == 0 && !summary.skipped.is_empty() {
        bail!("no object could be used; the reasons are in {:?}", out.join("manifest.json"));
    }
    Ok(ExitCode::SUCCESS)
}

fn default_out(config: &DatagenConfig) -> PathBuf {
    let name = config.dataset.name.as_str();
    let test = config.dataset.split() == datagen::dataset::SplitChoice::Test
        && config.dataset.name != DatasetName::Repository3d;
    PathBuf::from("runs/data").join(if test { format!("{name}-test") } else { name.to_owned() })
}

fn print_summary(summary: &Summary, out: &std::path::Path, seconds: f64) {
    let objects = summary.made + summary.kept;
    println!(
        "{objects} objects, {} samples in {}: {} made in {seconds:.1} s, {} there before",
        summary.samples,
        out.display(),
        summary.made,
        summary.kept
    );
    if objects > 0 {
        let mean = 100.0 * summary.final_coverage / objects as f64;
        println!("final coverage {mean:.1} % on average; {} void first views drawn again", summary.void_episodes);
    }
    for path in &summary.damaged {
        println!("damaged and made anew: {}", path.display());
    }
    if !summary.skipped.is_empty() {
        println!("{} objects skipped:", summary.skipped.len());
        for (name, reason) in summary.skipped.iter().take(20) {
            println!("  {name}: {reason}");
        }
        if summary.skipped.len() > 20 {
            println!("  ... all of them in {}", out.join("manifest.json").display());
        }
    }
    if summary.left > 0 {
        println!("stopped: {} objects left; the same command goes on from here", summary.left);
    } else {
        println!("look inside with: datagen inspect {}", out.display());
    }
}

/// This process's share: the flag, or what a Slurm array task or a Kubernetes indexed job says.
fn part(flag: Option<&str>, environment: impl Fn(&str) -> Option<String>) -> anyhow::Result<Part> {
    let number = |name: &str| -> anyhow::Result<Option<usize>> {
        environment(name)
            .map(|text| {
                text.trim()
                    .parse()
                    .with_context(|| format!("environment variable {name} is {text:?}, expected a number"))
            })
            .transpose()
    };
    let (index, count, origin) = if let Some(text) = flag {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let Some((index, count)) = numbers else {
            bail!("--part {text:?}: expected I/N, e.g. 0/4");
        };
        (index, count, format!("--part {text}"))
    } else if let (Some(id), Some(count)) = (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_COUNT")?) {
        let (first, step) =
            (number("SLURM_ARRAY_TASK_MIN")?.unwrap_or(0), number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1));
        (id.saturating_sub(first) / step.max(1), count, format!("Slurm array task {id} of {count}"))
    } else if let Some(index) = number("JOB_COMPLETION_INDEX")? {
        let Some(count) = number("JOB_COMPLETIONS")? else {
            bail!(
                "JOB_COMPLETION_INDEX is {index}, but Kubernetes does not say of how many: set JOB_COMPLETIONS to the \
                 job's completions, or give --part $(JOB_COMPLETION_INDEX)/N"
            );
        };
        (index, count, format!("completion {index} of {count}"))
    } else {
        return Ok(Part::WHOLE);
    };
    if index >= count {
        bail!("{origin}: expected an index from 0 to {}", count.saturating_sub(1));
    }
    Ok(Part { index, count })
}

fn verify(directory: &std::path::Path, json: bool) -> anyhow::Result<ExitCode> {
    let verdict = datagen::verify::verify(directory)?;
    if json {
        println!("{}", serde_json::to_string(&verdict)?);
    } else {
        println!(
            "{} sound shards with {} samples, {} objects skipped",
            verdict.shards, verdict.samples, verdict.skipped
        );
        for problem in &verdict.problems {
            println!("problem: {problem}");
        }
        if !verdict.missing.is_empty() {
            println!("{} objects not made yet, e.g. {}", verdict.missing.len(), verdict.missing[0]);
        }
    }
    Ok(if verdict.is_sound() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn inspect(directory: &std::path::Path, json: bool) -> anyhow::Result<ExitCode> {
    let inspection = datagen::inspect::inspect(directory)?;
    if json {
        println!("{}", serde_json::to_string(&inspection)?);
    } else {
        println!("{inspection}");
    }
    Ok(ExitCode::SUCCESS)
}

fn import(inputs: &[PathBuf], out: &std::path::Path, validation_share: f64, seed: u64) -> anyhow::Result<ExitCode> {
    let manifest = datagen::history::import(inputs, out, validation_share, seed)?;
    println!("{} objects, {} samples in {}", manifest.objects.len(), manifest.num_samples(), out.display());
    Ok(ExitCode::SUCCESS)
}

fn export(directory: &std::path::Path, out: &std::path::Path) -> anyhow::Result<ExitCode> {
    let (files, left_out) = datagen::history::export(directory, out)?;
    println!("{files} files in {}", out.display());
    if left_out > 0 {
        println!("{left_out} samples left out: the format takes exactly 20 candidates");
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn parts_from_flag_slurm_and_kubernetes() {
        let of = |flag: Option<&str>, variables: &[(&str, &str)]| {
            part(flag, |name| variables.iter().find(|v| v.0 == name).map(|v| v.1.to_owned()))
        };
        assert_eq!(of(None, &[]).unwrap(), Part::WHOLE);
        assert_eq!(of(Some("2/4"), &[("SLURM_ARRAY_TASK_ID", "0")]).unwrap(), Part { index: 2, count: 4 });
        let slurm = [
            ("SLURM_ARRAY_TASK_ID", "7"),
            ("SLURM_ARRAY_TASK_COUNT", "4"),
            ("SLURM_ARRAY_TASK_MIN", "1"),
            ("SLURM_ARRAY_TASK_STEP", "2"),
        ];
        assert_eq!(of(None, &slurm).unwrap(), Part { index: 3, count: 4 });
        let job = [("JOB_COMPLETION_INDEX", "1"), ("JOB_COMPLETIONS", "3")];
        assert_eq!(of(None, &job).unwrap(), Part { index: 1, count: 3 });
        assert!(of(None, &job[..1]).unwrap_err().to_string().contains("JOB_COMPLETIONS"));
        assert!(of(Some("4/4"), &[]).unwrap_err().to_string().contains("0 to 3"));
        assert!(of(Some("x"), &[]).unwrap_err().to_string().contains("expected I/N"));
    }
}
