//! The manifest, gathered from what lies in the directory.

use super::{GenerateError, Job, Part};
use formats::shard::SCHEMA_VERSION;
use formats::{Fate, FormatError, Manifest, ObjectRecord, ShardReader};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// Where an object's shard lies.
pub fn shard_path(out: &Path, object: &str) -> PathBuf {
    out.join("shards").join(format!("{object}.safetensors"))
}

/// Where the reason lies why an object has no shard.
pub fn skip_path(out: &Path, object: &str) -> PathBuf {
    out.join("skipped").join(format!("{object}.json"))
}

/// Holds the directory's lock while `work` runs.
pub(super) fn locked<T>(out: &Path, work: impl FnOnce() -> Result<T, GenerateError>) -> Result<T, GenerateError> {
    std::fs::create_dir_all(out).map_err(|e| FormatError::io(out, "make the directory", e))?;
    let path = out.join(".lock");
    let file = open(&path)?;
    match file.lock() {
        Ok(()) => {}
        Err(e) if e.kind() == std::io::ErrorKind::Unsupported => {
            tracing::warn!("{path:?}: no locks here; run one part at a time")
        }
        Err(e) => return Err(FormatError::io(&path, "lock", e).into()),
    }
    work()
}

/// A lock for as long as a part is worked on; `None` where another process holds it.
pub(super) fn lock_part(out: &Path, part: Part) -> Result<Option<File>, FormatError> {
    let path = out.join(format!(".lock-{}-of-{}", part.index, part.count));
    let file = open(&path)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(e)) if e.kind() == std::io::ErrorKind::Unsupported => Ok(Some(file)),
        Err(TryLockError::Error(e)) => Err(FormatError::io(&path, "lock", e)),
    }
}

fn open(path: &Path) -> Result<File, FormatError> {
    File::options().create(true).append(true).open(path).map_err(|e| FormatError::io(path, "open", e))
}

/// Writes the manifest of all that is there now. Several processes may end at the same time: each looks and writes
/// while it holds the lock, so that the last one to write has seen the shards of all.
pub(super) fn assemble(job: &Job, hash: &str) -> Result<(), GenerateError> {
    locked(job.out, || Ok(gather(job, hash).write(job.out)?))
}

fn gather(job: &Job, hash: &str) -> Manifest {
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
}
