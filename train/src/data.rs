//! The samples of a data set, split by object.

mod leaks;

use crate::TrainError;
use datagen::history::to_samples;
use datagen::output::{OutputKind, outputs};
use formats::{Manifest, ObjectRecord, ObjectStatus, Sample, ShardReader, Split};
use geometry::rng::stream;
use leaks::Named;
use rand::seq::SliceRandom;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What stands before the digest of the samples in a set's name.
pub(crate) const CONTENTS: &str = ", contents ";

/// A data set on disk; samples are read when they are asked for.
#[derive(Debug)]
pub struct Dataset {
    name: String,
    sources: Vec<Source>,
    train: Vec<Place>,
    validation: Vec<Place>,
    objects: Vec<Named>,
}

#[derive(Debug)]
enum Source {
    Shard(Box<ShardReader>),
    /// The authors' files are read whole.
    Frames(Vec<Sample>),
}

impl Source {
    fn len(&self) -> usize {
        match self {
            Source::Shard(reader) => reader.len(),
            Source::Frames(samples) => samples.len(),
        }
    }
}

/// Where a sample is.
#[derive(Clone, Copy, Debug)]
struct Place {
    source: usize,
    index: usize,
}

impl Dataset {
    /// Opens a set that `datagen` made (a directory with `manifest.json`), or the authors' `frame_history` files (a
    /// directory with `.bin` files, each an object, or one such file). Validation samples are those of the
    /// manifest's validation objects; where it has none, `fraction` of the training objects is held out, drawn from
    /// the seed. Test objects are not touched.
    ///
    /// # Errors
    ///
    /// Unreadable or damaged files; an incomplete set; a shard of another set; fewer than two objects; not one sample that
    /// can be used.
    pub fn open(path: &Path, fraction: f64, seed: u64) -> Result<Dataset, TrainError> {
        // One that was begun, too: that it is not finished is said there.
        if outputs(path).iter().any(|(kind, _)| *kind == OutputKind::DataSet) {
            Self::open_shards(path, fraction, seed)
        } else {
            Self::open_frames(path, fraction, seed)
        }
    }

    /// Opens several sets and joins their samples.
    ///
    /// # Errors
    ///
    /// As [`Dataset::open`]; no set at all; an object that one set holds out and another trains on.
    pub fn open_all(paths: &[PathBuf], fraction: f64, seed: u64) -> Result<Dataset, TrainError> {
        let mut real = BTreeMap::new();
        for path in paths {
            if let Some(other) = real.insert(std::fs::canonicalize(path).unwrap_or_else(|_| path.clone()), path) {
                let problem = format!("it is the same set as {other:?}");
                return Err(unfit(path, problem, "name each set once"));
            }
        }
        let mut sets = paths.iter().map(|path| Self::open(path, fraction, seed));
        let first = sets.next().ok_or_else(|| TrainError::NoData { searched: "no data set is named".into() })??;
        let all = sets.try_fold(first, |joined, set| set.map(|set| joined.join(set)))?;
        leaks::check(&all.objects)?;
        Ok(all)
    }

    fn join(mut self, other: Dataset) -> Dataset {
        let moved = |place: Place| Place { source: place.source + self.sources.len(), ..place };
        self.train.extend(other.train.into_iter().map(moved));
        self.validation.extend(other.validation.into_iter().map(moved));
        self.sources.extend(other.sources);
        self.objects.extend(other.objects);
        self.name = format!("{} + {}", self.name, other.name);
        self
    }

