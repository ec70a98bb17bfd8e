//! Which files an object was read from: results are kept under its name, and files of the same name may hold another object.

use super::published_samples;
use crate::config::Surface;
use crate::journal::Contents;
use datagen::dataset::{Object, Source};
use formats::FormatError;
use formats::config::digest;
use formats::file::read;
use rayon::prelude::*;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Objects that a message names.
const NAMED: usize = 5;

/// A directory holds results of other files.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{out:?} contains episodes on other meshes or scans of these names: {objects}; give another --out, or --root with the files \
     that they were run on"
)]
pub struct OtherFiles {
    /// The directory.
    pub out: PathBuf,
    /// The first objects.
    pub objects: String,
}

/// Digest of the files that an object is read from: its mesh, with the published samples where they are its surface, or what a
/// sequence is made of. `None` of what is built in, which follows from the settings.
///
/// # Errors
/// A file that cannot be read.
pub fn digest_of(object: &Object, surface: Surface) -> Result<Option<String>, FormatError> {
    let digests: Vec<String> = match &object.source {
        Source::Procedural { .. } => return Ok(None),
        Source::File(mesh) => {
            let samples = published_samples(mesh, surface).map(|samples| digest_of_file(&samples)).transpose()?;
            std::iter::once(digest_of_file(mesh)?).chain(samples).collect()
        }
        Source::Sequence(path) => digests_of_sequence(path)?,
    };
    Ok(Some(match &digests[..] {
        // As a shard has it.
        [mesh] => mesh.clone(),
        several => digest(several.concat().as_bytes()),
    }))
}

fn digest_of_file(path: &Path) -> Result<String, FormatError> {
    Ok(digest(&read(path)?))
}

/// Of the file that describes a sequence, and of the clouds, images and poses that it names.
fn digests_of_sequence(path: &Path) -> Result<Vec<String>, FormatError> {
    let description = read(path)?;
    let text = String::from_utf8_lossy(&description);
    let value: Value = serde_json::from_str(text.trim_start_matches('\u{feff}')).unwrap_or_default();
    let mut names = BTreeSet::new();
    texts(&value, &mut names);
    let folder = path.parent().unwrap_or(Path::new(""));
    let files = names.into_iter().map(|name| folder.join(name)).filter(|file| file.is_file());
    std::iter::once(Ok(digest(&description))).chain(files.map(|file| digest_of_file(&file))).collect()
}

/// Every text in a JSON value.
fn texts<'a>(value: &'a Value, found: &mut BTreeSet<&'a str>) {
    match value {
        Value::String(text) => {
            found.insert(text);
        }
        Value::Array(list) => list.iter().for_each(|value| texts(value, found)),
        Value::Object(map) => map.values().for_each(|value| texts(value, found)),
        _ => {}
    }
}

/// Refuses results of other files than these objects are read from, and forgets what could not be run on others: it is tried
/// again. Older programs did not note the files. A file that cannot be read is reported when its object is.
///
/// # Errors
/// The first such objects.
pub fn check(out: &Path, objects: &[Object], surface: Surface, contents: &mut Contents) -> Result<(), OtherFiles> {
    let known = contents.objects();
    let now: BTreeMap<&str, Option<String>> = objects
        .par_iter()
        .filter(|object| known.contains(object.name.as_str()))
        .filter_map(|object| Some((object.name.as_str(), digest_of(object, surface).ok()?)))
        .collect();
    let others = contents.on_other_files(&now);
    if others.is_empty() {
        contents.forget_skipped_on_other_files(&now);
        return Ok(());
    }
    let mut named = others.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    if others.len() > NAMED {
        named += &format!(" and {} more", others.len() - NAMED);
    }
    Err(OtherFiles { out: out.to_owned(), objects: named })
}

#[cfg(test)]
mod tests;
