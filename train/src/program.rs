//! The program `train`: networks for next-best-view planning from data that `datagen` made.

use crate::config::NetworkKind;
use crate::data::newest_set;
use crate::pc_nbv::{GainSet, PcNbvTask};
use crate::{BenbvTask, Dataset, Outcome, Run, Task, TrainConfig};
use anyhow::{Context, bail};
use clap::{Args, Parser, Subcommand};
use datagen::{OutputKind, check_output};
use formats::Flag;
use formats::lock::{LOCK, try_lock};
use formats::program::{self, CommonArgs, EXIT_CODES};
use formats::run::{RunDir, new_run_path};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

const EXAMPLES: &str = "\
Example:
  datagen --dataset procedural --out runs/data/first
  train --config configs/tiny/train.toml --data runs/data/first --out runs/train/first
To watch a run, open index.html in its directory, or use `tensorboard --logdir runs/train`.

An interrupted run resumes with the same command if it names the directory with --out, or with --resume. ";

/// Trains a network that chooses the next best view
#[derive(Parser)]
#[command(
    version = built::VERSION,
    args_conflicts_with_subcommands = true,
    after_help = format!("{EXAMPLES}{EXIT_CODES}")
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    train: TrainArgs,
}

#[derive(Subcommand)]
enum Command {
    /// Convert weights between PyTorch files and checkpoints
    Convert(crate::convert::ConvertArgs),
}

#[derive(Args)]
struct TrainArgs {
    /// benbv-net, or its rival pc-nbv (which generates its own data) [default: benbv-net]
    #[arg(long, value_name = "KIND")]
    network: Option<String>,
    /// Data set; repeat it to join several [default: the newest complete one with training objects under runs/data]
    #[arg(long, value_name = "DIR")]
    data: Vec<PathBuf>,
    /// Directory of the run; an existing run is resumed [default: runs/train/<time>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Resume the run in --out, or the newest one under runs/train, with its settings
    #[arg(long, conflicts_with = "config")]
    resume: bool,
    /// Passes over the data
    #[arg(long, value_name = "COUNT")]
    epochs: Option<u32>,
    /// Samples per optimizer step
    #[arg(long, value_name = "COUNT")]
    batch: Option<u32>,
    /// Number of points that clouds are resampled to
    #[arg(long, value_name = "COUNT")]
    points: Option<u32>,
    /// Learning rate
    #[arg(long, value_name = "RATE")]
    lr: Option<f64>,
    /// cpu, or a GPU backend that was compiled in (wgpu, cuda) [default: cpu]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Print the outcome as JSON on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl TrainArgs {
    fn flags(&self) -> [Option<Flag>; 7] {
        let sets: Vec<_> = self.data.iter().map(|p| p.to_string_lossy().into_owned()).collect();
        [
            Flag::given("--network", "kind", self.network.clone()),
            Flag::given("--data", "data", (!sets.is_empty()).then_some(sets)),
            Flag::given("--epochs", "epochs", self.epochs.map(i64::from)),
            Flag::given("--batch", "batch", self.batch.map(i64::from)),
            Flag::given("--points", "network.points", self.points.map(i64::from)),
            Flag::given("--lr", "optimizer.learning_rate", self.lr),
            Flag::given("--device", "device", self.device.clone()),
        ]
    }
}

/// The program with this command line, its own name first.
pub fn main(words: impl Iterator<Item = OsString>) -> ExitCode {
    let cli: Cli = program::parse_from(words).unwrap_or_else(|error| error.exit());
    cli.train.common.start_messages(["warn,train=info", "warn,train=debug", "warn,train=trace"]);
    program::finish(match &cli.command {
        Some(Command::Convert(args)) => {
            if let Some(message) = crate::convert::without_effect(args) {
                program::misuse::<Cli>(&message);
            }
            crate::convert::convert(args).map(|()| ExitCode::SUCCESS).map_err(Into::into)
        }
        None => train_network(&cli.train),
    })
}