    fn open_shards(path: &Path, fraction: f64, seed: u64) -> Result<Dataset, TrainError> {
        let manifest = Manifest::read(path)?;
        let missing = missing(&manifest);
        if missing > 0 {
            let problem = format!("{missing} of {} objects are missing", manifest.objects.len());
            return Err(unfit(path, problem, "finish the set by running the same `datagen` command again"));
        }
        let name = format!(
            "{} (settings {}, seed {}, {} samples)",
            manifest.dataset,
            manifest.config_hash,
            manifest.seed,
            manifest.num_samples()
        );
        // Objects of a built-in family differ with its seed; those of other sets are known by name.
        let family = if manifest.dataset == "procedural" { format!(", seed {}", manifest.seed) } else { String::new() };
        let named = |record: &ObjectRecord| Named {
            name: format!("{:?} of {}{family}", record.object, manifest.dataset),
            mesh: String::new(),
            split: record.split,
            set: path.to_path_buf(),
        };
        // Nothing is held out or trained on of what was skipped.
        let done = |record: &&ObjectRecord| matches!(record.status, ObjectStatus::Done { .. });
        let records: Vec<&ObjectRecord> = manifest.objects.iter().filter(done).collect();
        let mut objects: Vec<Named> = records.iter().copied().map(named).collect();
        let open = |split: Split| -> Result<Vec<(usize, ShardReader)>, TrainError> {
            let wanted: Vec<usize> = (0..records.len()).filter(|&i| records[i].split == split).collect();
            let opened = wanted.into_par_iter().filter_map(|i| {
                let reader = manifest.open(path, records[i]).map_err(TrainError::from).transpose()?;
                Some(reader.map(|reader| (i, reader)))
            });
            opened.collect()
        };
        let mut train = open(Split::Train)?;
        let mut validation = open(Split::Validation)?;
        for (i, reader) in train.iter().chain(&validation) {
            objects[*i].mesh.clone_from(&reader.metadata().mesh);
        }
        if validation.is_empty() {
            let held = held_out(train.len(), fraction, seed);
            let (mut kept, mut out) = (Vec::new(), Vec::new());
            for (i, shard) in train.into_iter().enumerate() {
                if held.contains(&i) { out.push(shard) } else { kept.push(shard) }
            }
            out.iter().for_each(|&(i, _)| objects[i].split = Split::Validation);
            (train, validation) = (kept, out);
        }
        let sources = |list: Vec<(usize, ShardReader)>| {
            list.into_iter().map(|(_, reader)| Source::Shard(Box::new(reader))).collect()
        };
        Self::new(path, name, sources(train), sources(validation), objects)
    }

    fn open_frames(path: &Path, fraction: f64, seed: u64) -> Result<Dataset, TrainError> {
        let files = frame_files(path)?;
        let mut objects = Vec::new();
        for file in &files {
            let object = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let frames = formats::frame_history::read_frame_history(file)?;
            objects.push(Source::Frames(to_samples(&object, &frames)));
        }
        let held = held_out(objects.len(), fraction, seed);
        let (mut train, mut validation, mut named) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (source, file)) in objects.into_iter().zip(&files).enumerate() {
            let split = if held.contains(&i) { Split::Validation } else { Split::Train };
            let name = format!("{:?} of frame-history", file.file_stem().unwrap_or_default());
            named.push(Named { name, mesh: String::new(), split, set: path.to_path_buf() });
            if split == Split::Validation { validation.push(source) } else { train.push(source) }
        }
        Self::new(path, format!("{} frame histories", files.len()), train, validation, named)
    }

    fn new(
        path: &Path,
        name: String,
        train: Vec<Source>,
        validation: Vec<Source>,
        named: Vec<Named>,
    ) -> Result<Dataset, TrainError> {
        let objects = train.len();
        let sources: Vec<Source> = train.into_iter().chain(validation).collect();
        let places = |range: std::ops::Range<usize>| -> Vec<Place> {
            range.flat_map(|source| (0..sources[source].len()).map(move |index| Place { source, index })).collect()
        };
        let (train, validation) = (places(0..objects), places(objects..sources.len()));
        let mut set = Dataset { name, sources, train, validation, objects: named };
        let mut marks = String::new();
        for (what, list) in [("training", &set.train), ("validation", &set.validation)] {
            if list.is_empty() {
                let problem = format!("no {what} samples in {} objects", set.sources.len());
                return Err(unfit(path, problem, "make a set of at least two usable objects with `datagen`"));
            }
            let looked = list.par_iter().map(|place| set.look(*place));
            let looked: Vec<(Option<String>, String)> = looked.collect::<Result<_, TrainError>>()?;
            let (problems, own): (Vec<Option<String>>, Vec<String>) = looked.into_iter().unzip();
            marks.extend(own);
            if let (Some(Some(first)), true) = (problems.first(), problems.iter().all(Option::is_some)) {
                let problem = format!("not one of {} {what} samples can be used: {first}", list.len());
                return Err(unfit(path, problem, "make the set again with `datagen`"));
            }
        }
        set.name += &format!("{CONTENTS}{}", formats::config::digest(marks.as_bytes()));
        Ok(set)
    }

    /// Names the set: where its samples come from, and a digest that tells them from others; not where it lies.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of training samples.
    pub fn num_train(&self) -> usize {
        self.train.len()
    }

    /// Number of validation samples.
    pub fn num_validation(&self) -> usize {
        self.validation.len()
    }

    /// Training sample `i`.
    ///
    /// # Errors
    /// Its file changed since the set was opened, or cannot be read any more.
    pub fn train_sample(&self, i: usize) -> Result<Sample, TrainError> {
        self.sample(self.train[i])
    }

    /// Validation sample `i`.
    ///
    /// # Errors
    /// As [`Dataset::train_sample`].
    pub fn validation_sample(&self, i: usize) -> Result<Sample, TrainError> {
        self.sample(self.validation[i])
    }

    /// Why a sample cannot be trained on, and its mark.
    fn look(&self, place: Place) -> Result<(Option<String>, String), TrainError> {
        let sample = self.sample(place)?;
        let frames = matches!(self.sources[place.source], Source::Frames(_));
        Ok((check(&sample).err(), mark(&sample, frames)))
    }

    fn sample(&self, place: Place) -> Result<Sample, TrainError> {
        Ok(match &self.sources[place.source] {
            Source::Shard(reader) => reader.sample(place.index)?,
            Source::Frames(samples) => samples[place.index].clone(),
        })
    }
}

