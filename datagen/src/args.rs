//! The command line of `datagen`.

use crate::config::DatagenConfig;
use clap::{Args, Parser, Subcommand};
use formats::Flag;
use formats::program::{CommonArgs, EXIT_CODES, length, seed, share};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  datagen                                          20 built-in objects, into runs/data/procedural
  datagen --dataset modelnet40 --per-category 20   meshes under data/modelnet40
  datagen --dataset folder --root my/meshes --out runs/data/mine --distance 0.8
  datagen verify runs/data/mine                    check every byte
  datagen inspect runs/data/mine                   show what is inside

An interrupted run resumes with the same command. ";

/// Scans meshes in simulation and writes training data: next-best-view decisions of the paper's search
#[derive(Parser)]
#[command(
    args_conflicts_with_subcommands = true,
    version = built::VERSION,
    after_help = format!("{EXAMPLES}{EXIT_CODES}")
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub run: RunArgs,
}

#[derive(Subcommand)]
pub enum Command {
    /// Check every file of a set: shards, surfaces and settings against checksums and manifest
    Verify {
        /// Directory of the set
        directory: PathBuf,
        /// Print the result as JSON
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
    /// Turn the authors' frame histories (.bin) into a set, or add them to one
    Import {
        /// Files, or directories of files; each object is named after its file
        #[arg(required = true)]
        inputs: Vec<PathBuf>,
        /// Directory of the set; objects are added to an imported set that is there
        #[arg(long)]
        out: PathBuf,
        /// Share of the objects set aside for validation
        #[arg(long, value_name = "SHARE", default_value_t = 0.2, value_parser = share)]
        validation_share: f64,
        /// Seed that decides which objects are set aside
        #[arg(long, default_value_t = 0, value_parser = seed)]
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
pub struct RunArgs {
    /// Data set: procedural (built in), modelnet40, shapenet, repository3d or folder
    #[arg(long, value_name = "NAME")]
    pub dataset: Option<String>,
    /// Directory of the data set [default: data/<NAME>]
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Output directory [default: runs/data/<NAME>, with -test for the test half]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Half of the data set: train or test; a folder has no test half [default: train]
    #[arg(long, value_name = "HALF")]
    pub split: Option<String>,
    /// Number of objects from each category
    #[arg(long, value_name = "N")]
    pub per_category: Option<u32>,
    /// Use exactly the models listed in this file, one per line
    #[arg(long, value_name = "FILE")]
    pub list: Option<PathBuf>,
    /// Number of objects [default: all; 20 for procedural]
    #[arg(long, value_name = "N")]
    pub objects: Option<u32>,
    /// Print the objects that would be used, and exit
    #[arg(long, conflicts_with_all = ["out", "part", "json"])]
    pub list_objects: bool,
    /// Next views per object [default: 15]
    #[arg(long, value_name = "N")]
    pub scans: Option<u32>,
    /// Boundary targets per decision [default: 20]
    #[arg(long, value_name = "N")]
    pub candidates: Option<u32>,
    /// Distance from target to camera, metres [default: 1.2]
    #[arg(long, value_name = "M", value_parser = length)]
    pub distance: Option<f64>,
    /// Part of the objects to process, 0/4 to 3/4 for four parts; detected in Slurm arrays and Kubernetes indexed jobs
    #[arg(long, value_name = "I/N")]
    pub part: Option<String>,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub common: CommonArgs,
}

impl RunArgs {
    /// The settings: defaults, then the file, then `--set`, then flags.
    pub fn settings(&self) -> anyhow::Result<DatagenConfig> {
        let text = |path: &Option<PathBuf>| path.as_ref().map(|p| p.to_string_lossy().into_owned());
        let config: DatagenConfig = self.common.settings([
            Flag::given("--dataset", "dataset.name", self.dataset.clone()),
            Flag::given("--root", "dataset.root", text(&self.root)),
            Flag::given("--split", "dataset.split", self.split.clone()),
            Flag::given("--per-category", "dataset.per_category", self.per_category),
            Flag::given("--list", "dataset.list", text(&self.list)),
            Flag::given("--objects", "dataset.objects", self.objects),
            Flag::given("--scans", "episode.num_views", self.scans),
            Flag::given("--candidates", "candidates.num_targets", self.candidates),
            Flag::given("--distance", "episode.working_distance_m", self.distance),
        ])?;
        config.validate()?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests;
