//! The simulator: an object, its scans, and the metrics.

use crate::arrays;
use crate::fault::{Fault, detached};
use crate::state::of_depth;
use datagen::RenderConfig;
use formats::config::overlaid;
use geometry::metrics::surface_distances;
use geometry::sampling::poisson_disk_sample;
use geometry::{PinholeCamera, rng};
use nalgebra::Point3;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

/// An object in the simulator: a mesh, in metres. Threads may share it.
#[pyclass(frozen, module = "benbv")]
pub struct Scene {
    pub scene: Arc<datagen::Scene>,
}

impl Scene {
    fn of(mesh: geometry::Mesh) -> Self {
        Self { scene: Arc::new(datagen::Scene::new(mesh)) }
    }
}

#[pymethods]
impl Scene {
    /// `vertices` (N, 3), metres; `faces` (M, 3), indices of vertices.
    #[new]
    fn new(py: Python<'_>, vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<Self> {
        let mesh = arrays::mesh(vertices, faces)?;
        detached(py, || Ok(Self::of(mesh)))
    }

    /// One of the built-in objects.
    #[staticmethod]
    #[pyo3(signature = (seed, number=0))]
    fn procedural(py: Python<'_>, seed: u64, number: u64) -> PyResult<Self> {
        detached(py, || Ok(Self::of(datagen::procedural::mesh(seed, number))))
    }

    /// The same object, centred on the mean of its vertices, its bounding box of this diagonal.
    #[pyo3(signature = (diagonal=0.2))]
    fn normalized(&self, py: Python<'_>, diagonal: f64) -> PyResult<Self> {
        if !(diagonal > 0.0 && diagonal.is_finite()) {
            return Err(Fault::Value(format!("diagonal: {diagonal}, expected a length above 0")).into());
        }
        detached(py, || Ok(Self::of(self.scene.mesh().normalized(diagonal))))
    }

    /// (N, 3): points spread evenly over the surface.
    #[pyo3(signature = (samples=60_000, seed=0))]
    fn surface<'py>(&self, py: Python<'py>, samples: usize, seed: u64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        const MOST: usize = 1_000_000;
        if !(1..=MOST).contains(&samples) {
            return Err(Fault::Value(format!("samples: {samples}, expected 1 to {MOST}")).into());
        }
        let points = detached(py, || {
            let mut rng = rng::stream(seed, "python/surface");
            poisson_disk_sample(self.scene.mesh(), samples, &mut rng).map_err(|e| Fault::Value(e.to_string()))
        })?;
        arrays::of_points(py, points)
    }

    /// (N, 3), metres.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::of_points(py, self.scene.mesh().vertices.clone())
    }

    /// (M, 3), indices of vertices.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let faces = self.scene.mesh().triangles.clone();
        let count = faces.len();
        PyArray1::from_vec(py, faces.into_flattened()).reshape([count, 3])
    }

    fn __repr__(&self) -> String {
        let mesh = self.scene.mesh();
        format!("<benbv.Scene of {} vertices, {} faces>", mesh.vertices.len(), mesh.triangles.len())
    }
}

/// A depth image of the scene. `render` is JSON over [`RenderConfig`].
#[pyfunction]
pub fn scan<'py>(
    py: Python<'py>,
    scene: &Scene,
    size: (u32, u32),
    intrinsics: [f64; 4],
    world_from_camera: &Bound<'py, PyAny>,
    render: &str,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let camera: PinholeCamera = arrays::camera(size.0, size.1, intrinsics)?;
    let pose = arrays::pose("world_from_camera", world_from_camera)?;
    let changes = serde_json::from_str(render).map_err(|e| Fault::Value(format!("render: {e}")))?;
    let render = overlaid(&RenderConfig::default(), changes, "render").map_err(Fault::Value)?;
    if let Some(noise) = &render.noise {
        let parts = [
            noise.axial_sigma_m,
            noise.lateral_sigma_px,
            noise.edge_dropout,
            noise.edge_step_m,
            noise.grazing_from_deg,
        ];
        if !(noise.axial_distance_m > 0.0 && parts.iter().all(|x| x.is_finite() && *x >= 0.0)) {
            return Err(Fault::Value("noise: expected numbers of 0 and above, axial_distance_m above 0".into()).into());
        }
    }
    let image = detached(py, || Ok(scene.scene.depth_image(&camera, &pose, &render)))?;
    of_depth(py, size.0, size.1, &image)
}

/// The world points of a depth image's pixels with a return, row by row.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, world_from_camera, metres_per_unit=None))]
pub fn depth_to_points<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    intrinsics: &Bound<'py, PyAny>,
    world_from_camera: &Bound<'py, PyAny>,
    metres_per_unit: Option<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let image = arrays::depth(depth, metres_per_unit)?.image;
    let camera = arrays::camera(image.size[0], image.size[1], arrays::intrinsics("intrinsics", intrinsics)?)?;
    let pose = arrays::pose("world_from_camera", world_from_camera)?;
    let points = detached(py, || Ok(image.to_points(&camera, &pose)))?;
    arrays::of_points(py, points)
}

/// The points that are somewhere.
fn known(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Point3<f64>>> {
    let mut points = arrays::points(name, value)?;
    points.retain(|p| p.iter().all(|x| x.is_finite()));
    Ok(points)
}

fn length(name: &str, value: f64) -> PyResult<()> {
    match value > 0.0 && value.is_finite() {
        true => Ok(()),
        false => Err(Fault::Value(format!("{name}: {value}, expected a length above 0")).into()),
    }
}

/// Share of the surface that has a point of the cloud nearer than `tolerance`.
#[pyfunction]
pub fn coverage(py: Python<'_>, cloud: &Bound<'_, PyAny>, surface: &Bound<'_, PyAny>, tolerance: f64) -> PyResult<f64> {
    length("tolerance", tolerance)?;
    let (cloud, surface) = (known("cloud", cloud)?, known("surface", surface)?);
    detached(py, || Ok(geometry::coverage(&cloud, &surface, tolerance)))
}

/// Share of the scan that has a point of the cloud nearer than `tolerance`; None for an empty scan.
#[pyfunction]
pub fn overlap(
    py: Python<'_>,
    scan: &Bound<'_, PyAny>,
    cloud: &Bound<'_, PyAny>,
    tolerance: f64,
) -> PyResult<Option<f64>> {
    length("tolerance", tolerance)?;
    let (scan, cloud) = (known("scan", scan)?, known("cloud", cloud)?);
    detached(py, || Ok(geometry::overlap(&scan, &cloud, tolerance)))
}

/// Chamfer and Hausdorff distance.
#[pyfunction]
pub fn distances(py: Python<'_>, a: &Bound<'_, PyAny>, b: &Bound<'_, PyAny>) -> PyResult<(f64, f64)> {
    let (a, b) = (known("a", a)?, known("b", b)?);
    let distances = detached(py, || Ok(surface_distances(&a, &b)))?;
    Ok((distances.chamfer, distances.hausdorff))
}
