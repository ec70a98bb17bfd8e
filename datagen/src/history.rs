//! The authors' frame histories as a set of shards, and back.

mod existing;

use crate::dataset::{Object, Source, SplitChoice, assign_splits};
use crate::generate::{Part, lock_part, shard_path};
use crate::output::{OutputError, OutputKind, check_output};
use formats::frame_history::{Frame, NUM_VIEWS, read_frame_history, write_frame_history};
use formats::lock::LockError;
use formats::shard::SCHEMA_VERSION;
use formats::{
    CloudPrecision, FormatError, Manifest, ObjectRecord, ObjectStatus, Sample, ShardMetadata, ShardWriter, Split,
};
use geometry::View;
use geometry::density::densities;
use nalgebra::Point3;
use planning::CandidateView;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Neighbours of the density at a candidate's target (docs/method.md, 'Network input and output').
const DENSITY_NEIGHBORS: usize = 30;
/// Bytes of a file's name before its ending.
const LONGEST: usize = 200;

/// What the manifest calls an imported set.
pub const DATASET: &str = "frame-history";

/// Why frame histories cannot become a set, or a set frame histories.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Another process writes to the directory.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The directory holds the output of another program.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Two files would become one object.
    #[error("{first:?} and {second:?} have the same name {name:?}, ignoring case; rename one")]
    SameName {
        /// A file.
        first: PathBuf,
        /// Another one.
        second: PathBuf,
        /// The name of both.
        name: String,
    },
    /// The directory holds something else.
    #[error("{out:?} contains a set of {found:?}; give another --out")]
    OtherSet {
        /// The directory.
        out: PathBuf,
        /// What its manifest says it is.
        found: String,
    },
    /// The set that is added to was split otherwise.
    #[error("{out:?} was imported with {found}; give the same to add to it, or another --out")]
    OtherDraw {
        /// The directory.
        out: PathBuf,
        /// What differs.
        found: String,
    },
    /// The set has another object of this name.
    #[error(
        "{file:?}: {shard:?} was made from another file of this name; rename the file, or delete the shard to replace it"
    )]
    OtherHistory {
        /// The file.
        file: PathBuf,
        /// The shard.
        shard: PathBuf,
    },
}

/// Frame histories as a set, or added to the set that was imported into `out` before: the same set as from all of them at once.
/// What they do not say stays NaN: coverage and overlap.
///
/// # Errors
/// A directory without frame histories; the first file that is no frame history, with the frame; two files of one name; a
/// directory with another set or the output of another program, or in use; a set of another seed or share, or with another
/// object of a file's name; what cannot be written.
pub fn import(
    inputs: &[PathBuf],
    out: &Path,
    validation_share: f64,
    seed: u64,
    commit: &str,
) -> Result<Manifest, HistoryError> {
    let files = files(inputs)?;
    check_output(out, OutputKind::DataSet)?;
    // All of them before anything is written, and one at a time: together they need not fit the memory.
    for path in files.values() {
        read_frame_history(path)?;
    }
    let kept = || existing::kept(out, &files, seed, validation_share);
    kept()?;
    let _lock = lock_part(out, Part::WHOLE)?;
    // Again: another import may have ended in between.
    let kept = kept()?;
    let mut records = vec![];
    for (name, split) in draw(kept.keys().chain(files.keys()), seed, validation_share) {
        records.push(match (files.get(&name), kept.get(&name)) {
            (Some(file), _) => write_shard(out, name, split, file, seed, commit)?,
            (None, Some(record)) => existing::with_split(out, record, split)?,
            (None, None) => continue,
        });
    }
    let manifest = Manifest {
        schema_version: SCHEMA_VERSION,
        sha256: String::new(),
        dataset: DATASET.to_owned(),
        config_hash: DATASET.to_owned(),
        seed,
        commit: commit.to_owned(),
        objects: records,
    };
    manifest.write(out)?;
    Ok(manifest)
}

/// The files by the names of their objects, each name once.
fn files(inputs: &[PathBuf]) -> Result<BTreeMap<String, PathBuf>, HistoryError> {
    let mut files = vec![];
    for input in inputs {
        if input.is_dir() {
            let entries = std::fs::read_dir(input).map_err(|e| FormatError::io(input, "read the directory", e))?;
            let before = files.len();
            files.extend(entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "bin")));
            if files.len() == before {
                let (path, found) = (input.clone(), "no file ending in .bin".to_owned());
                let expected = "frame histories directly in this directory, one .bin file per object";
                return Err(FormatError::Empty { path, found, expected }.into());
            }
        } else {
            files.push(input.clone());
        }
    }
    files.sort();
    let (mut named, mut lower) = (BTreeMap::new(), BTreeMap::<String, PathBuf>::new());
    for path in files {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(first) = lower.insert(name.to_lowercase(), path.clone()) {
            return Err(HistoryError::SameName { first, second: path, name });
        }
        named.insert(name, path);
    }
    Ok(named)
}

