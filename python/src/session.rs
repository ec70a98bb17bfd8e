//! The session of a robot, for Python.

use crate::arrays;
use crate::fault::{Fault, guarded, internal};
use formats::config::load;
use geometry::{Lens, PointCloud};
use infer::changed_settings;
use infer::load::{DepthCamera, Loaded, Origin};
use infer::plan::Planned;
use nalgebra::Isometry3;
use numpy::{PyArray2, PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use planning::session::{AskedView, Request, Verdict, ViewCheck};
use planning::{Budget, NoReturn, Reading, Scan, SessionConfig};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;

/// A planning session. Threads may share it; one works on it at a time.
#[pyclass(frozen, name = "Session", module = "benbv._benbv")]
pub struct RobotSession {
    session: Mutex<planning::Session>,
    /// The thread that works on it.
    owner: Mutex<Option<ThreadId>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Settings: defaults, then a file, then changes as JSON.
pub fn settings(file: Option<&Path>, changes: &str) -> Result<SessionConfig, Fault> {
    let base: SessionConfig = load(file, &[], &[]).map_err(anyhow::Error::from)?;
    let changes = serde_json::from_str(changes).map_err(|e| Fault::Value(format!("config: {e}")))?;
    changed_settings(&base, changes).map_err(Fault::Value)
}

fn misses(text: Option<&str>, usual: NoReturn) -> Result<NoReturn, Fault> {
    match text {
        None => Ok(usual),
        Some("free") => Ok(NoReturn::Free),
        Some("unknown") => Ok(NoReturn::Unknown),
        Some(other) => Err(Fault::Value(format!("misses: {other:?}, expected \"free\" or \"unknown\""))),
    }
}

/// The kind that numpy has for a single value, its own or that of a library it can read: a float can be had of truths and whole numbers too.
fn scalar_kind(value: &Bound<'_, PyAny>) -> Option<u8> {
    let array = value.py().import("numpy").and_then(|numpy| numpy.call_method1("asarray", (value,))).ok()?;
    let array = array.cast_into::<PyUntypedArray>().ok()?;
    (array.ndim() == 0).then(|| array.dtype().kind())
}

/// What Python says of a view.
fn verdict(answer: &Bound<'_, PyAny>) -> PyResult<Verdict> {
    let no = |reason: String| Ok(Verdict::Unreachable { reason });
    if answer.is_none() {
        return Ok(Verdict::Reachable { cost: 0.0 });
    }
    if let Ok(reason) = answer.extract::<String>() {
        return no(reason);
    }
    // Of a whole number nobody knows whether it is meant as a cost, or as true or false.
    match scalar_kind(answer) {
        Some(b'b') if answer.is_truthy()? => return Ok(Verdict::Reachable { cost: 0.0 }),
        Some(b'b') => return no("not reachable".to_owned()),
        Some(b'f') => return Ok(Verdict::Reachable { cost: answer.extract()? }),
        _ => {}
    }
    if let Ok((reachable, said)) = answer.extract::<(bool, Bound<'_, PyAny>)>() {
        if let (true, Ok(cost)) = (reachable, said.extract::<f64>()) {
            return Ok(Verdict::Reachable { cost });
        }
        if let (false, Ok(reason)) = (reachable, said.extract::<String>()) {
            return no(reason);
        }
    }
    Err(PyTypeError::new_err(format!(
        "reachable returned {} ({}), expected True, a cost (float) or (True, cost), or False, the reason (str) or (False, reason)",
        answer.repr().map_or_else(|_| "?".to_owned(), |r| r.to_string()),
        answer.get_type()
    )))
}

/// Asks Python of each view, by its pose. What that raises is kept.
fn asking(check: Py<PyAny>, raised: Arc<Mutex<Option<PyErr>>>) -> ViewCheck {
    let ask = move |view: &AskedView| {
        Python::attach(|py| {
            let pose = arrays::of_matrix(py, &view.cell_from_camera.matrix)?;
            verdict(&check.bind(py).call1((pose,))?)
        })
    };
    ViewCheck::new(move |views, _| {
        views.iter().map(&ask).collect::<PyResult<_>>().map_err(|error| {
            *lock(&raised) = Some(error);
            "reachable raised an exception".to_owned()
        })
    })
}

impl RobotSession {
    /// Lets `work` have the session, other threads the interpreter. Where it panics, the session is as it was.
    pub fn work<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut planning::Session) -> Result<T, Fault> + Send,
    ) -> PyResult<T> {
        let me = std::thread::current().id();
        py.detach(|| {
            if *lock(&self.owner) == Some(me) {
                let message = "a session was asked for something by what it was itself waiting for (`reachable`)";
                return Err(Fault::Plan(message.to_owned()));
            }
            let mut session = lock(&self.session);
            *lock(&self.owner) = Some(me);
            let (scans, rejected_from) = (session.num_scans(), session.rejected_from().to_vec());
            let mut broke = true;
            let done = guarded(|| {
                let done = work(&mut session);
                broke = false;
                done
            });
            let restore = |session: &mut planning::Session| {
                session.restore(scans);
                session.set_rejected_from(rejected_from);
                Ok(())
            };
            if broke && guarded(|| restore(&mut session)).is_err() {
                session.reset();
            }
            *lock(&self.owner) = None;
            if broke { Err(internal()) } else { done }
        })
        .map_err(PyErr::from)
    }

    fn add(&self, py: Python<'_>, loaded: Loaded, table_angle_deg: Option<f64>) -> PyResult<String> {
        if let Some(angle) = table_angle_deg.filter(|angle| angle.is_nan() || angle.abs() >= 1e6) {
            return Err(Fault::Value(format!("table_angle_deg: {angle}, expected an angle in degrees")).into());
        }
        let Loaded { scan, mut reading } = loaded;
        reading.table_angle_deg = table_angle_deg;
        self.work(py, |session| {
            let notes = reading.notes.clone();
            let report = session.add_scan_within(scan, reading, &Budget::default())?;
            Ok(json!({ "scans": session.num_scans(), "report": report, "notes": notes }).to_string())
        })
    }
}