fn train_network(args: &TrainArgs) -> anyhow::Result<ExitCode> {
    let base = Path::new("runs/train");
    let dir = match (&args.out, args.resume) {
        (Some(out), _) => out.clone(),
        (None, false) => new_run_path(base),
        (None, true) => formats::run::newest(base, "latest/training.toml")
            .with_context(|| format!("no run to resume in {base:?}; name it with --out DIR"))?,
    };
    if args.resume && !crate::checkpoint::exists(&dir.join("latest")) {
        bail!("{dir:?} contains no run to resume (no latest/training.toml); omit --resume to start one there");
    }
    check_output(&dir, OutputKind::Training)?;
    let mut common = args.common.clone();
    if args.resume {
        let stored = dir.join("config.toml");
        formats::config::check_stored(&stored)?;
        common.config = Some(stored);
    }
    let mut config: TrainConfig = common.settings(args.flags())?;
    config.validate()?;
    if config.kind == NetworkKind::PcNbv && !(args.data.is_empty() && args.points.is_none()) {
        program::misuse::<Cli>(
            "pc-nbv generates its own data with pc_nbv.points points: --data and --points have no effect",
        );
    }
    common.start_threads()?;
    crate::trainer::open_device(&config)?;
    let data = open_data(&mut config)?;
    // Nothing is written before all that can be wrong with a start is known.
    let _lock = try_lock(&dir, LOCK, "train")?;
    let resume = crate::checkpoint::exists(&dir.join("latest"));
    if resume {
        match &data {
            Data::Decisions(data) => crate::origin::resumable(&BenbvTask::new(&config, data), &config, &dir)?,
            Data::Gains(data) => crate::origin::resumable(&PcNbvTask::new(&config, data), &config, &dir)?,
        };
    }
    let mut run_dir = RunDir::create(&dir, "train", built::COMMIT, &config)?;
    if let Some(mixture) = run_dir.mixture("steps").filter(|_| resume) {
        tracing::warn!("{mixture}");
    }
    // Asked twice it ends at once; the last checkpoint stays whole.
    let stop = program::stop_when_asked("stopping after this step; press again to stop immediately")?;
    tracing::info!("run: {dir:?}; curves in {:?}", dir.join("index.html"));
    let halt = |_| stop.load(Ordering::SeqCst);
    let run = |data: String| -> anyhow::Result<Run> {
        Ok(Run { dir: &dir, resume, quiet: false, stop: &halt, provenance: provenance(&run_dir, &config, data)? })
    };
    let outcome = match &data {
        Data::Decisions(data) => crate::train(&BenbvTask::new(&config, data), &config, &run(data.name().to_string())?),
        Data::Gains(data) => {
            let task = PcNbvTask::new(&config, data);
            crate::train(&task, &config, &run(task.data_name())?)
        }
    };
    let noted = run_dir.finish(match &outcome {
        Ok(o) if o.finished => "finished",
        Ok(_) => "stopped",
        Err(_) => "failed",
    });
    // What ended the run comes first: on a full disk its end cannot be noted either.
    let outcome = outcome?;
    noted?;
    report(&outcome, &dir, args.json)
}

enum Data {
    Decisions(Dataset),
    Gains(GainSet),
}

fn open_data(config: &mut TrainConfig) -> anyhow::Result<Data> {
    if config.kind == NetworkKind::PcNbv {
        tracing::info!("simulating {} objects", config.pc_nbv.objects + config.pc_nbv.validation_objects);
        return Ok(Data::Gains(GainSet::procedural(&config.pc_nbv, config.seed)));
    }
    if config.data.is_empty() {
        let newest = newest_set(Path::new("runs/data"))?;
        tracing::info!("data: {newest:?}, the newest complete set under \"runs/data\"");
        config.data.push(newest);
    }
    let data = Dataset::open_all(&config.data, config.validation.fraction, config.seed)?;
    tracing::info!("{} training and {} validation samples of {}", data.num_train(), data.num_validation(), data.name());
    Ok(Data::Decisions(data))
}

fn provenance(run: &RunDir, config: &TrainConfig, data: String) -> anyhow::Result<BTreeMap<String, String>> {
    let p = run.provenance();
    Ok(BTreeMap::from([
        ("command".to_string(), p.command.join(" ")),
        ("program".into(), p.program.clone()),
        ("commit".into(), p.commit.clone()),
        ("seed".into(), config.seed.to_string()),
        ("settings".into(), formats::config::hash(config)?),
        ("data".into(), data),
    ]))
}

fn report(outcome: &Outcome, dir: &Path, json: bool) -> anyhow::Result<ExitCode> {
    let best = outcome.epochs.iter().rfind(|e| e.best);
    if json {
        let value = serde_json::json!({
            "run": dir,
            "finished": outcome.finished,
            "steps": outcome.state.step,
            "epochs": outcome.epochs.len(),
            "best": best,
        });
        program::print_line(value)?;
    } else if let Some(e) = best {
        tracing::info!(
            "best epoch {}: regret {:.3} of random's, rank correlation {:.3}, hit rate {:.3}; weights in {:?}",
            e.epoch + 1,
            e.valid.relative_regret(),
            e.valid.rank_correlation,
            e.valid.hit_rate,
            dir.join("best")
        );
    }
    Ok(if outcome.finished { ExitCode::SUCCESS } else { ExitCode::from(program::STOPPED) })
}
