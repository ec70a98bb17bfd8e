//! A policy written in Python, as a planner of ours.

use crate::state::{State, ranking};
use planning::planner::checked;
use planning::{PlanError, Planner, RankedView, ScanState};
use pyo3::prelude::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A policy of a run.
pub struct PythonPolicy {
    name: String,
    /// With `rank_views`; or what makes such an object, for each episode anew.
    object: Py<PyAny>,
    makes: bool,
    allowed: Duration,
    /// Calls of one policy never overlap. Holds why it is not asked any more.
    given_up: Mutex<Option<String>>,
}

impl PythonPolicy {
    /// Of this name; a decision may take so long.
    pub fn new(name: String, object: Py<PyAny>, makes: bool, allowed: Duration) -> Self {
        Self { name, object, makes, allowed, given_up: Mutex::default() }
    }
}

/// In one episode.
pub struct PythonPlanner {
    policy: Arc<PythonPolicy>,
    /// Made for this episode.
    made: Option<Py<PyAny>>,
}

impl PythonPlanner {
    /// For an episode.
    pub fn new(policy: Arc<PythonPolicy>) -> Self {
        Self { policy, made: None }
    }

    fn ask(&mut self, py: Python<'_>, state: State, distance: f64) -> PyResult<Vec<RankedView>> {
        let policy = &self.policy;
        let object = match &self.made {
            Some(made) => made.clone_ref(py),
            None if policy.makes => self.made.insert(policy.object.call0(py)?).clone_ref(py),
            None => policy.object.clone_ref(py),
        };
        ranking(object.bind(py).call_method1("rank_views", (state,))?.as_any(), distance)
    }
}

impl Planner for PythonPlanner {
    fn name(&self) -> &str {
        &self.policy.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let seen = State::new(state, rng.random());
        let policy = Arc::clone(&self.policy);
        // Taken without the interpreter: who holds it may need that.
        let mut given_up = policy.given_up.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(why) = &*given_up {
            return Err(PlanError::failed(&policy.name, format!("{why}; it was not asked again")));
        }
        let (answer, took) = Python::attach(|py| {
            let clock = Instant::now();
            let answer = self.ask(py, seen, state.working_distance).map_err(|error| told(py, &error));
            (answer, clock.elapsed())
        });
        if took > policy.allowed {
            let [took, allowed] = [took, policy.allowed].map(|t| t.as_secs_f64());
            let why = format!("rank_views took {took:.1} s, allowed {allowed} s (decision_s)");
            *given_up = Some(why.clone());
            return Err(PlanError::failed(&policy.name, why));
        }
        let views = answer.map_err(|why| PlanError::failed(&policy.name, why))?;
        checked(&policy.name, views, PlanError::no_view(&policy.name, "it offered none"))
    }
}

/// An exception in one line, with where it was raised.
fn told(py: Python<'_>, error: &PyErr) -> String {
    let kind = error.get_type(py).name().map_or_else(|_| "an exception".to_owned(), |name| name.to_string());
    let mut text = format!("{kind}: {}", error.value(py)).replace('\n', " ");
    let mut frame = error.traceback(py).map(Bound::into_any);
    let mut place = None;
    while let Some(here) = frame {
        let line = here.getattr("tb_lineno").and_then(|line| line.extract::<usize>());
        let file =
            here.getattr("tb_frame").and_then(|f| f.getattr("f_code")?.getattr("co_filename")?.extract::<String>());
        place = file.ok().zip(line.ok()).or(place);
        frame = here.getattr("tb_next").ok().filter(|next| !next.is_none());
    }
    if let Some((file, line)) = place {
        let file = std::path::Path::new(&file).file_name().map_or(file.clone(), |f| f.to_string_lossy().into_owned());
        text += &format!(" ({file}, line {line})");
    }
    text
}
