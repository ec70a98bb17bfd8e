use super::*;
use crate::{FormatError, ObjectStatus, Split};
use geometry::View;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::path::Path;

fn record(name: &str) -> ObjectRecord {
    ObjectRecord { object: name.into(), category: "c".into(), split: Split::Train, status: ObjectStatus::Missing }
}

fn sample(object: &str, scan_index: usize, num_points: usize, num_candidates: usize) -> Sample {
    let value = |i: usize| 0.1 + i as f64 / 64.0; // exact in f32 after rounding below
    let point = |i: usize| Point3::new(value(i), -value(i), value(i) * 2.0).map(|x| f64::from(x as f32));
    let candidate = |i: usize| CandidateView {
        view: View { target: point(i), position: Point3::new(1.0 / 3.0, i as f64, 1.2) },
        density: 100.0 / (i + 1) as f64,
    };
    Sample {
        object: object.into(),
        scan_index,
        cloud: PointCloud {
            points: (0..num_points).map(point).collect(),
            normals: (0..num_points).map(|i| point(i).coords).collect(),
        },
        candidates: (0..num_candidates).map(candidate).collect(),
        coverage: (0..num_candidates).map(value).collect(),
        overlap: (0..num_candidates).map(|i| value(i) / 3.0).collect(),
        scores: (0..num_candidates).map(|i| value(i) / 7.0).collect(),
        current_coverage: 1.0 / 3.0,
        working_distance: 1.2,
        cameras: (0..=scan_index)
            .map(|i| {
                let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, i as f64));
                Isometry3::from_parts(Vector3::new(1.0, i as f64, 0.1).into(), rotation)
            })
            .collect(),
    }
}

fn write(path: &Path, samples: &[Sample], precision: CloudPrecision) {
    let mut objects: Vec<ObjectRecord> = Vec::new();
    for s in samples {
        if objects.iter().all(|o| o.object != s.object) {
            objects.push(record(&s.object));
        }
    }
    let metadata = ShardMetadata { config_hash: "abc".into(), seed: 7, objects, ..Default::default() };
    let mut writer = ShardWriter::new(metadata, precision);
    for s in samples {
        writer.push(s).unwrap();
    }
    writer.write(path).unwrap();
}

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.safetensors");
    let samples = [sample("x", 0, 50, 20), sample("x", 1, 0, 0), sample("y", 2, 3, 5)];
    write(&path, &samples, CloudPrecision::F32);
    let reader = ShardReader::open(&path).unwrap();
    assert_eq!(reader.len(), 3);
    assert_eq!(reader.metadata().seed, 7);
    reader.verify().unwrap();
    for (i, s) in samples.iter().enumerate() {
        assert_eq!(&reader.sample(i).unwrap(), s, "sample {i}");
    }
    let bytes = std::fs::read(&path).unwrap();
    write(&path, &samples, CloudPrecision::F32);
    assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same samples must give the same bytes");
}

#[test]
fn half_precision_clouds_are_within_their_bound() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.safetensors");
    let mut s = sample("x", 0, 40, 3);
    s.cloud.points.iter_mut().for_each(|p| *p *= 0.1);
    write(&path, std::slice::from_ref(&s), CloudPrecision::F16);
    let read = ShardReader::open(&path).unwrap().sample(0).unwrap();
    for (a, b) in read.cloud.points.iter().zip(&s.cloud.points) {
        assert!((a - b).amax() < 1e-4 * b.coords.amax().max(0.03) * 5.0, "{a} {b}");
    }
    assert_eq!(read.scores, s.scores, "only clouds lose digits");
}

#[test]
fn damage_is_found_and_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("chair_0007.safetensors");
    write(&path, &[sample("x", 0, 50, 20)], CloudPrecision::F32);
    let good = std::fs::read(&path).unwrap();
    crate::checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
        std::fs::write(&path, bad).unwrap();
        ShardReader::open(&path).map(drop).map_err(|e| e.to_string())
    });
    for length in (0..good.len()).step_by(97) {
        std::fs::write(&path, &good[..length]).unwrap();
        assert!(ShardReader::open(&path).is_err(), "{length} of {} bytes", good.len());
    }
    assert!(matches!(ShardReader::open(dir.path().join("none").as_path()), Err(FormatError::Io { .. })));
}

#[test]
fn a_shard_that_is_cut_or_replaced_while_it_is_open_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.safetensors");
    let first = [sample("x", 0, 5000, 20)];
    write(&path, &first, CloudPrecision::F32);
    let reader = ShardReader::open(&path).unwrap();
    assert_eq!(reader.sample(0).unwrap(), first[0]);
    std::fs::File::options().write(true).open(&path).unwrap().set_len(1000).unwrap();
    let text = reader.sample(0).expect_err("cut").to_string();
    assert!(text.contains("changed while it was in use") && text.contains("a.safetensors"), "{text}");
    write(&path, &[sample("x", 1, 5000, 20)], CloudPrecision::F32);
    assert!(matches!(reader.sample(0), Err(FormatError::Changed { .. })), "of the same length, but another");
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    let good = sample("x", 1, 9, 4);
    good.check().unwrap();
    let foreign = Sample { coverage: vec![f64::NAN; 4], current_coverage: f64::NAN, ..good.clone() };
    foreign.check().expect("NaN where a foreign set does not say");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.safetensors");
    let refused = |edit: &dyn Fn(&mut Sample), word: &str| {
        let mut bad = good.clone();
        edit(&mut bad);
        write(&path, &[good.clone(), bad], CloudPrecision::F32);
        let text = ShardReader::open(&path).unwrap().verify().expect_err(word).to_string();
        assert!(text.contains("sample 1") && text.contains(word), "{word}: {text}");
    };
    refused(&|s| s.cloud.points[3].x = f64::NAN, "point 3");
    refused(&|s| s.cloud.normals[2].y = f64::INFINITY, "normal 2");
    refused(&|s| s.candidates[1].density = -1.0, "candidate 1");
    refused(&|s| s.candidates[1].density = f64::INFINITY, "candidate 1");
    refused(&|s| s.scores[2] = f64::NAN, "score 2 is NaN");
    refused(&|s| s.coverage[0] = -0.1, "coverage -0.1");
    refused(&|s| s.overlap[0] = 1.5, "overlap 1.5");
    refused(&|s| s.current_coverage = -1.0, "current_coverage -1");
    refused(&|s| s.working_distance = f64::NAN, "working_distance NaN");
    refused(&|s| s.working_distance = -1.2, "working_distance -1.2");
    refused(&|s| s.cameras[1].translation.vector.z = f64::NAN, "camera 1");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn any_mutation_is_an_error_or_a_shard(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.safetensors");
        write(&path, &[sample("x", 0, 9, 4), sample("x", 1, 5, 2)], CloudPrecision::F32);
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        crate::checksum::seal(&mut bytes, CHECKSUM);
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(reader) = ShardReader::open(&path) {
            for i in 0..reader.len() {
                let _ = reader.sample(i).map(|s| s.check());
            }
        }
    }
}

#[cfg(unix)]
#[test]
fn what_is_no_file_is_refused_and_not_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let text = |path: &Path| {
        [ShardReader::open(path).map(drop), ShardReader::peek(path).map(drop)]
            .map(|read| read.expect_err("no file").to_string())
    };
    for text in text(dir.path()) {
        assert!(text.contains("found a directory, expected a file"), "{text}");
    }
    let endless = dir.path().join("a.safetensors");
    std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
    for text in text(&endless) {
        assert!(text.contains("a.safetensors") && text.contains("found a pipe, socket or device"), "{text}");
    }
}
