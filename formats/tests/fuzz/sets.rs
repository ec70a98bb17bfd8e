//! Training samples: the authors' frame histories, and shards.

use crate::harness::{fuzz, seeds};
use formats::frame_history::parse_frame_history;
use formats::shard::{CloudPrecision, Sample, ShardMetadata, ShardReader, ShardWriter};
use formats::{ObjectRecord, ObjectStatus, Split};
use geometry::{PointCloud, View};
use nalgebra::{Isometry3, Point3, Vector3};
use planning::CandidateView;

fn sample() -> Sample {
    let view = View { target: Point3::new(0.1, 0.0, 0.0), position: Point3::new(0.0, 0.0, 1.2) };
    Sample {
        object: "a".into(),
        scan_index: 1,
        cloud: PointCloud { points: vec![Point3::new(0.1, 0.2, 0.3); 5], normals: vec![Vector3::z(); 5] },
        candidates: vec![CandidateView { view, density: 1.0 }; 3],
        coverage: vec![0.5; 3],
        overlap: vec![0.5; 3],
        scores: vec![0.5; 3],
        current_coverage: 0.4,
        working_distance: 1.2,
        cameras: vec![Isometry3::identity(); 2],
    }
}

#[test]
fn frame_history() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.bin");
    let Sample { cloud, candidates, .. } = sample();
    let view = candidates[0].view;
    let frame = formats::frame_history::Frame {
        cloud,
        current: view,
        next: view,
        candidates: vec![view; 20],
        scores: vec![0.5; 20],
    };
    formats::frame_history::write_frame_history(&path, &vec![frame; 3]).unwrap();
    let made = vec![std::fs::read(&path).unwrap()];
    fuzz("frame-history", &seeds("bin", made), |path, bytes| parse_frame_history(path, bytes).is_ok());
}

#[test]
fn shards() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("a.safetensors");
    let record =
        ObjectRecord { object: "a".into(), category: "c".into(), split: Split::Train, status: ObjectStatus::Missing };
    let mut writer =
        ShardWriter::new(ShardMetadata { objects: vec![record], ..Default::default() }, CloudPrecision::F32);
    (0..3).for_each(|_| writer.push(&sample()).unwrap());
    let made = vec![writer.to_bytes().unwrap()];
    fuzz("shard", &seeds("safetensors", made), |_, bytes| {
        // Behind the checksum, which would refuse all of them.
        let mut bytes = bytes.to_vec();
        formats::checksum::seal(&mut bytes, formats::shard::CHECKSUM);
        std::fs::write(&file, bytes).unwrap();
        let Ok(reader) = ShardReader::open(&file) else { return false };
        (0..reader.len()).for_each(|i| drop(reader.sample(i)));
        reader.verify().is_ok()
    });
}