#[pymethods]
impl RobotSession {
    #[new]
    #[pyo3(signature = (config_file, config, weights))]
    fn new(py: Python<'_>, config_file: Option<PathBuf>, config: &str, weights: Option<PathBuf>) -> PyResult<Self> {
        let session = crate::fault::detached(py, || {
            let config = settings(config_file.as_deref(), config)?;
            Ok(planning::Session::new(config, Some(infer::weights::network(weights.as_deref(), infer::weights::CPU)?))?)
        })?;
        Ok(Self { session: Mutex::new(session), owner: Mutex::default() })
    }

    #[pyo3(signature = (depth, intrinsics, world_from_camera, misses, metres_per_unit, distortion, distortion_model, size, table_angle_deg))]
    fn add_depth(
        &self,
        py: Python<'_>,
        depth: &Bound<'_, PyAny>,
        intrinsics: &Bound<'_, PyAny>,
        world_from_camera: &Bound<'_, PyAny>,
        misses: Option<&str>,
        metres_per_unit: Option<f64>,
        distortion: Option<Vec<f64>>,
        distortion_model: &str,
        size: Option<[u32; 2]>,
        table_angle_deg: Option<f64>,
    ) -> PyResult<String> {
        let pose = arrays::pose("world_from_camera", world_from_camera)?;
        let intrinsics = arrays::intrinsics("intrinsics", intrinsics)?;
        let file = arrays::depth(depth, metres_per_unit)?;
        let usual = self.work(py, |session| Ok(session.config().misses))?;
        let misses = self::misses(misses, usual)?;
        let lens = distortion.map(|k| Lens::named(distortion_model, &k)).transpose();
        let lens = lens.map_err(|found| Fault::Value(format!("distortion: found {found}")))?.unwrap_or_default();
        // The unit of the image is known by now.
        let camera = DepthCamera { intrinsics, lens, size, metres_per_unit: None };
        let loaded = infer::load::from_depth_file(file, &camera, pose, misses).map_err(Fault::from)?;
        self.add(py, loaded, table_angle_deg)
    }

    #[pyo3(signature = (points, origin, world_from_camera, normals, table_angle_deg))]
    fn add_points(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        origin: Option<&Bound<'_, PyAny>>,
        world_from_camera: Option<&Bound<'_, PyAny>>,
        normals: Option<&Bound<'_, PyAny>>,
        table_angle_deg: Option<f64>,
    ) -> PyResult<String> {
        let points = arrays::points("points", points)?;
        let normals = normals.map(|n| arrays::vectors("normals", n)).transpose()?.unwrap_or_default();
        if !normals.is_empty() && normals.len() != points.len() {
            return Err(Fault::Value(format!("normals: {} for {} points", normals.len(), points.len())).into());
        }
        let from = match (origin, world_from_camera) {
            (Some(_), Some(_)) => {
                let message = "give origin or world_from_camera: both tell where the camera was";
                return Err(Fault::Value(message.to_owned()).into());
            }
            (Some(origin), None) => Some(arrays::origin("origin", origin)?),
            (None, Some(pose)) => {
                let pose = arrays::pose("world_from_camera", pose)?;
                let ahead = infer::load::check_ahead(&points, &pose);
                ahead.map_err(|e| Fault::Value(format!("world_from_camera: {e}")))?;
                Some(Origin::Point(pose.translation.vector.into()))
            }
            (None, None) => None,
        };
        let cloud = PointCloud { points, normals };
        let scan = match from.and_then(|from| from.path(1.0)) {
            Some(path) => Scan::Lines { cloud, path },
            None => Scan::Cloud { cloud, from: from.map(|from| from.middle(1.0)) },
        };
        self.add(
            py,
            Loaded { scan, reading: Reading { metres_per_unit: Some(1.0), ..Reading::default() } },
            table_angle_deg,
        )
    }