/// What the object of each name is for.
fn draw<'a>(names: impl Iterator<Item = &'a String>, seed: u64, validation_share: f64) -> BTreeMap<String, Split> {
    let object = |name: &String| Object {
        name: name.clone(),
        category: DATASET.to_owned(),
        split: Split::Train,
        source: Source::File(PathBuf::new()),
    };
    let objects = assign_splits(names.map(object).collect(), SplitChoice::Train, seed, validation_share);
    objects.into_iter().map(|object| (object.name, object.split)).collect()
}

/// Writes the shard of a frame history.
fn write_shard(
    out: &Path,
    name: String,
    split: Split,
    file: &Path,
    seed: u64,
    commit: &str,
) -> Result<ObjectRecord, FormatError> {
    let samples = to_samples(&name, &read_frame_history(file)?);
    let path = shard_path(out, &name);
    let status = ObjectStatus::Done {
        shard: format!("shards/{name}.safetensors"),
        samples: samples.len(),
        coverage: vec![],
        overlap: vec![],
        void_episodes: 0,
    };
    let record = ObjectRecord { object: name, category: DATASET.to_owned(), split, status };
    let metadata = ShardMetadata {
        schema_version: SCHEMA_VERSION,
        sha256: String::new(),
        config_hash: DATASET.to_owned(),
        seed,
        commit: commit.to_owned(),
        mesh: String::new(),
        objects: vec![record.clone()],
    };
    let mut writer = ShardWriter::new(metadata, CloudPrecision::F32);
    for sample in &samples {
        writer.push(sample)?;
    }
    writer.write(&path)?;
    Ok(record)
}

/// The samples of a frame history, in its order: frame i is the decision after i + 1 scans.
pub fn to_samples(object: &str, frames: &[Frame]) -> Vec<Sample> {
    let sample = |(index, frame): (usize, &Frame)| {
        let targets: Vec<Point3<f64>> = frame.candidates.iter().map(|v| v.target).collect();
        let density = densities(&frame.cloud.points, &targets, DENSITY_NEIGHBORS);
        let candidates = frame.candidates.iter().zip(density).map(|(&view, density)| CandidateView { view, density });
        let unknown = vec![f64::NAN; frame.candidates.len()];
        Sample {
            object: object.to_owned(),
            scan_index: index,
            cloud: frame.cloud.clone(),
            candidates: candidates.collect(),
            coverage: unknown.clone(),
            overlap: unknown,
            scores: frame.scores.clone(),
            current_coverage: f64::NAN,
            working_distance: frame.candidates.first().map_or(1.2, |v| (v.position - v.target).norm()),
            cameras: frames[..=index].iter().map(|f| f.current.world_from_camera()).collect(),
        }
    };
    frames.iter().enumerate().map(sample).collect()
}

/// Writes a set as frame histories, `<out>/<object>.bin` with `/` in names as `_` (and a digest where two names meet so). Samples with other than 20
/// candidates, or before which one was left out, cannot be said and are left out; their number is the second result.
///
/// # Errors
/// A shard that cannot be read; what cannot be written.
pub fn export(directory: &Path, out: &Path) -> Result<(usize, usize), FormatError> {
    let manifest = Manifest::read(directory)?;
    let flat = |record: &ObjectRecord| record.object.replace('/', "_");
    let mut uses = BTreeMap::<String, usize>::new();
    for record in &manifest.objects {
        *uses.entry(flat(record).to_lowercase()).or_default() += 1;
    }
    let (mut files, mut left_out) = (0, 0);
    for record in &manifest.objects {
        let Some(reader) = manifest.open(directory, record)? else { continue };
        let samples: Vec<Sample> = (0..reader.len()).map(|i| reader.sample(i)).collect::<Result<_, _>>()?;
        let frames: Vec<Frame> = samples.iter().map_while(to_frame).collect();
        left_out += samples.len() - frames.len();
        if !frames.is_empty() {
            let mut name = flat(record);
            if uses[&name.to_lowercase()] > 1 || name.len() > LONGEST {
                let end = (0..=LONGEST.min(name.len())).rev().find(|&i| name.is_char_boundary(i)).unwrap_or(0);
                name = format!("{}~{}", &name[..end], formats::config::digest(record.object.as_bytes()));
            }
            write_frame_history(&out.join(format!("{name}.bin")), &frames)?;
            files += 1;
        }
    }
    Ok((files, left_out))
}

fn to_frame(sample: &Sample) -> Option<Frame> {
    if sample.candidates.len() != NUM_VIEWS || !sample.cloud.has_normals() || sample.cloud.is_empty() {
        return None;
    }
    // First of equal scores, as the search takes it.
    let best = (0..NUM_VIEWS).fold(0, |best, i| if sample.scores[i] > sample.scores[best] { i } else { best });
    let pose = sample.cameras.last()?;
    let position = Point3::from(pose.translation.vector);
    let forward = pose.rotation * nalgebra::Vector3::z();
    Some(Frame {
        cloud: sample.cloud.clone(),
        current: View { target: position + forward * sample.working_distance, position },
        next: sample.candidates[best].view,
        candidates: sample.candidates.iter().map(|c| c.view).collect(),
        scores: sample.scores.clone(),
    })
}

#[cfg(test)]
mod tests;
