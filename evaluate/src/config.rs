//! Settings of `evaluate`; `configs/evaluate.toml` shows every one at its default.

pub(crate) mod differences;

use crate::policies::see::SeeConfig;
use datagen::EpisodeConfig;
use datagen::config::check_counts;
use datagen::dataset::{DatasetConfig, DatasetName};
use formats::ConfigError;
use formats::config::SettingError;
use planning::{CandidateConfig, RobotConfig, VolumetricConfig};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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

/// Stands in the hash of the settings for any `views_if_unreached`: its default when it did not follow `episode.num_views`, so
/// that runs of that time can be resumed.
const HASHED_VIEWS_IF_UNREACHED: usize = 17;

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
    /// What a level of coverage that was never reached counts as, in views; absent: two more than `episode.num_views`, which is
    /// one more than there are with the first scan.
    pub views_if_unreached: Option<usize>,
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
            views_if_unreached: None,
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
            views_if_unreached: Some(16),
            episode: EpisodeConfig::paper(),
            candidates: CandidateConfig::paper(),
            ..Self::default()
        }
    }

    /// What a level of coverage that was never reached counts as, in views.
    pub fn views_if_unreached(&self) -> usize {
        self.views_if_unreached.unwrap_or(self.episode.num_views + 2)
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
        let (unreached, num_views) = (self.views_if_unreached(), self.episode.num_views);
        if unreached <= num_views {
            return Err(SettingError::new(
                "views_if_unreached",
                format!("{unreached} with episode.num_views = {num_views}"),
                "at least one more than episode.num_views, or nothing: two more is the default",
            ));
        }
        check_candidates("candidates.tilts_deg", &self.candidates)?;
        check_candidates("volumetric.candidates.tilts_deg", &self.volumetric.candidates)?;
        let planner = &self.volumetric;
        let share = |key, value: f64| match (0.0..=1.0).contains(&value) {
            true => Ok(()),
            false => Err(SettingError::new(key, value, "a share from 0 to 1")),
        };
        share("volumetric.min_overlap", planner.min_overlap)?;
        share("volumetric.weight_center", planner.weight_center)?;
        share("volumetric.novelty", planner.novelty)?;
        if !(planner.voxel_px > 0.0 && planner.voxel_px.is_finite()) {
            return Err(SettingError::new("volumetric.voxel_px", planner.voxel_px, "a number of pixels above 0"));
        }
        self.see.validate()?;
        check_counts(&[
            ("episodes", self.episodes),
            ("surface_samples", self.surface_samples),
            ("views_if_unreached", unreached),
            ("resamples", self.resamples),
            ("candidates.num_targets", self.candidates.num_targets),
            ("volumetric.candidates.num_targets", planner.candidates.num_targets),
            ("table.views", self.table.as_ref().map_or(1, |table| table.views)),
        ])
    }

    /// Hash of what outcomes depend on: everything but which policies, objects and episodes are run, where the objects lie and how
    /// results are reported. Each episode notes the files of its object.
    ///
    /// # Errors
    /// As [`formats::config::hash`].
    pub fn outcome_hash(&self) -> Result<String, ConfigError> {
        formats::config::hash(&self.without_place())
    }

    /// [`EvaluateConfig::outcome_hash`] of older programs, whose episodes note no files: with the place of the objects.
    ///
    /// # Errors
    /// As [`formats::config::hash`].
    pub fn placed_hash(&self) -> Result<String, ConfigError> {
        formats::config::hash(&match self.dataset.name {
            DatasetName::Procedural => self.without_place(),
            _ => self.of_outcomes(),
        })
    }

    /// The settings that a run's directory keeps, unless they are damaged or too old to be read.
    pub(crate) fn kept_in(directory: &Path) -> Option<Self> {
        let path = directory.join("config.toml");
        formats::config::check_stored(&path).ok()?;
        formats::config::load(Some(&path), &[], &[]).ok()
    }

    /// Lines that say which settings that outcomes depend on have another value in `now`. The place of the objects alone matters
    /// to results of older programs.
    pub(crate) fn differences(&self, now: &Self) -> String {
        let mut found = differences::between(&self.without_place(), &now.without_place());
        if found.is_empty() {
            found = differences::between(&self.of_outcomes(), &now.of_outcomes());
        }
        found.iter().map(ToString::to_string).collect()
    }

    /// What outcomes depend on where the objects lie elsewhere; all else at its default.
    fn without_place(&self) -> Self {
        let dataset = DatasetConfig { root: None, ..self.dataset.clone() };
        Self { dataset, ..self.of_outcomes() }
    }

    /// What outcomes depend on; all else at its default.
    fn of_outcomes(&self) -> Self {
        let Self { policies, baseline, episodes, resamples, only, .. } = Self::default();
        // The CPU is what an absent device stands for.
        let device = self.weights.device.clone().filter(|name| name != "cpu");
        let weights = WeightsConfig { device, ..self.weights.clone() };
        Self {
            policies,
            baseline,
            episodes,
            views_if_unreached: Some(HASHED_VIEWS_IF_UNREACHED),
            resamples,
            only,
            weights,
            ..self.clone()
        }
    }
}

/// Refuses candidates that look nowhere.
fn check_candidates(key: &'static str, candidates: &CandidateConfig) -> Result<(), SettingError> {
    let tilts = &candidates.tilts_deg;
    if tilts.is_empty() || tilts.iter().any(|tilt| !tilt.is_finite()) {
        return Err(SettingError::new(key, format!("{tilts:?}"), "one angle at least, degrees, such as [-45, 0, 45]"));
    }
    Ok(())
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
