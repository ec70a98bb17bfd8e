//! Settings of `evaluate`; `configs/evaluate.toml` shows every one at its default.

use crate::policies::see::SeeConfig;
use datagen::EpisodeConfig;
use datagen::config::check_counts;
use datagen::dataset::{DatasetConfig, DatasetName};
use formats::config::SettingError;
use planning::{CandidateConfig, RobotConfig, VolumetricConfig};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Where the reference surface comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// Poisson-disk samples of the mesh.
    #[default]
    Sampled,
    /// The authors' own samples, `<name>_simple60k.npy` beside the mesh, where there are any; else `sampled`.
    Published,
}

/// The object stands on a table: its least z. Cameras below the table's top are out of reach, and surface that no
/// camera above it sees is no part of the reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TableConfig {
    /// Least height of a camera above the table's top, metres.
    pub clearance_m: f64,
    /// Views over the upper half of the sphere that decide what can be seen.
    pub views: usize,
}

impl Default for TableConfig {
    fn default() -> Self {
        Self { clearance_m: 0.02, views: 300 }
    }
}

/// What is known of a recorded sequence beside its own file, which it is laid over.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SequenceConfig {
    /// Distance under which a point of the union of all scans is covered, metres.
    pub tolerance_m: Option<f64>,
    /// The object is in this box, metres: of whole depth images the rest is left out.
    pub region_m: Option<[[f64; 3]; 2]>,
    /// Whether pixels without a return show what is behind the object.
    pub background: Option<bool>,
}

/// Checkpoint directories of the networks; empty: the weights that come with the program's source.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WeightsConfig {
    /// For `benbv-net`.
    pub benbv_net: PathBuf,
    /// For `pc-nbv`.
    pub pc_nbv: PathBuf,
    /// The JSON file for `volumetric:learned`; none comes with the source.
    pub forecasts: PathBuf,
    /// Device of the networks; absent: the CPU. Another one rounds differently, and so makes other outcomes.
    pub device: Option<String>,
}

/// All settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EvaluateConfig {
    /// Which objects. `modelnet40` and `shapenet`: their test halves, unless `split` says otherwise.
    pub dataset: DatasetConfig,
    /// Of these only the ones with these names; empty: all.
    pub only: Vec<String>,
    /// Policies; `all` stands for every one that can run here.
    pub policies: Vec<String>,
    /// Policy that the others are compared with.
    pub baseline: String,
    /// Episodes per object and policy.
    pub episodes: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Diagonal of the object's bounding box, metres.
    pub diagonal_m: f64,
    /// Where the reference surface comes from.
    pub surface: Surface,
    /// Number of its samples.
    pub surface_samples: usize,
    /// Views around the object of which one at least must see a sample, or it is left out: CAD models have faces inside that no
    /// camera ever sees. 0 keeps all, as published.
    pub reference_views: usize,
    /// What a level of coverage that was never reached counts as, in views.
    pub views_if_unreached: usize,
    /// Resamples of the confidence intervals.
    pub resamples: usize,
    /// The scanning loop and the simulator.
    pub episode: EpisodeConfig,
    /// Candidate views of the policies that use BENBV's.
    pub candidates: CandidateConfig,
    /// Settings of `volumetric`.
    pub volumetric: VolumetricConfig,
    /// Parameters of `see`.
    pub see: SeeConfig,
    /// The object on a table; absent: it floats.
    pub table: Option<TableConfig>,
    /// An arm that carries the camera, the object in the origin of its cell: for each episode, how far its joints travel, and how
    /// many views it cannot take.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotConfig>,
    /// Recorded sequences by name.
    pub sequences: BTreeMap<String, SequenceConfig>,
    /// Checkpoints.
    pub weights: WeightsConfig,
}

impl Default for EvaluateConfig {
    fn default() -> Self {
        Self {
            dataset: DatasetConfig { name: DatasetName::Repository3d, ..DatasetConfig::default() },
            only: Vec::new(),
            policies: vec!["all".to_owned()],
            baseline: "benbv".to_owned(),
            episodes: 60,
            seed: 0,
            diagonal_m: 0.2,
            surface: Surface::Sampled,
            surface_samples: 60_000,
            reference_views: 0,
            views_if_unreached: 17,
            resamples: 2000,
            episode: EpisodeConfig::default(),
            candidates: CandidateConfig::default(),
            volumetric: VolumetricConfig::default(),
            see: SeeConfig::default(),
            table: None,
            robot: None,
            sequences: BTreeMap::new(),
            weights: WeightsConfig::default(),
        }
    }
}

impl EvaluateConfig {
    /// The publication's simulator, policies and counting.
    pub fn paper() -> Self {
        Self {
            surface: Surface::Published,
            views_if_unreached: 16,
            episode: EpisodeConfig::paper(),
            candidates: CandidateConfig::paper(),
            ..Self::default()
        }
    }

    /// Refuses values that cannot be meant.
    ///
    /// # Errors
    /// The key, what was found, and what was expected.
    pub fn validate(&self) -> Result<(), SettingError> {
        if !(self.diagonal_m > 0.0 && self.diagonal_m.is_finite()) {
            return Err(SettingError::new("diagonal_m", self.diagonal_m, "a length above 0"));
        }
        self.episode.validate()?;
        if let Some(robot) = &self.robot {
            robot.check().map_err(|e| SettingError::new(e.key, e.found, e.expected))?;
        }
        check_counts(&[
            ("episodes", self.episodes),
            ("surface_samples", self.surface_samples),
            ("views_if_unreached", self.views_if_unreached),
            ("resamples", self.resamples),
            ("candidates.num_targets", self.candidates.num_targets),
            ("table.views", self.table.as_ref().map_or(1, |table| table.views)),
        ])
    }

    /// Hash of what outcomes depend on: everything but which policies and episodes are run and how they are reported.
    pub fn outcome_hash(&self) -> Result<String, formats::ConfigError> {
        let Self { policies, baseline, episodes, views_if_unreached, resamples, only, .. } = Self::default();
        // The CPU is what an absent device stands for.
        let device = self.weights.device.clone().filter(|name| name != "cpu");
        let weights = WeightsConfig { device, ..self.weights.clone() };
        formats::config::hash(&Self {
            policies,
            baseline,
            episodes,
            views_if_unreached,
            resamples,
            only,
            weights,
            ..self.clone()
        })
    }
}

/// The same settings with the publication's as defaults: what `--preset paper` starts from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PaperConfig(pub EvaluateConfig);

impl Default for PaperConfig {
    fn default() -> Self {
        Self(EvaluateConfig::paper())
    }
}

#[cfg(test)]
mod tests;
