//! The objects of a run: meshes at the working size with samples of their surfaces, or recordings.

pub mod files;

use crate::config::{EvaluateConfig, Surface};
use datagen::dataset::{
    DatasetError, DatasetName, Object as Source, SplitChoice, list_objects, list_sequences, load_mesh,
};
use datagen::{Recording, Scene, visible_from};
use formats::sequence::read_sequence;
use geometry::Mesh;
use geometry::rng::stream;
use geometry::sampling::poisson_disk_sample;
use geometry::sphere::{fibonacci, view_at};
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// An object ready to be scanned.
pub struct Object {
    /// Its name in the results.
    pub name: String,
    /// What there is of it.
    pub body: Body,
    /// Digest of the files that it was read from; `None` of what is built in.
    pub files: Option<String>,
}

/// What there is of an object.
#[allow(clippy::large_enum_variant, reason = "a few per run")]
pub enum Body {
    /// Itself, in the simulator.
    Mesh(Meshed),
    /// Scans of it.
    Recorded(Recording),
}

/// A mesh in the simulator.
pub struct Meshed {
    /// The mesh in the simulator.
    pub scene: Scene,
    /// Surface samples, not yet averaged.
    pub samples: Vec<Point3<f64>>,
    /// Share of the surface that no camera around it sees, which is not among them (`reference_views`).
    pub left_out: f64,
    /// Least height of a camera, where the object stands on a table.
    pub least_z: Option<f64>,
}

impl Object {
    /// The mesh, unless it is a recording.
    pub fn mesh(&self) -> Option<&Meshed> {
        match &self.body {
            Body::Mesh(mesh) => Some(mesh),
            Body::Recorded(_) => None,
        }
    }
}

/// Why an object cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ObjectError {
    /// Its mesh or its published samples cannot be read.
    #[error(transparent)]
    Format(#[from] formats::FormatError),
    /// So much surface lies in one place that it cannot be sampled.
    #[error(transparent)]
    Dense(#[from] geometry::sampling::TooDense),
    /// There is nothing to sample.
    #[error("the mesh has no surface")]
    NoSurface,
}

/// Sets the built-in objects of an evaluation apart from those of a data set with the same seed.
const HELD_OUT: u64 = 0x7e57;

/// The objects of a run, by name.
///
/// # Errors
/// None there, with what is expected and where it is obtained.
pub fn list(config: &EvaluateConfig) -> Result<Vec<Source>, DatasetError> {
    let mut dataset = config.dataset.clone();
    if matches!(dataset.name, DatasetName::ModelNet40 | DatasetName::ShapeNet) {
        dataset.split.get_or_insert(SplitChoice::Test);
    }
    let mut sources = match dataset.name {
        DatasetName::Sequences => list_sequences(&dataset)?,
        _ => list_objects(&dataset, config.seed ^ HELD_OUT, 0.0)?,
    };
    let unknown = config.sequences.keys().find(|name| !sources.iter().any(|s| s.name == **name));
    if let Some(unknown) = unknown.filter(|_| dataset.name == DatasetName::Sequences) {
        let names: Vec<&str> = sources.iter().take(20).map(|s| s.name.as_str()).collect();
        let text = format!("sequences.{unknown}: no such sequence; there are {}", names.join(", "));
        return Err(DatasetError::Choice(text));
    }
    if let Some(missing) = config.only.iter().find(|name| !sources.iter().any(|s| s.name == **name)) {
        let names: Vec<&str> = sources.iter().take(20).map(|s| s.name.as_str()).collect();
        return Err(DatasetError::Choice(format!("--only {missing}: no such object; there are {}", names.join(", "))));
    }
    sources.retain(|s| config.only.is_empty() || config.only.contains(&s.name));
    Ok(sources)
}

/// Reads, scales and samples an object.
///
/// # Errors
/// Why it cannot be used.
pub fn load(source: &Source, config: &EvaluateConfig) -> Result<Object, ObjectError> {
    let path = match &source.source {
        datagen::dataset::Source::File(path) => Some(path.as_path()),
        datagen::dataset::Source::Procedural { .. } => None,
        datagen::dataset::Source::Sequence(path) => {
            let mut sequence = read_sequence(path)?;
            if let Some(said) = config.sequences.get(&source.name) {
                sequence.tolerance_m = said.tolerance_m.or(sequence.tolerance_m);
                sequence.region_m = said.region_m.or(sequence.region_m);
                sequence.background = said.background.or(sequence.background);
            }
            let body = Body::Recorded(Recording::new(sequence, config.episode.tolerance_m));
            return Ok(Object { name: source.name.clone(), body, files: files::digest_of(source, config.surface)? });
        }
    };
    let mesh = load_mesh(source)?;
    let object = prepare(&source.name, path, &mesh, config)?;
    Ok(Object { files: files::digest_of(source, config.surface)?, ..object })
}

/// Centres and scales a mesh and samples its surface. `path` is where it came from, if from a file.
///
/// # Errors
/// Published samples that cannot be read; a mesh without surface.
pub fn prepare(name: &str, path: Option<&Path>, mesh: &Mesh, config: &EvaluateConfig) -> Result<Object, ObjectError> {
    let mesh = mesh.normalized(config.diagonal_m);
    let mut samples = match path.and_then(|path| published_samples(path, config.surface)) {
        Some(file) => {
            let scale = config.diagonal_m / 0.2;
            let cloud = formats::read_cloud(&file)?.cloud;
            cloud.points.into_iter().map(|p| p * scale).collect()
        }
        None => {
            let mut rng = stream(config.seed, &format!("surface/{name}"));
            poisson_disk_sample(&mesh, config.surface_samples, &mut rng)?
        }
    };
    if samples.is_empty() {
        return Err(ObjectError::NoSurface);
    }
    let table_top = mesh.bounding_box().0.z;
    let around =
        |views| fibonacci(views).iter().map(|d| view_at(d, config.episode.working_distance_m)).collect::<Vec<_>>();
    let scene = Scene::new(mesh);
    let all = samples.len();
    if config.reference_views > 0 {
        samples = visible_from(&scene, &samples, &config.episode, around(config.reference_views));
    }
    let left_out = (all - samples.len()) as f64 / all as f64;
    let least_z = config.table.as_ref().map(|table| {
        let above = around(2 * table.views).into_iter().filter(|view| view.position.z > 0.0);
        samples = visible_from(&scene, &samples, &config.episode, above);
        table_top + table.clearance_m
    });
    if samples.is_empty() {
        return Err(ObjectError::NoSurface);
    }
    let body = Body::Mesh(Meshed { scene, samples, left_out, least_z });
    Ok(Object { name: name.to_owned(), body, files: None })
}

/// The authors' samples beside a mesh, if they are asked for and there.
fn published_samples(mesh: &Path, surface: Surface) -> Option<PathBuf> {
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let samples = mesh.with_file_name(format!("{stem}_simple60k.npy"));
    (surface == Surface::Published && samples.exists()).then_some(samples)
}

#[cfg(test)]
mod tests;
