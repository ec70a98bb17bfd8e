//! The objects of a run: meshes at the working size with samples of their surfaces.

use crate::config::{EvaluateConfig, Surface, TableConfig};
use crate::networks::Networks;
use crate::policies::{PolicyContext, PolicyError, make};
use datagen::{EpisodeConfig, RenderConfig, Scene};
use geometry::rng::stream;
use geometry::sampling::poisson_disk_sample;
use geometry::{Mesh, NeighborGrid};
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// An object ready to be scanned.
pub struct Object {
    /// Its name in the results.
    pub name: String,
    /// The mesh in the simulator.
    pub scene: Scene,
    /// Surface samples, not yet averaged.
    pub samples: Vec<Point3<f64>>,
    /// Least height of a camera, where the object stands on a table.
    pub least_z: Option<f64>,
}

/// Where an object comes from.
pub struct Source {
    name: String,
    path: PathBuf,
}

impl Source {
    /// The object's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Reads, scales and samples it.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn prepare(&self, config: &EvaluateConfig) -> Result<Object, String> {
        let mesh = formats::read_mesh(&self.path).map_err(|e| e.to_string())?;
        prepare(&self.name, Some(&self.path), &mesh, config)
    }
}

/// Why there are no objects.
#[derive(Debug, thiserror::Error)]
#[error("{root:?}: found {found}, expected mesh files (.obj, .ply, .stl, .off); give the folder with --root")]
pub struct NoObjects {
    root: PathBuf,
    found: String,
}

/// The objects of a run, by name.
///
/// # Errors
/// None there.
pub fn list(config: &EvaluateConfig) -> Result<Vec<Source>, NoObjects> {
    let root = config.root.clone();
    let entries = std::fs::read_dir(&root).map_err(|e| NoObjects { root: root.clone(), found: e.to_string() })?;
    let mut sources: Vec<Source> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| matches!(p.extension().and_then(|e| e.to_str()), Some("obj" | "ply" | "stl" | "off")))
        .map(|path| Source { name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), path })
        .filter(|s| config.objects.is_empty() || config.objects.contains(&s.name))
        .collect();
    sources.sort_by(|a, b| a.name.cmp(&b.name));
    if sources.is_empty() {
        return Err(NoObjects { root, found: "no object of the names asked for".to_owned() });
    }
    Ok(sources)
}

/// Makes a policy once, on a stand-in object, to see whether its name and weights are good.
///
/// # Errors
/// Why it cannot run.
pub fn try_policy(policy: &str, config: &EvaluateConfig, networks: &Networks) -> Result<(), PolicyError> {
    let scene = Scene::new(Mesh::default());
    make(policy, &PolicyContext { scene: &scene, samples: &[], config, networks }).map(drop)
}

/// Centres and scales a mesh and samples its surface. `path` is where it came from, if from a file.
///
/// # Errors
/// Published samples that cannot be read; a mesh without surface.
pub fn prepare(name: &str, path: Option<&Path>, mesh: &Mesh, config: &EvaluateConfig) -> Result<Object, String> {
    let mesh = mesh.normalized(config.diagonal_m);
    let published = match (config.surface, path) {
        (Surface::Published, Some(path)) => Some(published_samples(path)).filter(|p| p.exists()),
        _ => None,
    };
    let mut samples = match published {
        Some(file) => {
            let scale = config.diagonal_m / 0.2;
            let cloud = formats::read_cloud(&file).map_err(|e| e.to_string())?.cloud;
            cloud.points.into_iter().map(|p| p * scale).collect()
        }
        None => {
            let mut rng = stream(config.seed, &format!("surface/{name}"));
            poisson_disk_sample(&mesh, config.surface_samples, &mut rng)
        }
    };
    if samples.is_empty() {
        return Err("the mesh has no surface".to_owned());
    }
    let table_top = mesh.bounding_box().0.z;
    let scene = Scene::new(mesh);
    let least_z = config.table.as_ref().map(|table| {
        samples = visible_from_above(&scene, &samples, &config.episode, table);
        table_top + table.clearance_m
    });
    Ok(Object { name: name.to_owned(), scene, samples, least_z })
}

/// The authors' samples beside a mesh.
fn published_samples(mesh: &Path) -> PathBuf {
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    mesh.with_file_name(format!("{stem}_simple60k.npy"))
}

/// The samples that some view over the upper half of the sphere sees.
fn visible_from_above(
    scene: &Scene,
    samples: &[Point3<f64>],
    episode: &EpisodeConfig,
    table: &TableConfig,
) -> Vec<Point3<f64>> {
    let camera = episode.image.camera();
    let render = RenderConfig { noise: None, ..episode.render.clone() };
    let mut seen = Vec::new();
    for direction in crate::policies::sphere::fibonacci(2 * table.views).into_iter().filter(|d| d.z > 0.0) {
        let view = crate::policies::sphere::view_at(&direction, episode.working_distance_m);
        let pose = view.world_from_camera();
        seen.extend(scene.depth_image(&camera, &pose, &render).to_points(&camera, &pose));
    }
    let grid = NeighborGrid::new(&seen, 2.0 * episode.tolerance_m);
    samples.iter().copied().filter(|p| grid.any_within(p, episode.tolerance_m)).collect()
}
