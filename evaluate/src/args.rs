//! The command line of `evaluate`.

use crate::config::{EvaluateConfig, PaperConfig};
use clap::Parser;
use formats::config::{ConfigError, Flag};
use formats::program::{CommonArgs, EXIT_CODES, length};
use std::path::PathBuf;

/// Runs next-best-view policies on simulated objects and reports the paper's metrics with confidence intervals.
///
/// A run can be stopped at any moment and resumes with the same command. Example:
///   evaluate --dataset repository3d --root data/repository3d --policies benbv,see,farthest --out runs/eval/first
#[derive(Parser)]
#[command(version = built::VERSION, verbatim_doc_comment, after_help = EXIT_CODES)]
pub struct Args {
    /// Set of objects: repository3d, folder, modelnet40, shapenet, procedural, or recorded scans: sequences
    #[arg(long)]
    pub dataset: Option<String>,
    /// Directory of the set [default: data/<dataset>]
    #[arg(long)]
    pub root: Option<String>,
    /// Only these objects, by name
    #[arg(long, value_delimiter = ',')]
    pub only: Option<Vec<String>>,
    /// Take this many objects of the set [default: all; 20 of procedural]
    #[arg(long)]
    pub objects: Option<u32>,
    /// Policies, by name; `all` for every one that goes with the set (see --list-policies)
    #[arg(long, value_delimiter = ',')]
    pub policies: Option<Vec<String>>,
    /// Episodes per object and policy; of a recorded sequence one of each start at most [default: 60]
    #[arg(long)]
    pub episodes: Option<u32>,
    /// Directory of the results
    #[arg(long, default_value = "runs/evaluate")]
    pub out: PathBuf,
    /// Start from the publication's simulator, policies and counting instead of the correct defaults
    #[arg(long, value_parser = ["paper"])]
    pub preset: Option<String>,
    /// Distance from target to camera, metres [default: 1.2]
    #[arg(long, value_name = "METRES", value_parser = length)]
    pub distance: Option<f64>,
    /// Device of the networks: cpu, or a GPU backend that was compiled in (wgpu, cuda) [default: cpu]
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Policy that the others are compared with [default: benbv]
    #[arg(long)]
    pub baseline: Option<String>,
    /// Compare result directories, the first being the reference, instead of running anything
    #[arg(long, num_args = 2.., value_name = "DIR", conflicts_with_all = [
        "dataset", "root", "only", "objects", "policies", "episodes", "preset", "distance", "device", "list_policies", "json",
        "config", "set", "seed", "jobs",
    ])]
    pub compare: Vec<PathBuf>,
    /// List the policies
    #[arg(long, conflicts_with_all = ["dataset", "root", "only", "objects", "policies", "episodes", "distance", "device", "out", "json"])]
    pub list_policies: bool,
    /// Print the rows of the tables as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub common: CommonArgs,
}

impl Args {
    /// The settings: defaults or the publication's, then the file, then `--set`, then flags.
    pub fn settings(&self) -> Result<EvaluateConfig, ConfigError> {
        let flags = [
            Flag::given("--dataset", "dataset.name", self.dataset.clone()),
            Flag::given("--root", "dataset.root", self.root.clone()),
            Flag::given("--objects", "dataset.objects", self.objects),
            Flag::given("--only", "only", self.only.clone()),
            Flag::given("--policies", "policies", self.policies.clone()),
            Flag::given("--episodes", "episodes", self.episodes),
            Flag::given("--distance", "episode.working_distance_m", self.distance),
            Flag::given("--device", "weights.device", self.device.clone()),
            Flag::given("--baseline", "baseline", self.baseline.clone()),
        ];
        match self.preset {
            Some(_) => Ok(self.common.settings::<PaperConfig>(flags)?.0),
            None => self.common.settings(flags),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Args::command().debug_assert();
        let args = ["evaluate", "--seed", "9007199254740993", "--episodes", "3", "--preset", "paper"];
        let args: Args = formats::program::parse_from(args.map(Into::into)).expect("good");
        let config = args.settings().expect("settings");
        assert_eq!((config.seed, config.episodes, config.views_if_unreached), (9_007_199_254_740_993, 3, 16));
    }
}
