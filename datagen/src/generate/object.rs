//! From one mesh to one shard.

use super::{GenerateError, Job, Outcome, lock, meshes, shard_path, skip_path};
use crate::dataset::{Object, load_mesh};
use crate::episode::{EpisodeError, run_episode_with};
use crate::scene::Scene;
use crate::search::SearchPlanner;
use formats::manifest::write_skipped;
use formats::run::remove_temporaries;
use formats::shard::SCHEMA_VERSION;
use formats::surface::{read_surface, write_surface};
use formats::{FormatError, ObjectRecord, ObjectStatus, Sample, ShardMetadata, ShardReader, ShardWriter};
use geometry::sampling::{TooDense, poisson_disk_sample};
use geometry::{Mesh, rng};
use nalgebra::Point3;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Keeps a shard that is whole ([`meshes::check`] has refused those of other meshes), and makes it otherwise.
pub(super) fn make(
    job: &Job,
    hash: &str,
    object: &Object,
    damaged: &Mutex<Vec<PathBuf>>,
) -> Result<Outcome, GenerateError> {
    let path = shard_path(job.out, &object.name);
    if path.exists() {
        match ShardReader::open(&path).and_then(|r| r.verify().map(|()| r.metadata().clone())) {
            Ok(metadata) => {
                if let Some(record) = metadata.objects.into_iter().next() {
                    return Ok(Outcome::Done { record, kept: true });
                }
            }
            Err(error) => {
                tracing::warn!("{error}; it is made anew");
                lock(damaged).push(path.clone());
            }
        }
    }
    remove_temporaries(&path);
    // A flaw of ours in one odd mesh must not cost the night's run: it is listed like any other reason.
    let made = catch_unwind(AssertUnwindSafe(|| scan_object(job, hash, object))).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        let reason = Unusable::Internal(text.unwrap_or("unknown").to_owned());
        tracing::error!("{}: {reason}", object.name);
        Ok(Err(reason))
    })?;
    let skip = skip_path(job.out, &object.name);
    match made {
        Ok((writer, record)) => {
            writer.write(&path)?;
            if skip.exists() {
                std::fs::remove_file(&skip).map_err(|e| FormatError::io(&skip, "remove", e))?;
            }
            Ok(Outcome::Done { record, kept: false })
        }
        Err(reason) => {
            let reason = reason.to_string();
            remove_temporaries(&skip);
            write_skipped(&skip, &object.name, &object.category, object.split, &reason)?;
            Ok(Outcome::Skipped(reason))
        }
    }
}

fn record(object: &Object, status: ObjectStatus) -> ObjectRecord {
    ObjectRecord { object: object.name.clone(), category: object.category.clone(), split: object.split, status }
}

