//! A data set of random clouds: 5,000 points and 20 candidates a sample.

use formats::{CloudPrecision, Manifest, ObjectRecord, ObjectStatus, Sample, ShardMetadata, ShardWriter, Split};
use geometry::{PointCloud, View, rng::stream};
use nalgebra::{Point3, Vector3};
use planning::CandidateView;
use rand::RngExt;
use std::path::Path;

/// A training object with this many samples, and one sample for validation.
pub fn write(dir: &Path, samples: usize) -> Result<(), Box<dyn std::error::Error>> {
    let mut objects = Vec::new();
    for (name, split, count) in [("train", Split::Train, samples), ("validation", Split::Validation, 1)] {
        let shard = format!("{name}.safetensors");
        let status = ObjectStatus::Done {
            shard: shard.clone(),
            samples: count,
            coverage: vec![],
            overlap: vec![],
            void_episodes: 0,
        };
        let record = ObjectRecord { object: name.into(), category: "random".into(), split, status };
        let metadata = ShardMetadata { objects: vec![record.clone()], ..Default::default() };
        let mut writer = ShardWriter::new(metadata, CloudPrecision::F32);
        for i in 0..count {
            writer.push(&sample(name, i))?;
        }
        writer.write(&dir.join(shard))?;
        objects.push(record);
    }
    let manifest = Manifest {
        schema_version: formats::shard::SCHEMA_VERSION,
        sha256: String::new(),
        dataset: "random".into(),
        config_hash: String::new(),
        seed: 0,
        commit: String::new(),
        objects,
    };
    Ok(manifest.write(dir)?)
}

fn sample(object: &str, index: usize) -> Sample {
    let mut rng = stream(0, &format!("{object}/{index}"));
    let mut unit = || Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5).normalize();
    let normals: Vec<Vector3<f64>> = (0..5000).map(|_| unit()).collect();
    let points: Vec<Point3<f64>> = normals.iter().map(|n| (n * 0.1).into()).collect();
    let view = |i: usize| View { target: points[i], position: points[i] + 1.2 * normals[i] };
    let candidates: Vec<CandidateView> = (0..20).map(|i| CandidateView { view: view(i), density: 300.0 }).collect();
    Sample {
        object: object.into(),
        scan_index: index % 15,
        cloud: PointCloud { points: points.clone(), normals },
        scores: (0..20).map(|i| 0.05 * i as f64).collect(),
        coverage: vec![0.5; 20],
        overlap: vec![0.4; 20],
        candidates,
        current_coverage: 0.5,
        working_distance: 1.2,
        cameras: vec![],
    }
}
