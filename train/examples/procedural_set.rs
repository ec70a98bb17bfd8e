//! A training set of procedural objects: one search episode per object, every decision with its scored candidates.
//! The quick way to data for trying things out; `datagen` is the full one.
//!
//! `cargo run --release -p train --example procedural_set -- OUT OBJECTS [SEED] [SECONDS]`
//!
//! One shard per object, one object in five for validation. Stops starting new objects after SECONDS. Threads:
//! `RAYON_NUM_THREADS`.

use datagen::{EpisodeConfig, Scene, SearchConfig, SearchPlanner, procedural, run_episode_with};
use formats::{CloudPrecision, Fate, Manifest, ObjectRecord, Sample, ShardMetadata, ShardWriter, Split};
use geometry::rng::stream;
use geometry::sampling::sample_surface;
use rayon::prelude::*;
use std::path::Path;
use std::time::{Duration, Instant};

/// Surface samples per object: enough for a voxel average at the spacing of a scan.
const SURFACE: usize = 60_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let out = Path::new(arguments.first().ok_or("usage: procedural_set OUT OBJECTS [SEED] [SECONDS]")?);
    let number = |i: usize, default: u64| arguments.get(i).map_or(Ok(default), |a| a.parse::<u64>());
    let (objects, seed, seconds) = (number(1, 40)?, number(2, 0)?, number(3, 86_400)?);
    let end = Instant::now() + Duration::from_secs(seconds);
    let records: Vec<ObjectRecord> =
        (0..objects).into_par_iter().filter(|_| Instant::now() < end).map(|i| object(out, seed, i)).collect();
    let manifest = Manifest {
        schema_version: formats::shard::SCHEMA_VERSION,
        dataset: "procedural-quick".into(),
        config_hash: format!("{objects}-objects"),
        seed,
        commit: formats::run::commit(),
        objects: records,
    };
    manifest.write(out)?;
    println!("{} objects, {} samples", manifest.objects.len(), manifest.num_samples());
    Ok(())
}

fn object(out: &Path, seed: u64, index: u64) -> ObjectRecord {
    let name = format!("procedural_{index:05}");
    let split = if index % 5 == 4 { Split::Validation } else { Split::Train };
    let fate = match samples(&name, seed, index) {
        Ok(samples) => {
            write(out, &name, split, seed, &samples).unwrap_or_else(|e| Fate::Skipped { reason: e.to_string() })
        }
        Err(reason) => Fate::Skipped { reason },
    };
    ObjectRecord { object: name, category: "procedural".into(), split, fate }
}

fn samples(name: &str, seed: u64, index: u64) -> Result<Vec<Sample>, String> {
    let scene = Scene::new(procedural::mesh(seed, index).normalized(0.2));
    let surface = sample_surface(scene.mesh(), SURFACE, &mut stream(seed, &format!("{name}/surface")));
    let config = EpisodeConfig::default();
    let search = SearchConfig::of(&config, Default::default());
    let mut planner = SearchPlanner::new(&scene, &surface, search);
    let mut samples = Vec::new();
    let mut rng = stream(seed, &format!("{name}/episode"));
    run_episode_with(&scene, &surface, &mut planner, &config, &mut rng, |planner, decision| {
        let scored = planner.last_decision();
        let list = |f: fn(&geometry::ViewScore) -> f64| scored.scores.iter().map(f).collect::<Vec<f64>>();
        if !scored.candidates.is_empty() {
            samples.push(Sample {
                object: name.to_string(),
                scan_index: decision.index,
                cloud: decision.state.cloud.clone(),
                candidates: scored.candidates.clone(),
                coverage: list(|s| s.coverage),
                overlap: list(|s| s.overlap.unwrap_or(0.0)),
                scores: list(|s| s.score),
                current_coverage: decision.current_coverage,
                working_distance: decision.state.working_distance,
                cameras: decision.state.scans.iter().map(|s| s.world_from_camera).collect(),
            });
        }
    })
    .map_err(|e| e.to_string())?;
    Ok(samples)
}

fn write(out: &Path, name: &str, split: Split, seed: u64, samples: &[Sample]) -> Result<Fate, formats::FormatError> {
    let shard = format!("{name}.safetensors");
    let fate = Fate::Done {
        shard: shard.clone(),
        samples: samples.len(),
        coverage: samples.iter().map(|s| s.current_coverage).collect(),
        overlap: vec![],
        void_episodes: 0,
    };
    let record = ObjectRecord { object: name.into(), category: "procedural".into(), split, fate: fate.clone() };
    let metadata = ShardMetadata { objects: vec![record], seed, ..Default::default() };
    let mut writer = ShardWriter::new(metadata, CloudPrecision::F16);
    for sample in samples {
        writer.push(sample)?;
    }
    writer.write(&out.join(shard))?;
    Ok(fate)
}
