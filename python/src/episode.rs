//! An episode step by step: the one loop of `datagen` runs on a separate thread and waits at each decision for what Python
//! decides.

use crate::arrays;
use crate::fault::{Fault, guarded, internal};
use crate::scene::Scene;
use crate::session::as_json;
use crate::state::{State, pose_of};
use datagen::{Episode as Outcome, EpisodeError, Progress, Stage, episode_session, run_session};
use evaluate::config::EvaluateConfig;
use evaluate::objects::{Body, prepare};
use evaluate::record::{EpisodeKey, EpisodeRecord};
use formats::config::overlaid;
use geometry::rng::stream;
use geometry::{PointCloud, View};
use numpy::PyArray2;
use planning::{PlanError, RankedView, ScanState, Session, Stopped};
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// What the loop says.
enum Told {
    /// A view is to be decided.
    Decide(Box<Now>),
    /// It ended.
    Ended(Box<Result<(Outcome, PointCloud), EpisodeError>>),
}

/// How far it is.
struct Now {
    state: ScanState,
    view: View,
    coverage: f64,
    overlap: Option<f64>,
}

struct Running {
    told: Receiver<Told>,
    decide: Option<Sender<View>>,
    views: Vec<View>,
    state: Option<ScanState>,
    /// What is planned on, at the end too.
    cloud: PointCloud,
    coverage: f64,
    overlap: Option<f64>,
    record: Option<EpisodeRecord>,
}

/// One episode on an object, as `evaluate` runs it.
#[pyclass(frozen, module = "benbv._benbv")]
pub struct Episode {
    running: Mutex<Running>,
    key: EpisodeKey,
    seed: u64,
}

/// The loop with all it needs.
fn start(scene: &datagen::Scene, key: &EpisodeKey, config: EvaluateConfig) -> Result<Running, Fault> {
    let object = prepare(&key.object, None, scene.mesh(), &config).map_err(|e| Fault::Value(e.to_string()))?;
    let Body::Mesh(object) = object.body else { return Err(internal()) };
    let mut rng = stream(config.seed, &format!("episode/{}/{}", key.object, key.episode));
    let (tell, told) = channel();
    let (decide, decided) = channel::<View>();
    let episode = config.episode;
    let the_loop = move || {
        let choose = |session: &mut Session, progress: &Progress, _: &mut ChaCha8Rng| {
            let Progress { view, coverage, overlap, .. } = *progress;
            let now = Now { state: session.state().clone(), view: *view, coverage, overlap };
            let gone = |_| PlanError::Stopped(Stopped::Cancelled);
            tell.send(Told::Decide(Box::new(now))).map_err(|_| gone(()))?;
            let view = decided.recv().map_err(|_| gone(()))?;
            Ok(vec![RankedView::scored(view, 0.0)])
        };
        let session = episode_session(&episode, &object.samples);
        let stage = Stage::Simulated { scene: &object.scene, samples: &object.samples };
        let ended = run_session(stage, session, &episode, &mut rng, choose)
            .map(|(outcome, session)| (outcome, session.cloud().clone()));
        let _ = tell.send(Told::Ended(Box::new(ended)));
    };
    std::thread::Builder::new()
        .name("episode".to_owned())
        .spawn(the_loop)
        .map_err(|e| Fault::System(e.kind(), format!("cannot start a thread: {e}")))?;
    let decide = Some(decide);
    Ok(Running {
        told,
        decide,
        views: Vec::new(),
        state: None,
        cloud: PointCloud::default(),
        coverage: 0.0,
        overlap: None,
        record: None,
    })
}

