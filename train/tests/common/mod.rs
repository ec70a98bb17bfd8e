//! Synthetic data sets with a rule that a small network can learn.
#![allow(dead_code, missing_docs)]

pub mod kill;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use formats::{CloudPrecision, Manifest, ObjectRecord, ObjectStatus, Sample, ShardMetadata, ShardWriter, Split};
use geometry::rng::stream;
use geometry::{PointCloud, View};
use nalgebra::{Point3, Vector3};
use planning::CandidateView;
use rand::RngExt;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use train::augment::AugmentConfig;
use train::config::{EpisodesConfig, TrainConfig};
use train::{BenbvTask, Dataset, Outcome, Run, TrainError};

/// The CPU backend has one random generator for the whole process: trainings take turns.
pub fn one_at_a_time() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A decision about a random ellipsoid. The score rises with the z of a candidate's direction.
pub fn sample(object: &str, decision: usize, candidates: usize) -> Sample {
    let mut rng = stream(7, &format!("{object}/{decision}"));
    let mut unit = || {
        let v = Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5);
        v.try_normalize(1e-6).unwrap_or_else(Vector3::x)
    };
    let axes = Vector3::new(0.05, 0.07, 0.09);
    let normals: Vec<Vector3<f64>> = (0..150).map(|_| unit()).collect();
    let points: Vec<Point3<f64>> = normals.iter().map(|n| n.component_mul(&axes).into()).collect();
    let views: Vec<CandidateView> = points[..candidates]
        .iter()
        .map(|&target| CandidateView { view: View { target, position: target + 1.2 * unit() }, density: 300.0 })
        .collect();
    let scores: Vec<f64> = views.iter().map(|c| 0.5 + 0.4 * c.direction().z).collect();
    Sample {
        object: object.into(),
        scan_index: decision,
        cloud: PointCloud { points, normals },
        coverage: vec![0.5; candidates],
        overlap: vec![0.4; candidates],
        candidates: views,
        scores,
        current_coverage: 0.3,
        working_distance: 1.2,
        cameras: vec![],
    }
}

/// Writes a set: one object per list of samples, the named ones for validation.
pub fn write_set(dir: &Path, objects: &[(&str, Split, Vec<Sample>)]) {
    let mut records = Vec::new();
    for (name, split, samples) in objects {
        let shard = format!("{name}.safetensors");
        let record = ObjectRecord {
            object: (*name).into(),
            category: "synthetic".into(),
            split: *split,
            status: ObjectStatus::Done {
                shard: shard.clone(),
                samples: samples.len(),
                coverage: vec![],
                overlap: vec![],
                void_episodes: 0,
            },
        };
        let objects = vec![record.clone()];
        let metadata = ShardMetadata { config_hash: "none".into(), seed: 7, objects, ..Default::default() };
        let mut writer = ShardWriter::new(metadata, CloudPrecision::F32);
        for sample in samples {
            writer.push(sample).expect("a good sample");
        }
        writer.write(&dir.join(shard)).expect("written");
        records.push(record);
    }
    let manifest = Manifest {
        schema_version: formats::shard::SCHEMA_VERSION,
        sha256: String::new(),
        dataset: "synthetic".into(),
        config_hash: "none".into(),
        seed: 7,
        commit: "none".into(),
        objects: records,
    };
    manifest.write(dir).expect("a manifest");
}

/// A set of `train` + `validation` objects with four decisions each.
pub fn plain_set(dir: &Path, train: usize, validation: usize) {
    let names: Vec<String> = (0..train + validation).map(|i| format!("object{i}")).collect();
    let objects: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let split = if i < train { Split::Train } else { Split::Validation };
            // Numbers of candidates differ, so that masks are in play.
            (name.as_str(), split, (0..4).map(|d| sample(name, d, 8 - d)).collect())
        })
        .collect();
    write_set(dir, &objects);
}

/// Settings that take a second: a tiny network, no episodes.
pub fn tiny_config() -> TrainConfig {
    TrainConfig {
        seed: 5,
        epochs: 2,
        batch: 8,
        network: model::BenbvNetConfig::tiny(),
        augment: AugmentConfig { noise_m: 1e-4, dropout: 0.1, ..Default::default() },
        episodes: EpisodesConfig { every_epochs: 0, ..Default::default() },
        ..Default::default()
    }
}

/// Trains on the set in `data` until step `last`, or resumes that; checkpoints say that they were made of `a set`.
pub fn run_until(
    config: &TrainConfig,
    data: &Path,
    dir: &Path,
    resume: bool,
    last: u64,
) -> Result<Outcome, TrainError> {
    let data = Dataset::open(data, config.validation.fraction, config.seed)?;
    let stop = |step: u64| step >= last;
    let provenance = BTreeMap::from([("data".to_string(), "a set".to_string())]);
    let run = Run { dir, resume, quiet: true, stop: &stop, provenance };
    train::train(&BenbvTask::new(config, &data), config, &run)
}

/// [`run_until`] the end.
pub fn run(config: &TrainConfig, data: &Path, dir: &Path) -> Result<Outcome, TrainError> {
    run_until(config, data, dir, false, u64::MAX)
}

/// Weights and running statistics, one after the other.
pub fn all_numbers<M: Module>(net: &M) -> Vec<f32> {
    struct Collect(Vec<f32>);
    impl ModuleVisitor for Collect {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.0.extend(param.val().into_data().iter::<f32>());
        }
    }
    let mut collect = Collect(Vec::new());
    net.visit(&mut collect);
    collect.0
}
