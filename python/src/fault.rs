//! Why something is not done, and as which Python exception it is raised. No panic passes into Python.

use formats::{ConfigError, FormatError};
use model::NetPlannerError;
use model::checkpoint::CheckpointError;
use planning::SessionError;
use pyo3::create_exception;
use pyo3::exceptions::{
    PyFileExistsError, PyFileNotFoundError, PyOSError, PyPermissionError, PyRuntimeError, PyValueError,
};
use pyo3::prelude::*;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};

create_exception!(
    benbv,
    PlanError,
    PyRuntimeError,
    "There is no answer: no scan yet, a scan that cannot be registered, a planner that cannot work on these scans, a policy that fails."
);

/// What went wrong.
#[derive(Debug)]
pub enum Fault {
    /// What was given cannot be meant: `ValueError`.
    Value(String),
    /// No answer: `PlanError`.
    Plan(String),
    /// The system refuses: `OSError`.
    System(ErrorKind, String),
    /// Raised by Python code that was called.
    Raised(PyErr),
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Value(message) => PyValueError::new_err(message),
            Fault::Plan(message) => PlanError::new_err(message),
            Fault::System(ErrorKind::NotFound, message) => PyFileNotFoundError::new_err(message),
            Fault::System(ErrorKind::PermissionDenied, message) => PyPermissionError::new_err(message),
            Fault::System(ErrorKind::AlreadyExists, message) => PyFileExistsError::new_err(message),
            Fault::System(_, message) => PyOSError::new_err(message),
            Fault::Raised(error) => error,
        }
    }
}

impl From<PyErr> for Fault {
    fn from(error: PyErr) -> Self {
        Self::Raised(error)
    }
}

impl From<SessionError> for Fault {
    fn from(error: SessionError) -> Self {
        let message = error.to_string();
        match error {
            SessionError::Config(_)
            | SessionError::TooFewPoints { .. }
            | SessionError::TooSmall { .. }
            | SessionError::NoCurrentPosition
            | SessionError::DoubtedPosition { .. } => Self::Value(message),
            _ => Self::Plan(message),
        }
    }
}

impl From<FormatError> for Fault {
    fn from(error: FormatError) -> Self {
        let message = error.to_string();
        match error {
            FormatError::Io { cause, .. } => Self::System(cause.kind(), message),
            _ => Self::Value(message),
        }
    }
}

impl From<anyhow::Error> for Fault {
    fn from(error: anyhow::Error) -> Self {
        let message = formats::program::with_causes(error.as_ref());
        let system = error.chain().find_map(|cause| {
            let format = cause.downcast_ref().and_then(|e| match e {
                FormatError::Io { cause, .. } => Some(cause),
                _ => None,
            });
            let config = cause.downcast_ref().and_then(|e| match e {
                ConfigError::Io { cause, .. } => Some(cause),
                _ => None,
            });
            let weights = cause.downcast_ref().and_then(|e| match e {
                NetPlannerError::Checkpoint(CheckpointError::Io { cause, .. }) => Some(cause),
                _ => None,
            });
            format.or(config).or(weights).or(cause.downcast_ref()).map(std::io::Error::kind)
        });
        match system {
            Some(kind) => Self::System(kind, message),
            None => Self::Value(message),
        }
    }
}

/// A fault of ours, as far as is known.
pub fn internal() -> Fault {
    Fault::Plan("an internal error, reported on stderr: please report it with the request that caused it".to_owned())
}

/// Does it; a panic becomes an exception.
pub fn guarded<T>(work: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| Err(internal()))
}

/// [`guarded`], with the interpreter free for other threads.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, Fault> + Send) -> PyResult<T> {
    py.detach(|| guarded(work)).map_err(PyErr::from)
}
