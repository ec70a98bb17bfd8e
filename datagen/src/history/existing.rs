//! What a set that frame histories are added to has already.

use super::{DATASET, HistoryError, draw};
use crate::generate::shard_path;
use formats::frame_history::{Frame, read_frame_history};
use formats::manifest::MANIFEST;
use formats::{
    CloudPrecision, FormatError, Manifest, ObjectRecord, ObjectStatus, ShardMetadata, ShardReader, ShardWriter, Split,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The records of the set in `out` by name, but for those of `files`, whose shards are written anew. Writes nothing.
///
/// # Errors
/// A set of another kind; one that was split otherwise, for then the split would not follow from seed and share any more; one with
/// another object of a file's name.
pub(super) fn kept(
    out: &Path,
    files: &BTreeMap<String, PathBuf>,
    seed: u64,
    validation_share: f64,
) -> Result<BTreeMap<String, ObjectRecord>, HistoryError> {
    if !out.join(MANIFEST).exists() {
        return Ok(BTreeMap::new());
    }
    let manifest = Manifest::read(out)?;
    if manifest.dataset != DATASET {
        return Err(HistoryError::OtherSet { out: out.to_owned(), found: manifest.dataset });
    }
    if let Some(found) = other_draw(&manifest, seed, validation_share) {
        return Err(HistoryError::OtherDraw { out: out.to_owned(), found });
    }
    let lower: BTreeMap<String, (&String, &PathBuf)> = files.iter().map(|file| (file.0.to_lowercase(), file)).collect();
    let mut kept = BTreeMap::new();
    for record in manifest.objects {
        if let Some((name, file)) = lower.get(&record.object.to_lowercase()) {
            check_same(&shard_path(out, &record.object), &record.object, name, file)?;
        } else {
            kept.insert(record.object.clone(), record);
        }
    }
    Ok(kept)
}

/// What differs where the set was not split by this seed and share. The share itself is not noted, but what comes of it.
fn other_draw(manifest: &Manifest, seed: u64, validation_share: f64) -> Option<String> {
    if manifest.seed != seed {
        return Some(format!("--seed {}, not {seed}", manifest.seed));
    }
    let drawn = draw(manifest.objects.iter().map(|record| &record.object), seed, validation_share);
    if manifest.objects.iter().all(|record| drawn.get(&record.object) == Some(&record.split)) {
        return None;
    }
    let held = manifest.objects.iter().filter(|record| record.split == Split::Validation).count();
    let all = manifest.objects.len();
    Some(format!("another --validation-share than {validation_share}: {held} of {all} objects are for validation"))
}

/// Refuses another file than the one that a shard was made from. A shard that is gone or damaged is made anew.
fn check_same(shard: &Path, object: &str, name: &str, file: &Path) -> Result<(), HistoryError> {
    if object != name {
        return Err(HistoryError::SameName { first: shard.to_owned(), second: file.to_owned(), name: name.to_owned() });
    }
    let Ok(reader) = ShardReader::open(shard) else { return Ok(()) };
    let frames = read_frame_history(file)?;
    let same = |(index, frame): (usize, &Frame)| {
        reader.sample(index).is_ok_and(|sample| {
            sample.scores == frame.scores
                && sample.cloud.len() == frame.cloud.len()
                && sample.candidates.iter().map(|c| &c.view).eq(&frame.candidates)
        })
    };
    if reader.len() == frames.len() && frames.iter().enumerate().all(same) {
        return Ok(());
    }
    Err(HistoryError::OtherHistory { file: file.to_owned(), shard: shard.to_owned() })
}

/// An object on another side of the split, in its shard as well.
///
/// # Errors
/// A shard that cannot be read or written.
pub(super) fn with_split(out: &Path, record: &ObjectRecord, split: Split) -> Result<ObjectRecord, FormatError> {
    let record = ObjectRecord { split, ..record.clone() };
    let ObjectStatus::Done { shard, .. } = &record.status else { return Ok(record) };
    let path = out.join(shard);
    if ShardReader::peek(&path)?.objects.contains(&record) {
        return Ok(record);
    }
    let reader = ShardReader::open(&path)?;
    let metadata = ShardMetadata { objects: vec![record.clone()], ..reader.metadata().clone() };
    let mut writer = ShardWriter::new(metadata, CloudPrecision::F32);
    for index in 0..reader.len() {
        writer.push(&reader.sample(index)?)?;
    }
    writer.write(&path)?;
    Ok(record)
}
