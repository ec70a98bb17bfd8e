//! The outcome for every object of a set; `manifest.json` beside the shards.

use crate::error::{Place, REMAKE};
use crate::run::atomic_write;
use crate::{FormatError, ShardReader, checksum};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the manifest in the directory of a set.
pub const MANIFEST: &str = "manifest.json";

/// What stands before the digits of its checksum.
const CHECKSUM: &[u8] = b"\"sha256\": \"";

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

/// Whether an object is in the set, and if not, why. The tag on disk is `fate`, as sets made so far have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "fate", rename_all = "snake_case", deny_unknown_fields)]
pub enum ObjectStatus {
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
    /// In the set, skipped or missing.
    #[serde(flatten)]
    pub status: ObjectStatus,
}

/// Why an object has no shard, in a file of its own.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SkippedFile {
    /// Of the file. Absent in those of older programs.
    #[serde(default)]
    sha256: String,
    object: String,
    category: String,
    split: Split,
    fate: Skipped,
    reason: String,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Skipped {
    Skipped,
}

/// Writes why an object has no shard, whole or not at all.
///
/// # Errors
/// What the operating system refuses.
pub fn write_skipped(path: &Path, object: &str, category: &str, split: Split, reason: &str) -> Result<(), FormatError> {
    let [object, category, reason] = [object, category, reason].map(str::to_owned);
    let file =
        SkippedFile { sha256: checksum::UNKNOWN.to_owned(), object, category, split, fate: Skipped::Skipped, reason };
    write_sealed(path, &file)
}

/// Reads what [`write_skipped`] wrote.
///
/// # Errors
/// No such file, or damage.
pub fn read_skipped(path: &Path) -> Result<ObjectRecord, FormatError> {
    let bytes = crate::file::read(path)?;
    let file: SkippedFile = serde_json::from_slice(&bytes).map_err(|e| {
        FormatError::syntax(path, Place::Line(e.line()), e.to_string(), "a skipped object as datagen writes it")
    })?;
    if !file.sha256.is_empty() {
        checksum::check(path, &bytes, CHECKSUM, REMAKE)?;
    }
    let SkippedFile { object, category, split, reason, .. } = file;
    Ok(ObjectRecord { object, category, split, status: ObjectStatus::Skipped { reason } })
}

/// Writes JSON with its checksum filled in.
fn write_sealed(path: &Path, content: &impl Serialize) -> Result<(), FormatError> {
    let mut bytes = serde_json::to_vec_pretty(content)
        .map_err(|e| FormatError::syntax(path, Place::File, e.to_string(), "what JSON can say"))?;
    bytes.push(b'\n');
    checksum::seal(&mut bytes, CHECKSUM);
    atomic_write(path, &bytes)
}

/// All objects of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`crate::shard::SCHEMA_VERSION`] of the shards.
    pub schema_version: u32,
    /// Checksum of the file ([`crate::checksum`]); filled in by [`Manifest::write`]. Absent in sets of older programs.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub sha256: String,
    /// Name of the data set, e.g. `modelnet40`.
    pub dataset: String,
    /// [`crate::config::hash`] of the settings.
    pub config_hash: String,
    /// The run's seed.
    pub seed: u64,
    /// Commit of the source tree; of a set that several versions made, all of them.
    pub commit: String,
    /// The objects in the order of the work list.
    pub objects: Vec<ObjectRecord>,
}

impl Manifest {
    /// Reads `manifest.json` of a set.
    ///
    /// # Errors
    /// No such file (of a set that was begun: that it is not finished), or one that is no manifest.
    pub fn read(directory: &Path) -> Result<Self, FormatError> {
        let path = directory.join(MANIFEST);
        if !path.exists() && begun(directory) {
            let expected =
                "a finished set: `datagen` was interrupted here; run the same `datagen` command again to finish it";
            return Err(FormatError::syntax(directory, Place::File, format!("no {MANIFEST}"), expected));
        }
        let bytes = crate::file::read(&path)?;
        let manifest: Self = serde_json::from_slice(&bytes).map_err(|e| {
            FormatError::syntax(&path, Place::Line(e.line()), e.to_string(), "a manifest as datagen writes it")
        })?;
        if manifest.sha256.is_empty() {
            tracing::warn!("{path:?} has no checksum: an older program wrote it; damage would go unnoticed");
        } else {
            checksum::check(&path, &bytes, CHECKSUM, REMAKE)?;
        }
        Ok(manifest)
    }

    /// Writes `manifest.json` of a set, whole or not at all.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn write(&self, directory: &Path) -> Result<(), FormatError> {
        let path = directory.join(MANIFEST);
        write_sealed(&path, &Self { sha256: checksum::UNKNOWN.to_owned(), ..self.clone() })
    }

    /// Number of samples in all shards.
    pub fn num_samples(&self) -> usize {
        self.objects.iter().map(|o| if let ObjectStatus::Done { samples, .. } = o.status { samples } else { 0 }).sum()
    }

    /// Opens the shard of one of the manifest's objects, and holds it against the manifest: the same settings, seed, number
    /// of samples and record. `None` where the object has no shard.
    ///
    /// # Errors
    /// A shard that cannot be read, is damaged, or belongs to another set.
    pub fn open(&self, directory: &Path, record: &ObjectRecord) -> Result<Option<ShardReader>, FormatError> {
        let ObjectStatus::Done { shard, samples, .. } = &record.status else { return Ok(None) };
        let reader = ShardReader::open(&directory.join(shard))?;
        let metadata = reader.metadata();
        let differs = |what: &str, found: String, expected: String| {
            let place = Place::Part(what.to_owned());
            let expected = format!("{expected}, as {MANIFEST} says: the shard belongs to another set");
            Err(FormatError::syntax(reader.path(), place, found, expected))
        };
        if metadata.config_hash != self.config_hash {
            return differs("settings", metadata.config_hash.clone(), self.config_hash.clone());
        }
        if metadata.seed != self.seed {
            return differs("seed", metadata.seed.to_string(), self.seed.to_string());
        }
        if reader.len() != *samples {
            return differs("number of samples", reader.len().to_string(), samples.to_string());
        }
        if !metadata.objects.contains(record) {
            return differs("record", "another one".to_owned(), format!("that of {:?}", record.object));
        }
        Ok(Some(reader))
    }
}

/// Whether `datagen` began a set in a directory: its shards, or its note of the run.
fn begun(directory: &Path) -> bool {
    let noted = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).contains("program = \"datagen ");
    directory.join("shards").is_dir() || crate::file::read(&directory.join("run.toml")).is_ok_and(noted)
}

#[cfg(test)]
mod tests;
