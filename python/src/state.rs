//! What a policy may see, and what it answers.

use crate::arrays;
use crate::fault::Fault;
use geometry::{View, rng};
use nalgebra::{Isometry3, Point3};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use planning::{CandidateConfig, RankedView, ScanState, Seen, candidate_views};
use pyo3::prelude::*;

/// Views that a policy may offer at one decision.
const MOST_VIEWS: usize = 10_000;

/// All that a policy may see: what was measured, and from where. World frame, metres. Every access to an array makes a new
/// one.
#[pyclass(frozen, module = "benbv")]
pub struct State {
    state: ScanState,
    /// For the policy's own random numbers: drawn from the named stream of the episode.
    #[pyo3(get)]
    seed: u64,
}

impl State {
    /// As it is now.
    pub fn new(state: &ScanState, seed: u64) -> Self {
        Self { state: state.clone(), seed }
    }
}

#[pymethods]
impl State {
    /// (N, 3): the accumulated cloud.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::of_points(py, self.state.cloud.points.clone())
    }

    /// (N, 3): its normals, towards the cameras, not of unit length; (0, 3) where there are none.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::of_vectors(py, self.state.cloud.normals.clone())
    }

    /// (4, 4) `world_from_camera` of every past scan whose camera is known or estimated, oldest first.
    #[getter]
    fn cameras<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        self.state.scans.iter().map(|scan| arrays::of_pose(py, &scan.world_from_camera)).collect()
    }

    /// The depth image (height, width) of a past scan, 0 where a pixel has no return; None where only points are known.
    fn depth<'py>(&self, py: Python<'py>, scan: usize) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let Some(past) = self.state.scans.get(scan) else {
            let found = format!("scan {scan}: there are {}", self.state.scans.len());
            return Err(Fault::Value(found).into());
        };
        match &past.seen {
            Seen::Points(_) => Ok(None),
            Seen::Depth { camera, depth, .. } => of_depth(py, camera.width, camera.height, depth).map(Some),
        }
    }

    /// Number of scans so far.
    #[getter]
    fn num_scans(&self) -> usize {
        self.state.num_scans
    }

    /// Distance from target to camera that the next view shall have.
    #[getter]
    fn working_distance(&self) -> f64 {
        self.state.working_distance
    }

    /// Distance under which two points count as the same surface.
    #[getter]
    fn tolerance(&self) -> f64 {
        self.state.tolerance
    }

    /// Mean distance of neighbouring points.
    #[getter]
    fn spacing(&self) -> f64 {
        self.state.grid_size
    }

    /// (width, height) in pixels of the camera that takes the next scan.
    #[getter]
    fn image_size(&self) -> (u32, u32) {
        (self.state.camera.width, self.state.camera.height)
    }

    /// (3, 3): its intrinsics.
    #[getter]
    fn intrinsics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let c = &self.state.camera;
        arrays::of_rows(py, [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])
    }

    /// (4, 4) each: the candidates that BENBV makes at the boundary of the cloud; none where it has no boundary.
    fn candidates<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let views = py.detach(|| {
            let config = CandidateConfig::default();
            let near = self.state.neighborhoods(config.boundary.neighbors);
            let mut rng = rng::stream(self.seed, "candidates");
            candidate_views(&self.state.cloud, &near, self.state.working_distance, &config, &mut rng)
        });
        views.iter().map(|c| arrays::of_pose(py, &c.view.world_from_camera())).collect()
    }

    fn __repr__(&self) -> String {
        format!("<benbv.State of {} scans, {} points>", self.state.num_scans, self.state.cloud.len())
    }
}

/// The whole image of which a window is stored.
pub fn of_depth<'py>(
    py: Python<'py>,
    width: u32,
    height: u32,
    depth: &geometry::DepthImage,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let [width, height] = [width as usize, height as usize];
    let ([left, top], columns) = (depth.origin.map(|o| o as usize), depth.size[0] as usize);
    let mut whole = vec![0f32; width * height];
    for (row, values) in depth.depth.chunks_exact(columns.max(1)).enumerate() {
        let start = (top + row) * width + left;
        whole[start..start + columns].copy_from_slice(values);
    }
    PyArray1::from_vec(py, whole).reshape([height, width])
}

/// The pose of a camera at `position` that looks at `target`, with image-up as near to `up` as can be.
#[pyfunction]
#[pyo3(signature = (position, target, up=None))]
pub fn look_at<'py>(
    py: Python<'py>,
    position: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    up: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let view = View { position: arrays::position("position", position)?, target: arrays::position("target", target)? };
    if !view.is_valid() {
        return Err(Fault::Value("position and target are one point: there is no direction to look in".into()).into());
    }
    let up = up.map(|up| arrays::position("up", up)).transpose()?.unwrap_or(Point3::new(0.0, 0.0, 1.0));
    arrays::of_pose(py, &view.world_from_camera_with_up(&up.coords))
}

/// A pose as it is given: a matrix, or anything that has one as its `world_from_camera`.
pub fn pose_of(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Isometry3<f64>> {
    match value.getattr_opt("world_from_camera")? {
        Some(matrix) => arrays::pose(name, &matrix),
        None => arrays::pose(name, value),
    }
}

/// What `rank_views` returned, best first.
pub fn ranking(answer: &Bound<'_, PyAny>, working_distance: f64) -> PyResult<Vec<RankedView>> {
    let wrong = |found: String| Fault::Value(format!("{found}, expected a list of (view, score)"));
    if answer.is_none() {
        return Err(wrong("rank_views returned None".to_owned()).into());
    }
    let items = answer.try_iter().map_err(|_| wrong(format!("rank_views returned {}", shown(answer))))?;
    let mut views = Vec::new();
    for (i, item) in items.enumerate() {
        let item = item?;
        let (view, score): (Bound<'_, PyAny>, f64) =
            item.extract().map_err(|_| wrong(format!("rank_views returned {} as number {i}", shown(&item))))?;
        if !score.is_finite() {
            return Err(Fault::Value(format!("the score of view {i} is {score}, expected a finite number")).into());
        }
        let pose = pose_of(&format!("view {i}"), &view)?;
        views.push(RankedView::scored(View::from_pose(&pose, working_distance), score));
        if views.len() > MOST_VIEWS {
            return Err(Fault::Value(format!("more than {MOST_VIEWS} views")).into());
        }
    }
    views.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(views)
}

/// A value in few words.
fn shown(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "something odd".to_owned(), |name| format!("a {name}"))
}
