//! Is a set whole and sound?

use formats::{Fate, FormatError, Manifest, ShardReader};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What a look at every byte of a set showed.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// Shards that are sound.
    pub shards: usize,
    /// Samples in them.
    pub samples: usize,
    /// Objects that cannot be used.
    pub skipped: usize,
    /// Objects not made yet.
    pub missing: Vec<String>,
    /// What is wrong, with the file.
    pub problems: Vec<String>,
}

impl Verdict {
    /// Whether the set is whole and sound.
    pub fn is_sound(&self) -> bool {
        self.missing.is_empty() && self.problems.is_empty()
    }
}

/// Reads every shard of a set and holds it against its checksum and the manifest.
///
/// # Errors
/// A directory without a manifest. What is wrong with shards is in the verdict.
pub fn verify(directory: &Path) -> Result<Verdict, FormatError> {
    let manifest = Manifest::read(directory)?;
    let mut verdict = Verdict::default();
    let mut known = BTreeSet::<PathBuf>::new();
    for record in &manifest.objects {
        match &record.fate {
            Fate::Missing => verdict.missing.push(record.object.clone()),
            Fate::Skipped { .. } => verdict.skipped += 1,
            Fate::Done { shard, samples, .. } => {
                let path = directory.join(shard);
                match ShardReader::open(&path).and_then(|r| r.verify().map(|()| r)) {
                    Err(error) => verdict.problems.push(error.to_string()),
                    Ok(reader) => {
                        let metadata = reader.metadata();
                        let mut differs = |what: &str, found: String, expected: String| {
                            if found != expected {
                                verdict
                                    .problems
                                    .push(format!("{path:?}: {what} {found}, but the manifest says {expected}"));
                            }
                        };
                        differs("config_hash", metadata.config_hash.clone(), manifest.config_hash.clone());
                        differs("seed", metadata.seed.to_string(), manifest.seed.to_string());
                        differs("number of samples", reader.len().to_string(), samples.to_string());
                        if !metadata.objects.contains(record) {
                            verdict
                                .problems
                                .push(format!("{path:?}: its record of {:?} is not the manifest's", record.object));
                        }
                        verdict.shards += 1;
                        verdict.samples += reader.len();
                    }
                }
                known.insert(path);
            }
        }
    }
    let mut found = vec![];
    shards_below(&directory.join("shards"), &mut found)?;
    for path in found.into_iter().filter(|p| !known.contains(p)) {
        verdict.problems.push(format!(
            "{path:?}: not in the manifest; run the same datagen command again, it brings the manifest up to date"
        ));
    }
    Ok(verdict)
}

fn shards_below(directory: &Path, found: &mut Vec<PathBuf>) -> Result<(), FormatError> {
    let Ok(entries) = std::fs::read_dir(directory) else { return Ok(()) };
    let mut paths = vec![];
    for entry in entries {
        paths.push(entry.map_err(|e| FormatError::io(directory, "read the directory", e))?.path());
    }
    paths.sort();
    for path in paths {
        if path.is_dir() {
            shards_below(&path, found)?;
        } else if path.extension().is_some_and(|e| e == "safetensors") {
            found.push(path);
        }
    }
    Ok(())
}