/// Tells a sample from others by what follows from all the rest: its views and their scores. Not by its file, where the commit
/// that made it stands as well. In a frame history, whose views need not follow from its cameras, these count too.
fn mark(sample: &Sample, frames: bool) -> String {
    let views = sample.candidates.iter().map(|c| &c.view);
    let places = views.flat_map(|view| view.target.iter().chain(view.position.iter()).copied());
    let numbers = places.chain(sample.scores.iter().copied()).chain([sample.cloud.len() as f64]);
    let cameras = sample.cameras.iter().filter(|_| frames);
    let poses = cameras.flat_map(|pose| pose.translation.vector.iter().chain(pose.rotation.coords.iter()).copied());
    let numbers = numbers.chain(poses);
    formats::config::digest(&numbers.flat_map(f64::to_le_bytes).collect::<Vec<u8>>())
}

/// Why a sample cannot be trained on.
///
/// # Errors
/// What is wrong with it, with its name.
pub fn check(sample: &Sample) -> Result<(), String> {
    let name = format!("{} decision {}", sample.object, sample.scan_index);
    if sample.candidates.is_empty() || sample.cloud.is_empty() {
        let what = if sample.cloud.is_empty() { "an empty cloud" } else { "no candidate view" };
        return Err(format!("{name}: {what}"));
    }
    sample.check().map_err(|odd| format!("{name}: {odd}"))
}

fn unfit(path: &Path, problem: String, way_out: &str) -> TrainError {
    TrainError::Data { path: path.to_path_buf(), problem, way_out: way_out.into() }
}

/// The newest complete set in `base` that has objects to train on: a test half has none.
///
/// # Errors
///
/// None there: says what was found instead.
pub fn newest_set(base: &Path) -> Result<PathBuf, TrainError> {
    let trains =
        |o: &ObjectRecord| o.split == Split::Train && matches!(o.status, ObjectStatus::Done { samples: 1.., .. });
    let (mut sets, mut others) = (Vec::new(), Vec::new());
    for entry in std::fs::read_dir(base).into_iter().flatten().flatten() {
        let path = entry.path();
        let Ok(manifest) = Manifest::read(&path) else {
            continue;
        };
        if missing(&manifest) > 0 || !manifest.objects.iter().any(trains) {
            others.push(path);
        } else {
            let made = std::fs::metadata(path.join(formats::manifest::MANIFEST)).and_then(|m| m.modified()).ok();
            sets.push((made, path));
        }
    }
    sets.sort();
    others.sort();
    sets.pop().map(|(_, path)| path).ok_or_else(|| {
        let searched = if others.is_empty() {
            format!("no data set in {base:?}")
        } else {
            format!("no data set to train on in {base:?}, only unfinished ones or without training objects: {others:?}")
        };
        TrainError::NoData { searched }
    })
}

fn missing(manifest: &Manifest) -> usize {
    manifest.objects.iter().filter(|o| matches!(o.status, ObjectStatus::Missing)).count()
}

/// Indices of the objects to hold out: a share of them, at least one, never all.
fn held_out(objects: usize, fraction: f64, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..objects).collect();
    order.shuffle(&mut stream(seed, "train/held-out"));
    let amount = (objects as f64 * fraction).round() as usize;
    order.truncate(amount.clamp(1, objects.saturating_sub(1).max(1)));
    order
}

fn frame_files(path: &Path) -> Result<Vec<PathBuf>, TrainError> {
    const WAY_OUT: &str =
        "give --data a directory that `datagen` made (it has a manifest.json), or one with .bin files";
    let no_data = |problem: String| unfit(path, problem, WAY_OUT);
    if path.is_file() {
        return Ok(vec![path.to_path_buf()]);
    }
    let entries = std::fs::read_dir(path).map_err(|e| no_data(e.to_string()))?;
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|x| x == "bin")).collect();
    files.sort();
    if files.is_empty() {
        return Err(no_data("no data in it".into()));
    }
    Ok(files)
}
