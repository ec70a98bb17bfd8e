//! The program `datagen`: from meshes to training shards.

use crate::args::{Cli, Command, RunArgs};
use crate::config::DatagenConfig;
use crate::dataset::{DatasetName, Source, list_objects};
use crate::generate::{Job, Summary, generate, prepare};
use crate::progress::Progress;
use anyhow::{Context, bail};
use formats::program::{self, ProgramError, STOPPED, finish, print, print_line, stop_when_asked};
use std::ffi::OsString;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// The program with this command line, its own name first.
pub fn main(words: impl Iterator<Item = OsString>) -> ExitCode {
    let cli: Cli = program::parse_from(words).unwrap_or_else(|error| error.exit());
    cli.run.common.start_messages(["warn", "info", "debug"]);
    finish(match cli.command {
        None => run(&cli.run),
        Some(Command::Verify { directory, json }) => verify(&directory, json),
        Some(Command::Inspect { directory, json }) => inspect(&directory, json),
        Some(Command::Import { inputs, out, validation_share, seed }) => import(&inputs, &out, validation_share, seed),
        Some(Command::Export { directory, out }) => export(&directory, &out),
    })
}

fn run(args: &RunArgs) -> anyhow::Result<ExitCode> {
    let config = args.settings()?;
    let objects = list_objects(&config.dataset, config.seed, config.validation_share)?;
    if args.list_objects {
        for object in &objects {
            let place = match &object.source {
                Source::File(path) | Source::Sequence(path) => path.display().to_string(),
                Source::Procedural { index, .. } => format!("built in, number {index}"),
            };
            print_line(format_args!("{}\t{}\t{:?}\t{place}", object.name, object.category, object.split))?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let part = crate::part::part(args.part.as_deref(), |name| std::env::var(name).ok())?;
    let out = args.out.clone().unwrap_or_else(|| default_out(&config));
    let jobs = args.common.jobs;
    let job = Job { config: &config, objects: &objects, part, out: &out, jobs, commit: built::COMMIT };
    let mut prepared = prepare(&job, "datagen")?;

    let stop =
        stop_when_asked("stopping after the current objects; press again to stop immediately (finished work is kept)")?;
    if !args.json {
        let threads = if args.common.jobs > 0 { args.common.jobs } else { prepared.run.provenance().threads };
        let name = config.dataset.name.as_str();
        eprintln!("{} objects of {name} into {}, {threads} threads", objects.len(), out.display());
    }
    let clock = Instant::now();
    let mine = objects.len().saturating_sub(part.index).div_ceil(part.count);
    let progress = Progress::new(mine);
    let summary = generate(&job, stop, |done, count, name| progress.step(done, count, name));
    progress.finish();
    let outcome = match &summary {
        Ok(summary) if summary.left == 0 => "done".to_owned(),
        Ok(summary) => format!("stopped, {} objects left", summary.left),
        Err(error) => error.to_string(),
    };
    let noted = prepared.run.finish(&outcome);
    // What stopped the run comes first: on a full disk its end cannot be noted either.
    let summary = summary.context("stopped; finished work is kept, and the same command resumes from there")?;
    noted?;
    let seconds = clock.elapsed().as_secs_f64();
    if args.json {
        print_line(serde_json::to_string(&summary)?)?;
    } else {
        print_summary(&summary, &out, seconds)?;
    }
    if summary.left > 0 {
        return Ok(ExitCode::from(STOPPED));
    }
    if summary.made + summary.kept == 0 && !summary.skipped.is_empty() {
        bail!("no object could be used; the reasons are in {:?}", out.join("manifest.json"));
    }
    Ok(ExitCode::SUCCESS)
}

fn default_out(config: &DatagenConfig) -> PathBuf {
    let name = config.dataset.name.as_str();
    let test =
        config.dataset.split() == crate::dataset::SplitChoice::Test && config.dataset.name != DatasetName::Repository3d;
    PathBuf::from("runs/data").join(if test { format!("{name}-test") } else { name.to_owned() })
}

fn print_summary(summary: &Summary, out: &std::path::Path, seconds: f64) -> Result<(), ProgramError> {
    let objects = summary.made + summary.kept;
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{objects} objects, {} samples in {}: {} made in {seconds:.1} s, {} there before",
        summary.samples,
        out.display(),
        summary.made,
        summary.kept
    );
    if let Some(mean) = summary.final_coverage {
        let _ = writeln!(
            text,
            "final coverage {:.1} % on average; {} void first views drawn again",
            100.0 * mean,
            summary.void_episodes
        );
    }
    for path in &summary.damaged {
        let _ = writeln!(text, "damaged and made anew: {}", path.display());
    }
    if !summary.skipped.is_empty() {
        let _ = writeln!(text, "{} objects skipped:", summary.skipped.len());
        for (name, reason) in summary.skipped.iter().take(20) {
            let _ = writeln!(text, "  {name}: {reason}");
        }
        if summary.skipped.len() > 20 {
            let _ = writeln!(text, "  ... all of them in {}", out.join("manifest.json").display());
        }
    }
    if summary.left > 0 {
        let _ = writeln!(text, "stopped: {} objects left; the same command resumes from here", summary.left);
    } else {
        let _ = writeln!(text, "look inside with: datagen inspect {}", out.display());
    }
    print(text)
}

fn verify(directory: &std::path::Path, json: bool) -> anyhow::Result<ExitCode> {
    let verdict = crate::verify::verify(directory)?;
    if json {
        print_line(serde_json::to_string(&verdict)?)?;
    } else {
        print_line(format_args!(
            "{} intact shards with {} samples, {} intact surfaces, {} objects skipped",
            verdict.shards, verdict.samples, verdict.surfaces, verdict.skipped
        ))?;
        for problem in &verdict.problems {
            print_line(format_args!("problem: {problem}"))?;
        }
        for note in &verdict.notes {
            print_line(format_args!("note: {note}"))?;
        }
        if !verdict.missing.is_empty() {
            print_line(format_args!("{} objects are missing, e.g. {}", verdict.missing.len(), verdict.missing[0]))?;
        }
    }
    Ok(if verdict.is_sound() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn inspect(directory: &std::path::Path, json: bool) -> anyhow::Result<ExitCode> {
    let inspection = crate::inspect::inspect(directory)?;
    if json {
        print_line(serde_json::to_string(&inspection)?)?;
    } else {
        print_line(inspection)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn import(inputs: &[PathBuf], out: &std::path::Path, validation_share: f64, seed: u64) -> anyhow::Result<ExitCode> {
    let manifest = crate::history::import(inputs, out, validation_share, seed, built::COMMIT)?;
    print_line(format_args!(
        "{} objects, {} samples in {}",
        manifest.objects.len(),
        manifest.num_samples(),
        out.display()
    ))?;
    Ok(ExitCode::SUCCESS)
}

fn export(directory: &std::path::Path, out: &std::path::Path) -> anyhow::Result<ExitCode> {
    let (files, left_out) = crate::history::export(directory, out)?;
    print_line(format_args!("{files} files in {}", out.display()))?;
    if left_out > 0 {
        print_line(format_args!("{left_out} samples left out: the format takes exactly 20 candidates"))?;
    }
    Ok(ExitCode::SUCCESS)
}
