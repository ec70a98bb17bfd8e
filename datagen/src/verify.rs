//! Is a set whole and sound?

use crate::config::DatagenConfig;
use crate::generate::{shard_path, skip_path};
use formats::error::REMAKE;
use formats::manifest::read_skipped;
use formats::surface::read_surface;
use formats::{FormatError, Manifest, ObjectRecord, ObjectStatus, ShardReader};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// What a look at every byte of a set showed.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// Shards that are sound.
    pub shards: usize,
    /// Samples in them.
    pub samples: usize,
    /// Reference surfaces that are sound.
    pub surfaces: usize,
    /// Objects that cannot be used.
    pub skipped: usize,
    /// Objects not made yet.
    pub missing: Vec<String>,
    /// What is wrong, with the file.
    pub problems: Vec<String>,
    /// Files that are no part of the set.
    pub notes: Vec<String>,
}

impl Verdict {
    /// Whether the set is whole and sound.
    pub fn is_sound(&self) -> bool {
        self.missing.is_empty() && self.problems.is_empty()
    }
}

/// Reads every file of a set: manifest, shards and surfaces against their checksums, shards and settings against the manifest.
///
/// # Errors
/// A directory without a sound manifest. What is wrong with shards is in the verdict.
pub fn verify(directory: &Path) -> Result<Verdict, FormatError> {
    let manifest = Manifest::read(directory)?;
    let mut verdict = Verdict::default();
    let (mut known, mut unmade) = (BTreeSet::<PathBuf>::new(), BTreeSet::<PathBuf>::new());
    for record in &manifest.objects {
        if !matches!(record.status, ObjectStatus::Done { .. }) {
            unmade.insert(shard_path(directory, &record.object));
        }
        match &record.status {
            ObjectStatus::Missing => verdict.missing.push(record.object.clone()),
            ObjectStatus::Skipped { .. } => {
                verdict.skipped += 1;
                verdict.problems.extend(unlike_its_file(directory, record));
            }
            ObjectStatus::Done { shard, .. } => {
                if !known.insert(directory.join(shard)) {
                    verdict.problems.push(format!("{:?}: another object uses its shard {shard:?} too", record.object));
                }
                let checked = manifest.open(directory, record).and_then(|reader| {
                    reader.as_ref().map_or(Ok(()), ShardReader::verify)?;
                    Ok(reader.map_or(0, |reader| reader.len()))
                });
                match checked {
                    Err(error) => verdict.problems.push(error.to_string()),
                    Ok(samples) => {
                        verdict.shards += 1;
                        verdict.samples += samples;
                    }
                }
            }
        }
    }
    if let Err(problem) = settings(directory, &manifest) {
        verdict.problems.push(problem);
    }
    let mut surfaces = vec![];
    files_below(&directory.join("surfaces"), &mut surfaces)?;
    for path in &surfaces {
        match read_surface(path) {
            Err(error) => verdict.problems.push(error.to_string()),
            Ok(_) => verdict.surfaces += 1,
        }
    }
    let mut found = vec![];
    files_below(&directory.join("shards"), &mut found)?;
    for path in found.into_iter().filter(|p| !known.contains(p)) {
        if unmade.contains(&path) {
            let way_out = "run the same datagen command again to update the manifest";
            verdict.problems.push(format!("{path:?}: the manifest does not say that it was made; {way_out}"));
        } else {
            verdict.notes.push(format!(
                "{path:?}: not in the manifest, and not used: the data set no longer lists it (delete the file), or a run \
                 that was to add it was cut off (run the same datagen command again)"
            ));
        }
    }
    Ok(verdict)
}

/// What is wrong with the file that says why an object was skipped; imported sets have none.
fn unlike_its_file(directory: &Path, record: &ObjectRecord) -> Option<String> {
    let path = skip_path(directory, &record.object);
    if !path.exists() {
        return None;
    }
    match read_skipped(&path) {
        Err(error) => Some(error.to_string()),
        Ok(told) if told != *record => Some(format!("{path:?}: another record than in the manifest; {REMAKE}")),
        Ok(_) => None,
    }
}

/// Whether the settings that lie beside the shards are those that made them; an imported set has none.
fn settings(directory: &Path, manifest: &Manifest) -> Result<(), String> {
    let path = directory.join("config.toml");
    // Settings of an older program need not be readable by this one.
    if manifest.sha256.is_empty() || (!path.exists() && manifest.dataset == crate::history::DATASET) {
        return Ok(());
    }
    formats::config::check_stored(&path).map_err(|e| e.to_string())?;
    let config: DatagenConfig = formats::config::load(Some(&path), &[], &[]).map_err(|e| e.to_string())?;
    let found = formats::config::hash(&config.without_places()).map_err(|e| e.to_string())?;
    match found == manifest.config_hash {
        true => Ok(()),
        false => Err(format!("{path:?}: settings {found}, but the manifest says {}", manifest.config_hash)),
    }
}

fn files_below(directory: &Path, found: &mut Vec<PathBuf>) -> Result<(), FormatError> {
    let Ok(entries) = std::fs::read_dir(directory) else { return Ok(()) };
    let mut paths = vec![];
    for entry in entries {
        paths.push(entry.map_err(|e| FormatError::io(directory, "read the directory", e))?.path());
    }
    paths.sort();
    for path in paths {
        if path.is_dir() {
            files_below(&path, found)?;
        } else if path.extension().is_some_and(|e| e == "safetensors") {
            found.push(path);
        }
    }
    Ok(())
}
