//! The manifest, gathered from what lies in the directory.

use super::{GenerateError, Job};
use formats::lock::LOCK;
use formats::manifest::read_skipped;
use formats::shard::SCHEMA_VERSION;
use formats::{Manifest, ObjectRecord, ObjectStatus, ShardReader};
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
    let _lock = formats::lock::wait_for(out, LOCK)?;
    work()
}

/// Writes the manifest of all that is there now. Several processes may end at the same time: each looks and writes
/// while it holds the lock, so that the last one to write has seen the shards of all.
pub(super) fn assemble(job: &Job, hash: &str) -> Result<(), GenerateError> {
    locked(job.out, || Ok(gather(job, hash).write(job.out)?))
}

fn gather(job: &Job, hash: &str) -> Manifest {
    let mut commits: Vec<String> = Vec::new();
    let objects = job
        .objects
        .iter()
        .map(|object| {
            let missing = ObjectRecord {
                object: object.name.clone(),
                category: object.category.clone(),
                split: object.split,
                status: ObjectStatus::Missing,
            };
            // Its maker has read all of it just now.
            if let Ok(shard) = ShardReader::peek(&shard_path(job.out, &object.name)) {
                if !commits.contains(&shard.commit) {
                    commits.push(shard.commit);
                }
                return shard.objects.into_iter().next().unwrap_or(missing);
            }
            let skipped = skip_path(job.out, &object.name);
            let told = skipped.exists().then(|| read_skipped(&skipped)).transpose().unwrap_or_else(|error| {
                tracing::warn!("{error}");
                None
            });
            told.filter(|told| told.object == object.name).unwrap_or(missing)
        })
        .collect();
    Manifest {
        schema_version: SCHEMA_VERSION,
        sha256: String::new(),
        dataset: job.config.dataset.name.as_str().to_owned(),
        config_hash: hash.to_owned(),
        seed: job.config.seed,
        commit: if commits.is_empty() { job.commit.to_owned() } else { commits.join(", ") },
        objects,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::DatagenConfig;
    use crate::dataset::{Object, Source};
    use crate::generate::Part;
    use formats::{CloudPrecision, ShardMetadata, ShardWriter, Split};

    #[test]
    fn a_set_that_several_versions_made_names_all_of_them() {
        let home = tempfile::tempdir().unwrap();
        let config = DatagenConfig::default();
        let object = |name: &str| Object {
            name: name.to_owned(),
            category: "c".to_owned(),
            split: Split::Train,
            source: Source::File(PathBuf::new()),
        };
        let objects = ["a", "b", "c", "d"].map(object);
        let commit = || {
            let job =
                Job { config: &config, objects: &objects, part: Part::WHOLE, out: home.path(), jobs: 1, commit: "now" };
            gather(&job, "h").commit
        };
        let make = |name: &str, commit: &str| {
            let metadata = ShardMetadata { commit: commit.to_owned(), ..ShardMetadata::default() };
            ShardWriter::new(metadata, CloudPrecision::F32).write(&shard_path(home.path(), name)).unwrap();
        };
        assert_eq!(commit(), "now", "of a set without a shard");
        make("a", "one");
        make("d", "one");
        assert_eq!(commit(), "one");
        make("c", "two");
        assert_eq!(commit(), "one, two");
    }
}
