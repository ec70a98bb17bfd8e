//! The command line of `evaluate`.

use crate::config::{EvaluateConfig, PaperConfig};
use clap::Parser;
use formats::config::Flag;
use formats::program::{CommonArgs, EXIT_CODES, length};
use formats::urdf::{UrdfArm, read_urdf};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  evaluate --dataset procedural --objects 2 --episodes 2 --policies auto,farthest
  evaluate --dataset repository3d --root DIR --policies benbv,see,farthest --out runs/eval/default
  evaluate --dataset repository3d --root DIR --preset paper --out runs/eval/paper
  evaluate --compare runs/eval/default runs/eval/paper

An interrupted run resumes with the same command. Policies, metrics and tables: docs/evaluation.md. ";

/// Compares next-best-view policies in simulation and on recorded scans, with confidence intervals
#[derive(Parser)]
#[command(version = built::VERSION, after_help = format!("{EXAMPLES}{EXIT_CODES}"))]
pub struct Args {
    /// Objects: repository3d, folder, modelnet40, shapenet, procedural; or recorded scans: sequences
    #[arg(long, value_name = "NAME")]
    pub dataset: Option<String>,
    /// Directory of the set [default: data/<dataset>]
    #[arg(long, value_name = "DIR")]
    pub root: Option<String>,
    /// Only these objects, by name
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub only: Option<Vec<String>>,
    /// Number of objects to use [default: all; 20 for procedural]
    #[arg(long, value_name = "COUNT")]
    pub objects: Option<u32>,
    /// Policies by name; `all` for every policy that suits the data set (see --list-policies)
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub policies: Option<Vec<String>>,
    /// Episodes per object and policy; at most one per start of a recorded sequence [default: 60]
    #[arg(long, value_name = "COUNT")]
    pub episodes: Option<u32>,
    /// Directory of the results [default: runs/evaluate]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Use the publication's simulator, policies and way of counting, and print its values beside ours
    #[arg(long, value_parser = ["paper"])]
    pub preset: Option<String>,
    /// Distance from target to camera, metres [default: 1.2]
    #[arg(long, value_name = "METRES", value_parser = length)]
    pub distance: Option<f64>,
    /// An arm that carries the camera, as a URDF: adds joint travel and views out of reach to the tables. Where its base and the
    /// camera on it are: [robot] in the settings
    #[arg(long, value_name = "FILE", requires = "tool")]
    pub robot: Option<PathBuf>,
    /// Link of the arm that the camera is mounted on
    #[arg(long, value_name = "LINK", requires = "robot")]
    pub tool: Option<String>,
    /// Device for the networks: cpu, or a GPU backend that was compiled in (wgpu, cuda) [default: cpu]
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Policy to compare the others with [default: benbv]
    #[arg(long, value_name = "POLICY")]
    pub baseline: Option<String>,
    /// Compare result directories with the first one instead of running anything
    #[arg(long, num_args = 2.., value_name = "DIR", conflicts_with_all = [
        "dataset", "root", "only", "objects", "policies", "episodes", "preset", "distance", "robot", "device", "list_policies", "json",
        "config", "set", "seed", "jobs",
    ])]
    pub compare: Vec<PathBuf>,
    /// List the policies
    #[arg(long, conflicts_with_all = ["dataset", "root", "only", "objects", "policies", "episodes", "distance", "robot", "device", "out", "json"])]
    pub list_policies: bool,
    /// Print the rows of the tables as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub common: CommonArgs,
}

impl Args {
    /// Directory of the results of a run.
    pub fn results(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new("runs/evaluate"))
    }

    /// The settings: defaults or the publication's, then the file, then `--set`, then flags.
    pub fn settings(&self) -> anyhow::Result<EvaluateConfig> {
        let arm = match (&self.robot, &self.tool) {
            (Some(file), Some(tool)) => {
                let UrdfArm { arm, notes } = read_urdf(file, tool)?;
                notes.iter().for_each(|note| tracing::warn!("{file:?}: {note}"));
                Some(toml::Value::try_from(arm)?)
            }
            _ => None,
        };
        let flags = [
            Flag::given("--dataset", "dataset.name", self.dataset.clone()),
            Flag::given("--root", "dataset.root", self.root.clone()),
            Flag::given("--objects", "dataset.objects", self.objects),
            Flag::given("--only", "only", self.only.clone()),
            Flag::given("--policies", "policies", self.policies.clone()),
            Flag::given("--episodes", "episodes", self.episodes),
            Flag::given("--distance", "episode.working_distance_m", self.distance),
            Flag::given("--robot", "robot.arm", arm),
            Flag::given("--device", "weights.device", self.device.clone()),
            Flag::given("--baseline", "baseline", self.baseline.clone()),
        ];
        match self.preset {
            Some(_) => Ok(self.common.settings::<PaperConfig>(flags)?.0),
            None => Ok(self.common.settings(flags)?),
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
        assert_eq!((config.seed, config.episodes, config.views_if_unreached()), (9_007_199_254_740_993, 3, 16));
    }
}