    /// A cloud in the bytes of a file; the extension of its name determines the format.
    #[pyo3(signature = (name, content, origin, millimetres, table_angle_deg))]
    fn add_bytes(
        &self,
        py: Python<'_>,
        name: &str,
        content: &[u8],
        origin: Option<&Bound<'_, PyAny>>,
        millimetres: Option<bool>,
        table_angle_deg: Option<f64>,
    ) -> PyResult<String> {
        let unit = millimetres.map(|mm| if mm { infer::Unit::Mm } else { infer::Unit::M });
        let origin = origin.map(|o| arrays::origin("origin", o)).transpose()?;
        let loaded = crate::fault::detached(py, || Ok(infer::load::cloud_bytes(name, content, unit, origin)?))?;
        self.add(py, loaded, table_angle_deg)
    }

    fn set_given_views(&self, py: Python<'_>, poses: Vec<Bound<'_, PyAny>>) -> PyResult<()> {
        let pose = |(i, pose): (usize, &Bound<'_, PyAny>)| arrays::pose(&format!("poses[{i}]"), pose);
        let poses: Vec<Isometry3<f64>> = poses.iter().enumerate().map(pose).collect::<PyResult<_>>()?;
        self.work(py, |session| {
            session.set_given_views(poses);
            Ok(())
        })
    }

    /// The answer, and why there is no view where there is none.
    #[pyo3(signature = (position, reachable, plan_views))]
    fn next_view(
        &self,
        py: Python<'_>,
        position: Option<&Bound<'_, PyAny>>,
        reachable: Option<Py<PyAny>>,
        plan_views: Option<usize>,
    ) -> PyResult<(String, Option<String>)> {
        let position = position.map(|p| arrays::position("position", p)).transpose()?;
        let raised = Arc::new(Mutex::new(None));
        let check = reachable.map(|check| asking(check, Arc::clone(&raised)));
        let current_position_m = position.map(|p| p.coords.into());
        let request = Request { current_position_m, check, ..Request::default() };
        self.work(py, |session| {
            let answer = session.next_view_for(&request);
            if let Some(error) = lock(&raised).take() {
                return Err(Fault::Raised(error));
            }
            let answer = answer?;
            let text = match plan_views {
                None => as_json(&answer)?,
                Some(most) => {
                    as_json(&Planned::new(session, &answer, most, current_position_m).map_err(Fault::Value)?)?
                }
            };
            Ok((text, answer.next.is_none().then(|| answer.no_view_reason())))
        })
    }

    fn configure(&self, py: Python<'_>, changes: &str) -> PyResult<()> {
        self.work(py, |session| {
            let changes = serde_json::from_str(changes).map_err(|e| Fault::Value(format!("config: {e}")))?;
            let config = changed_settings(session.config(), changes).map_err(Fault::Value)?;
            Ok(session.configure(config)?)
        })
    }

    fn config(&self, py: Python<'_>) -> PyResult<String> {
        self.work(py, |session| as_json(session.config()))
    }

    fn undo(&self, py: Python<'_>) -> PyResult<bool> {
        self.work(py, |session| Ok(session.undo()))
    }

    fn reset(&self, py: Python<'_>) -> PyResult<()> {
        self.work(py, |session| {
            session.reset();
            Ok(())
        })
    }

    /// (N, 3): where rejected scans were taken that views keep away from, for who saves the session.
    fn rejected_from<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let places = self.work(py, |session| Ok(session.rejected_from().to_vec()))?;
        arrays::of_points(py, places)
    }

    /// The same, of a session that was saved.
    fn set_rejected_from(&self, py: Python<'_>, places: &Bound<'_, PyAny>) -> PyResult<()> {
        let places = arrays::points("rejected_from", places)?;
        self.work(py, |session| {
            session.set_rejected_from(places);
            Ok(())
        })
    }

    fn num_scans(&self, py: Python<'_>) -> PyResult<usize> {
        self.work(py, |session| Ok(session.num_scans()))
    }

    fn cloud<'py>(&self, py: Python<'py>) -> PyResult<arrays::CloudArrays<'py>> {
        let cloud = self.work(py, |session| Ok(session.cloud().clone()))?;
        Ok((arrays::of_points(py, cloud.points)?, arrays::of_vectors(py, cloud.normals)?))
    }

    fn mesh<'py>(&self, py: Python<'py>) -> PyResult<arrays::MeshArrays<'py>> {
        let surface = self.work(py, |session| Ok(session.mesh()))?;
        arrays::of_mesh(py, surface.mesh)
    }
}

/// For Python's `json`, which reads every number as it was.
pub fn as_json(value: &impl serde::Serialize) -> Result<String, Fault> {
    serde_json::to_string(value).map_err(|e| Fault::Plan(format!("the answer cannot be written: {e}")))
}