/// Why an object cannot be used.
#[derive(Debug, thiserror::Error)]
enum Unusable {
    #[error(transparent)]
    Mesh(#[from] FormatError),
    #[error("the mesh has no extent")]
    NoExtent,
    #[error("the mesh has no area")]
    NoArea,
    #[error(transparent)]
    Dense(#[from] TooDense),
    #[error(transparent)]
    Void(#[from] EpisodeError),
    #[error("the first scan has no boundary: there is nothing to decide")]
    NoBoundary,
    #[error("internal error: {0}")]
    Internal(String),
}

/// One episode as a shard, or the reason why the object cannot be used. Errors are those that concern the run.
fn scan_object(
    job: &Job,
    hash: &str,
    object: &Object,
) -> Result<Result<(ShardWriter, ObjectRecord), Unusable>, FormatError> {
    let config = job.config;
    let (mesh, digest) = match load_mesh(object).and_then(|mesh| Ok((mesh, meshes::digest(object)?))) {
        Ok((mesh, digest)) => (mesh.normalized(config.object_diagonal_m), digest),
        Err(error) => return Ok(Err(error.into())),
    };
    let (low, high) = mesh.bounding_box();
    if (high - low).norm() == 0.0 {
        return Ok(Err(Unusable::NoExtent));
    }
    let samples = match surface_samples(job, object, &mesh)? {
        Ok(samples) => samples,
        Err(dense) => return Ok(Err(dense.into())),
    };
    if samples.is_empty() {
        return Ok(Err(Unusable::NoArea));
    }
    let scene = Scene::new(mesh);
    let mut planner = SearchPlanner::new(&scene, &samples, config.search());
    let mut stream = rng::stream(config.seed, &format!("object/{}/episode", object.name));
    let mut decisions: Vec<Sample> = vec![];
    let episode =
        run_episode_with(&scene, &samples, &mut planner, &config.episode, &mut stream, |planner, decision| {
            let scored = planner.last_decision();
            if scored.candidates.is_empty() {
                return;
            }
            decisions.push(Sample {
                object: object.name.clone(),
                scan_index: decision.state.num_scans.saturating_sub(1),
                cloud: decision.state.cloud.clone(),
                candidates: scored.candidates.clone(),
                coverage: scored.scores.iter().map(|s| s.coverage).collect(),
                overlap: scored.scores.iter().map(|s| s.overlap.unwrap_or(f64::NAN)).collect(),
                scores: scored.scores.iter().map(|s| s.score).collect(),
                current_coverage: decision.current_coverage,
                working_distance: decision.state.working_distance,
                cameras: decision.state.scans.iter().map(|s| s.world_from_camera).collect(),
            });
        });
    let episode = match episode {
        Ok(episode) => episode,
        Err(void) => return Ok(Err(void.into())),
    };
    if decisions.is_empty() {
        return Ok(Err(Unusable::NoBoundary));
    }
    let status = ObjectStatus::Done {
        shard: relative(job.out, &shard_path(job.out, &object.name)),
        samples: decisions.len(),
        coverage: episode.coverages.iter().map(|&c| nine_digits(c)).collect(),
        overlap: episode.overlaps.iter().map(|o| nine_digits(o.unwrap_or(0.0))).collect(),
        void_episodes: episode.void_draws,
    };
    let record = record(object, status);
    let metadata = ShardMetadata {
        schema_version: SCHEMA_VERSION,
        sha256: String::new(),
        config_hash: hash.to_owned(),
        seed: config.seed,
        commit: job.commit.to_owned(),
        mesh: digest,
        objects: vec![record.clone()],
    };
    let mut writer = ShardWriter::new(metadata, config.cloud_precision);
    for sample in &decisions {
        writer.push(sample)?;
    }
    Ok(Ok((writer, record)))
}

/// Few enough digits for any JSON reader to give back the same number.
fn nine_digits(x: f64) -> f64 {
    (x * 1e9).round() / 1e9
}

fn relative(out: &Path, path: &Path) -> String {
    let inner = path.strip_prefix(out).unwrap_or(path);
    inner.iter().map(|c| c.to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// The reference surface, from beside the shards where it was sampled before. Rounded to f32 in either case.
fn surface_samples(job: &Job, object: &Object, mesh: &Mesh) -> Result<Result<Vec<Point3<f64>>, TooDense>, FormatError> {
    let config = job.config;
    let path = job.out.join("surfaces").join(format!("{}-{}.safetensors", object.name, surface_key(config.seed, mesh)));
    if config.keep_surface_samples && path.exists() {
        match read_surface(&path) {
            Ok(points) => return Ok(Ok(points)),
            Err(error) => tracing::warn!("{error}; it is sampled anew"),
        }
    }
    let mut stream = rng::stream(config.seed, &format!("object/{}/surface", object.name));
    let points = match poisson_disk_sample(mesh, config.surface_samples, &mut stream) {
        Ok(points) => points,
        Err(dense) => return Ok(Err(dense)),
    };
    let points: Vec<_> = points.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
    if config.keep_surface_samples {
        remove_temporaries(&path);
        write_surface(&path, &points)?;
    }
    Ok(Ok(points))
}

/// Changes with the seed and the mesh: another mesh of the same name must not meet the old surface.
fn surface_key(seed: u64, mesh: &Mesh) -> String {
    let positions = mesh.vertices.iter().flat_map(|v| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    let indices = mesh.triangles.iter().flatten().map(|&i| u64::from(i));
    let numbers = std::iter::once(seed).chain(positions).chain(indices);
    // FNV-1a over words: names a file, guards nothing.
    let key =
        numbers.fold(0xcbf2_9ce4_8422_2325u64, |h, x| (h ^ x).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23));
    format!("{:08x}", (key as u32).swap_bytes())
}
