//! What became of every object of a set; `manifest.json` beside the shards.

use crate::error::Place;
use crate::run::atomic_write;
use crate::{FormatError, ShardReader};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the manifest in the directory of a set.
pub const MANIFEST: &str = "manifest.json";

/// What an object's samples are for. Objects, never samples, are split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training.
    #[default]
    Train,
    /// Choosing a model while training.
    Validation,
    /// Judging the chosen model.
    Test,
}

/// What became of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "fate", rename_all = "snake_case", deny_unknown_fields)]
pub enum Fate {
    /// Its episode is in a shard.
    Done {
        /// The shard, relative to the set's directory.
        shard: String,
        /// Number of samples.
        samples: usize,
        /// Coverage after each scan, the first one included.
        coverage: Vec<f64>,
        /// Overlap of each next view's scan with the cloud before it.
        overlap: Vec<f64>,
        /// Episodes that were void (docs/method.md, 'Setting') and drawn again.
        void_episodes: usize,
    },
    /// It cannot be used.
    Skipped {
        /// Why, with file and place.
        reason: String,
    },
    /// Not made yet: another part's share, or the run was stopped.
    Missing,
}

/// An object with its part in the set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectRecord {
    /// Name, e.g. `airplane/airplane_0001`.
    pub object: String,
    /// Category, or the data set's name where it has none.
    pub category: String,
    /// What its samples are for.
    pub split: Split,
    /// What became of it.
    #[serde(flatten)]
    pub fate: Fate,
}

/// All objects of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`crate::shard::SCHEMA_VERSION`] of the shards.
    pub schema_version: u32,
    /// Name of the data set, e.g. `modelnet40`.
    pub dataset: String,
    /// [`crate::config::hash`] of the settings.
    pub config_hash: String,
    /// The run's seed.
    pub seed: u64,
    /// Commit of the source tree.
    pub commit: String,
    /// The objects in the order of the work list.
    pub objects: Vec<ObjectRecord>,
}

impl Manifest {
    /// Reads `manifest.json` of a set.
    ///
    /// # Errors
    /// No such file, or one that is no manifest.
    pub fn read(directory: &Path) -> Result<Self, FormatError> {
        let path = directory.join(MANIFEST);
        let text = std::fs::read_to_string(&path).map_err(|e| FormatError::io(&path, "read", e))?;
        serde_json::from_str(&text).map_err(|e| {
            FormatError::syntax(&path, Place::Line(e.line()), e.to_string(), "a manifest as datagen writes it")
        })
    }

    /// Writes `manifest.json` of a set, whole or not at all.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn write(&self, directory: &Path) -> Result<(), FormatError> {
        let path = directory.join(MANIFEST);
        let mut text = serde_json::to_string_pretty(self)
            .map_err(|e| FormatError::syntax(&path, Place::File, e.to_string(), "what JSON can say"))?;
        text.push('\n');
        atomic_write(&path, text.as_bytes())
    }

    /// Number of samples in all shards.
    pub fn num_samples(&self) -> usize {
        self.objects.iter().map(|o| if let Fate::Done { samples, .. } = o.fate { samples } else { 0 }).sum()
    }

    /// Paths of the shards of a split, in the order of the work list.
    pub fn shards(&self, directory: &Path, split: Split) -> Vec<PathBuf> {
        let of = |o: &ObjectRecord| match &o.fate {
            Fate::Done { shard, .. } if o.split == split => Some(directory.join(shard)),
            _ => None,
        };
        self.objects.iter().filter_map(of).collect()
    }

    /// Opens the shards of a split.
    ///
    /// # Errors
    /// The first shard that cannot be opened.
    pub fn open(&self, directory: &Path, split: Split) -> Result<Vec<ShardReader>, FormatError> {
        self.shards(directory, split).iter().map(|p| ShardReader::open(p)).collect()
    }
}
