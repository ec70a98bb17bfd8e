//! The manifest, gathered from what lies in the directory.

use super::Job;
use formats::shard::SCHEMA_VERSION;
use formats::{Fate, FormatError, Manifest, ObjectRecord, ShardReader};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Where an object's shard lies.
pub fn shard_path(out: &Path, object: &str) -> PathBuf {
    out.join("shards").join(format!("{object}.safetensors"))
}

/// Where the reason lies why an object has no shard.
pub fn skip_path(out: &Path, object: &str) -> PathBuf {
    out.join("skipped").join(format!("{object}.json"))
}

/// Writes the manifest of all that is there now. Several processes may end at the same time: each looks and writes
/// while it holds the lock, so that the last one to write has seen the shards of all.
pub(super) fn assemble(job: &Job, hash: &str) -> Result<(), FormatError> {
    let path = job.out.join(".lock");
    let lock = File::options().create(true).append(true).open(&path).map_err(|e| FormatError::io(&path, "open", e))?;
    lock.lock().map_err(|e| FormatError::io(&path, "lock", e))?;
    let mut commit = None;
    let objects = job
        .objects
        .iter()
        .map(|object| {
            let missing = ObjectRecord {
                object: object.name.clone(),
                category: object.category.clone(),
                split: object.split,
                fate: Fate::Missing,
            };
            if let Ok(reader) = ShardReader::open(&shard_path(job.out, &object.name)) {
                commit.get_or_insert_with(|| reader.metadata().commit.clone());
                return reader.metadata().objects.first().cloned().unwrap_or(missing);
            }
            let skipped = std::fs::read(skip_path(job.out, &object.name)).ok();
            skipped.and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or(missing)
        })
        .collect();
    Manifest {
        schema_version: SCHEMA_VERSION,
        dataset: job.config.dataset.name.as_str().to_owned(),
        config_hash: hash.to_owned(),
        seed: job.config.seed,
        commit: commit.unwrap_or_else(|| job.commit.to_owned()),
        objects,
    }
    .write(job.out)
}
