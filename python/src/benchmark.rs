//! `evaluate` with own policies beside ours: the same objects, streams, journal and report as the program's.

use crate::fault::{Fault, guarded, internal};
use crate::policy::{PythonPlanner, PythonPolicy};
use crate::session::as_json;
use evaluate::batches::Watch;
use evaluate::config::EvaluateConfig;
use evaluate::networks::Networks;
use evaluate::objects::ObjectError;
use evaluate::policies::{Own, Policy, check};
use evaluate::record::EpisodeKey;
use evaluate::run::{Ended, ReportError, run};
use formats::config::{load, overlaid};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often it is asked whether Ctrl-C was pressed.
const LISTEN: Duration = Duration::from_millis(50);

/// A policy as Python names it.
#[derive(FromPyObject)]
pub struct Entrant {
    #[pyo3(item)]
    name: String,
    /// None: one of ours.
    #[pyo3(item)]
    object: Option<Py<PyAny>>,
    #[pyo3(item)]
    makes: bool,
    #[pyo3(item)]
    version: Option<String>,
}

/// Keeps what is said of objects.
#[derive(Default)]
struct Notes(Mutex<Vec<String>>);

impl Notes {
    fn note(&self, note: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(note);
    }
}

impl Watch for Notes {
    fn done(&self, _key: &EpisodeKey) {}

    fn unusable(&self, object: &str, reason: &ObjectError) {
        self.note(format!("{object}: not used: {reason}"));
    }

    fn left_out(&self, object: &str, policy: &str) {
        self.note(format!("{object} lacks the inputs of {policy}: left out"));
    }

    fn unseeable(&self, object: &str, share: f64) {
        self.note(format!("{object}: {:.1} % of its surface is seen by no camera and does not count", 100.0 * share));
    }

    fn outdated(&self, policy: &str, episodes: usize) {
        self.note(format!("{policy}: {episodes} episodes were run by another version, and were run again"));
    }
}

fn value(error: impl std::fmt::Display) -> Fault {
    Fault::Value(error.to_string())
}

fn policies(
    entrants: Vec<Entrant>,
    allowed: Duration,
    config: &EvaluateConfig,
    networks: &Networks,
) -> Result<Vec<Policy>, Fault> {
    let policy = |entrant: Entrant| {
        let Entrant { name, object, makes, version } = entrant;
        let policy = match object {
            None => name.parse().map_err(value)?,
            Some(object) => {
                let python = Arc::new(PythonPolicy::new(name.clone(), object, makes, allowed));
                let own = Own::new(version, move || Box::new(PythonPlanner::new(Arc::clone(&python))));
                Policy::own(&name, own).map_err(value)?
            }
        };
        check(&policy, config, networks).map_err(value)?;
        Ok(policy)
    };
    entrants.into_iter().map(policy).collect()
}

/// Runs it all, and answers with rows, episodes and notes as JSON.
#[pyfunction]
#[pyo3(name = "evaluate")]
pub fn benchmark(
    py: Python<'_>,
    entrants: Vec<Entrant>,
    config_file: Option<PathBuf>,
    changes: &str,
    out: PathBuf,
    decision_s: f64,
) -> PyResult<String> {
    let base: EvaluateConfig =
        load(config_file.as_deref(), &[], &[]).map_err(|e| Fault::from(anyhow::Error::from(e)))?;
    let changes = serde_json::from_str(changes).map_err(|e| value(format!("config: {e}")))?;
    let mut config = overlaid(&base, changes, "config").map_err(Fault::Value)?;
    config.policies = entrants.iter().map(|e| e.name.clone()).collect();
    // Own policies are often run without `benbv`, the default.
    if let (false, Some(first)) = (config.policies.contains(&config.baseline), config.policies.first()) {
        config.baseline.clone_from(first);
    }
    config.validate().map_err(value)?;
    let allowed = Duration::try_from_secs_f64(decision_s).map_err(|_| value(format!("decision_s: {decision_s}")))?;
    let networks = Networks::new(&config);
    let policies = policies(entrants, allowed, &config, &networks)?;
    let (stop, notes) = (AtomicBool::new(false), Notes::default());
    let mut interrupted = None;
    let ended = std::thread::scope(|scope| {
        let (tell, told) = channel();
        let told = Mutex::new(told);
        scope.spawn(|| {
            let tell = tell;
            let done = guarded(|| run(&out, &policies, &config, &networks, &stop, &notes).map_err(Fault::from));
            let _ = tell.send(done);
        });
        loop {
            match py.detach(|| told.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LISTEN)) {
                Ok(done) => break done,
                Err(RecvTimeoutError::Disconnected) => break Err(internal()),
                Err(RecvTimeoutError::Timeout) => {
                    if let Err(signal) = py.check_signals() {
                        stop.store(true, Ordering::Relaxed);
                        interrupted = Some(signal);
                    }
                }
            }
        }
    });
    match (ended?, interrupted) {
        (_, Some(signal)) => Err(signal),
        (Ended::Stopped { .. }, None) => Err(PyKeyboardInterrupt::new_err("stopped")),
        (Ended::Finished { rows, contents }, None) => {
            let records: Vec<_> = contents.episodes.iter().map(|(record, _)| record).collect();
            let notes = notes.0.into_inner().unwrap_or_else(PoisonError::into_inner);
            Ok(as_json(&json!({ "rows": rows, "episodes": records, "notes": notes }))?)
        }
    }
}

impl From<ReportError> for Fault {
    fn from(error: ReportError) -> Self {
        match error {
            ReportError::Format(error) => error.into(),
            ReportError::Nothing(nothing) => Self::Plan(nothing.to_string()),
            other => anyhow::Error::from(other).into(),
        }
    }
}
