//! The authors' frame histories as a set of shards, and back.

use crate::dataset::{Object, Source, SplitChoice, assign_splits};
use crate::generate::shard_path;
use formats::frame_history::{Frame, NUM_VIEWS, read_frame_history, write_frame_history};
use formats::shard::SCHEMA_VERSION;
use formats::{
    CloudPrecision, Fate, FormatError, Manifest, ObjectRecord, Sample, ShardMetadata, ShardReader, ShardWriter, Split,
};
use geometry::View;
use geometry::density::densities;
use nalgebra::Point3;
use planning::CandidateView;
use std::path::{Path, PathBuf};

/// Neighbours of the density at a candidate's target (docs/method.md, 'Network input and output').
const DENSITY_NEIGHBORS: usize = 30;

/// Frame histories as a set. What they do not say stays NaN: coverage and overlap.
///
/// # Errors
/// The first file that is no frame history, with the frame; two files of one name; what cannot be written.
pub fn import(inputs: &[PathBuf], out: &Path, validation_share: f64, seed: u64) -> Result<Manifest, FormatError> {
    let mut files = vec![];
    for input in inputs {
        if input.is_dir() {
            let entries = std::fs::read_dir(input).map_err(|e| FormatError::io(input, "read the directory", e))?;
            files.extend(entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "bin")));
        } else {
            files.push(input.clone());
        }
    }
    files.sort();
    let objects = files
        .iter()
        .map(|path| Object {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            category: "frame-history".to_owned(),
            split: Split::Train,
            source: Source::File(path.clone()),
        })
        .collect();
    let mut objects: Vec<Object> = assign_splits(objects, SplitChoice::Train, seed, validation_share);
    objects.sort_by(|a, b| a.name.cmp(&b.name));
    let mut records = vec![];
    let commit = formats::run::commit();
    for (object, path) in objects.iter().filter_map(|o| match &o.source {
        Source::File(path) => Some((o, path)),
        Source::Sequence(_) | Source::Procedural { .. } => None,
    }) {
        if records.iter().any(|r: &ObjectRecord| r.object == object.name) {
            let place = formats::Place::File;
            return Err(FormatError::syntax(path, place, format!("a second object {:?}", object.name), "other names"));
        }
        let samples = to_samples(&object.name, &read_frame_history(path)?);
        let shard = shard_path(out, &object.name);
        let record = ObjectRecord {
            object: object.name.clone(),
            category: object.category.clone(),
            split: object.split,
            fate: Fate::Done {
                shard: format!("shards/{}.safetensors", object.name),
                samples: samples.len(),
                coverage: vec![],
                overlap: vec![],
                void_episodes: 0,
            },
        };
        let metadata = ShardMetadata {
            schema_version: SCHEMA_VERSION,
            sha256: String::new(),
            config_hash: "frame-history".to_owned(),
            seed,
            commit: commit.clone(),
            objects: vec![record.clone()],
        };
        let mut writer = ShardWriter::new(metadata, CloudPrecision::F32);
        for sample in &samples {
            writer.push(sample)?;
        }
        writer.write(&shard)?;
        records.push(record);
    }
    let manifest = Manifest {
        schema_version: SCHEMA_VERSION,
        dataset: "frame-history".to_owned(),
        config_hash: "frame-history".to_owned(),
        seed,
        commit,
        objects: records,
    };
    manifest.write(out)?;
    Ok(manifest)
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

/// Writes a set as frame histories, `<out>/<object>.bin` with `/` in names as `_`. Samples with other than 20
/// candidates, or before which one was left out, cannot be said and are left out; their number is the second result.
///
/// # Errors
/// A shard that cannot be read; what cannot be written.
pub fn export(directory: &Path, out: &Path) -> Result<(usize, usize), FormatError> {
    let manifest = Manifest::read(directory)?;
    let (mut files, mut left_out) = (0, 0);
    for record in &manifest.objects {
        let Fate::Done { shard, .. } = &record.fate else { continue };
        let reader = ShardReader::open(&directory.join(shard))?;
        let samples: Vec<Sample> = (0..reader.len()).map(|i| reader.sample(i)).collect();
        let frames: Vec<Frame> = samples.iter().map_while(to_frame).collect();
        left_out += samples.len() - frames.len();
        if !frames.is_empty() {
            write_frame_history(&out.join(format!("{}.bin", record.object.replace('/', "_"))), &frames)?;
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
mod tests {
    use super::*;

    #[test]
    fn frames_become_samples_and_frames_again() {
        let directory = tempfile::tempdir().unwrap();
        let view = |i: usize| View {
            target: Point3::new(0.01 * i as f64, 0.0, 0.0),
            position: Point3::new(0.01 * i as f64, 0.0, 1.2),
        };
        let f32_exact = |i: usize| Point3::new(i as f64 / 64.0, (i * i % 7) as f64 / 32.0, 0.25);
        let frame = |k: usize| Frame {
            cloud: geometry::PointCloud {
                points: (0..40).map(f32_exact).collect(),
                normals: vec![nalgebra::Vector3::z(); 40],
            },
            current: view(k),
            next: view(7),
            candidates: (0..NUM_VIEWS).map(view).collect(),
            scores: (0..NUM_VIEWS).map(|i| if i == 7 { 0.9 } else { i as f64 / 40.0 }).collect(),
        };
        let frames: Vec<Frame> = (0..3).map(frame).collect();
        let bin = directory.path().join("teapot.bin");
        write_frame_history(&bin, &frames).unwrap();
        let set = directory.path().join("set");
        let manifest = import(std::slice::from_ref(&bin), &set, 0.2, 0).unwrap();
        assert_eq!(manifest.num_samples(), 3);
        assert!(crate::verify::verify(&set).unwrap().is_sound());
        assert_eq!(export(&set, &directory.path().join("back")).unwrap(), (1, 0));
        let back = read_frame_history(&directory.path().join("back/teapot.bin")).unwrap();
        for (a, b) in back.iter().zip(&frames) {
            assert_eq!((&a.cloud, &a.candidates, &a.scores, a.next), (&b.cloud, &b.candidates, &b.scores, b.next));
            assert!((a.current.target - b.current.target).norm() < 1e-12, "{:?} {:?}", a.current, b.current);
        }
    }

    fn becomes_a_set(bin: &Path) {
        let set = tempfile::tempdir().unwrap();
        let manifest = import(&[bin.to_owned()], set.path(), 0.2, 0).unwrap();
        assert_eq!(manifest.num_samples(), 3);
        assert!(crate::verify::verify(set.path()).unwrap().is_sound());
        let back = set.path().join("back");
        assert_eq!(export(set.path(), &back).unwrap(), (1, 0));
        let name = bin.file_name().unwrap();
        let (ours, theirs) = (read_frame_history(&back.join(name)).unwrap(), read_frame_history(bin).unwrap());
        for (a, b) in ours.iter().zip(&theirs) {
            assert_eq!(
                (a.cloud.len(), &a.candidates, &a.scores, a.next),
                (b.cloud.len(), &b.candidates, &b.scores, b.next)
            );
        }
    }

    #[test]
    fn an_independently_written_history_becomes_a_set() {
        becomes_a_set(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/frame_history.bin")));
    }

    #[test]
    fn bonus_the_published_history_becomes_a_set() {
        let bin =
            Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/golden/h_frame_history_teapot_3scans.bin"));
        if bin.exists() {
            becomes_a_set(bin);
        } else {
            println!("bonus test skipped: the published frame history is not beside this checkout");
        }
    }
}
