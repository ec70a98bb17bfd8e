//! Settings of data generation; `configs/datagen.toml` spells them out.

use crate::dataset::{DatasetConfig, DatasetName, SplitChoice};
use crate::episode::EpisodeConfig;
use crate::search::SearchConfig;
use formats::CloudPrecision;
use formats::config::SettingError;
use planning::CandidateConfig;
use serde::{Deserialize, Serialize};

/// Settings of data generation. The output follows from them, the meshes and the commit alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DatagenConfig {
    /// Every random number follows from it (0).
    pub seed: u64,
    /// Diagonal of the bounding box that every object is scaled to, metres (0.2).
    pub object_diagonal_m: f64,
    /// Points of the reference surface, by Poisson-disk sample elimination (60,000).
    pub surface_samples: usize,
    /// Share of a training set's objects that are set aside for validation (0.2).
    pub validation_share: f64,
    /// How clouds are stored, `f32` or `f16` (f32).
    pub cloud_precision: CloudPrecision,
    /// Keep the reference surfaces beside the shards, so that they are sampled once (true).
    pub keep_surface_samples: bool,
    /// Which objects.
    pub dataset: DatasetConfig,
    /// How they are scanned.
    pub episode: EpisodeConfig,
    /// Where to look next.
    pub candidates: CandidateConfig,
}

impl Default for DatagenConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            object_diagonal_m: 0.2,
            surface_samples: 60_000,
            validation_share: 0.2,
            cloud_precision: CloudPrecision::F32,
            keep_surface_samples: true,
            dataset: DatasetConfig::default(),
            episode: EpisodeConfig::default(),
            candidates: CandidateConfig::default(),
        }
    }
}

impl DatagenConfig {
    /// Settings of the search.
    pub fn search(&self) -> SearchConfig {
        SearchConfig::of(&self.episode, self.candidates.clone())
    }

    /// What makes two sets the same: all settings but where the meshes lie.
    pub fn without_places(&self) -> Self {
        let mut config = self.clone();
        config.dataset.root = None;
        config
    }

    /// Refuses values that cannot be meant.
    ///
    /// # Errors
    /// The key, what was found, and what was expected.
    pub fn validate(&self) -> Result<(), SettingError> {
        if !(self.object_diagonal_m > 0.0 && self.object_diagonal_m.is_finite()) {
            return Err(SettingError::new("object_diagonal_m", self.object_diagonal_m, "a length above 0"));
        }
        self.episode.validate()?;
        if !(0.0..1.0).contains(&self.validation_share) {
            return Err(SettingError::new("validation_share", self.validation_share, "0 or more, and under 1"));
        }
        check_counts(&[
            ("surface_samples", self.surface_samples),
            ("candidates.num_targets", self.candidates.num_targets),
            ("candidates.boundary.neighbors", self.candidates.boundary.neighbors),
        ])?;
        if self.candidates.tilts_deg.is_empty() {
            return Err(SettingError::new("candidates.tilts_deg", "[]", "at least one angle"));
        }
        if let Some(tilt) = self.candidates.tilts_deg.iter().find(|tilt| !tilt.is_finite()) {
            return Err(SettingError::new("candidates.tilts_deg", tilt, "angles in degrees, such as [-45, 0, 45]"));
        }
        if self.dataset.name == DatasetName::Folder && self.dataset.split == Some(SplitChoice::Test) {
            let expected = "train, or none: a folder has no halves, and its test half would be the objects of its training set; \
                            put test meshes in a folder of their own, for `evaluate --dataset folder --root DIR`";
            return Err(SettingError::new("dataset.split", "test", expected));
        }
        Ok(())
    }
}

/// A mistyped count must not ask for all memory there is.
const MOST: usize = 10_000_000;

/// Refuses counts of nothing and of more than any use.
///
/// # Errors
/// The first such count, by its key.
pub fn check_counts(counts: &[(&'static str, usize)]) -> Result<(), SettingError> {
    match counts.iter().find(|(_, count)| !(1..=MOST).contains(count)) {
        Some((key, count)) => Err(SettingError::new(key, count, "1 to 10,000,000")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests;