impl Running {
    /// Waits for what the loop says next.
    fn hear(&mut self, key: &EpisodeKey) -> Result<(), Fault> {
        match self.told.recv().map_err(|_| internal())? {
            Told::Decide(now) => {
                self.views.push(now.view);
                (self.coverage, self.overlap) = (now.coverage, now.overlap);
                self.cloud = now.state.cloud.clone();
                self.state = Some(now.state);
            }
            Told::Ended(outcome) => {
                let (outcome, cloud) = outcome.map_err(|e| Fault::Plan(e.to_string()))?;
                self.coverage = outcome.final_coverage();
                self.overlap = outcome.overlaps.last().copied().flatten();
                self.views = outcome.views.clone();
                self.record = Some(EpisodeRecord::new(key.clone(), &outcome));
                self.cloud = cloud;
                self.state = None;
                self.decide = None;
            }
        }
        Ok(())
    }
}

impl Episode {
    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Running) -> Result<T, Fault> + Send) -> PyResult<T> {
        py.detach(|| guarded(|| work(&mut self.running.lock().unwrap_or_else(PoisonError::into_inner))))
            .map_err(PyErr::from)
    }
}

#[pymethods]
impl Episode {
    #[new]
    fn new(py: Python<'_>, scene: &Scene, name: String, number: usize, config: &str) -> PyResult<Self> {
        let changes = serde_json::from_str(config).map_err(|e| Fault::Value(format!("config: {e}")))?;
        let config = overlaid(&EvaluateConfig::default(), changes, "config").map_err(Fault::Value)?;
        config.validate().map_err(|e| Fault::Value(e.to_string()))?;
        let (seed, scene) = (config.seed, Arc::clone(&scene.scene));
        let key = EpisodeKey { object: name, policy: "python".to_owned(), episode: number };
        let running = crate::fault::detached(py, || {
            let mut running = start(&scene, &key, config)?;
            running.hear(&key)?;
            Ok(running)
        })?;
        Ok(Self { running: Mutex::new(running), key, seed })
    }

    /// Takes this view and waits until the next one is to be decided, or the episode ends.
    fn step(&self, py: Python<'_>, view: &Bound<'_, PyAny>) -> PyResult<()> {
        let pose = pose_of("view", view)?;
        self.with(py, |running| {
            let (Some(decide), Some(state)) = (&running.decide, running.state.take()) else {
                return Err(Fault::Plan("the episode has ended: start another one".to_owned()));
            };
            decide.send(View::from_pose(&pose, state.working_distance)).map_err(|_| internal())?;
            running.hear(&self.key)
        })
    }

    /// What a policy may see now; None at the end.
    fn state(&self, py: Python<'_>) -> PyResult<Option<State>> {
        let seed = |scans: usize| {
            use rand::RngExt;
            stream(self.seed, &format!("python/{}/{}/{scans}", self.key.object, self.key.episode)).random()
        };
        self.with(py, |running| Ok(running.state.as_ref().map(|state| State::new(state, seed(state.num_scans)))))
    }

    /// Coverage now, overlap of the last scan with the cloud before it.
    fn progress(&self, py: Python<'_>) -> PyResult<(f64, Option<f64>)> {
        self.with(py, |running| Ok((running.coverage, running.overlap)))
    }

    /// Poses that were scanned from.
    fn views<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let views = self.with(py, |running| Ok(running.views.clone()))?;
        views.iter().map(|view| arrays::of_pose(py, &view.world_from_camera())).collect()
    }

    /// The accumulated cloud and its normals, at the end too.
    fn cloud<'py>(&self, py: Python<'py>) -> PyResult<arrays::CloudArrays<'py>> {
        let cloud = self.with(py, |running| Ok(running.cloud.clone()))?;
        Ok((arrays::of_points(py, cloud.points)?, arrays::of_vectors(py, cloud.normals)?))
    }

    /// The outcome as JSON; None before the end.
    fn record(&self, py: Python<'_>) -> PyResult<Option<String>> {
        self.with(py, |running| running.record.as_ref().map(as_json).transpose())
    }

    /// Ends it now: the loop's thread goes home.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |running| {
            (running.decide, running.state) = (None, None);
            Ok(())
        })
    }
}
