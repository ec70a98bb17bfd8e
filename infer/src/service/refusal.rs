//! Why a request gets no answer.

use planning::{SessionError, Stopped};
use serde_json::{Value, json};

/// An HTTP status, a word for programs, a sentence for people.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Refusal {
    /// HTTP status.
    pub status: u16,
    /// For programs.
    pub code: &'static str,
    /// For people.
    pub message: String,
    /// Methods that the path answers, of a 405.
    pub allow: Option<&'static str>,
}

impl Refusal {
    /// A refusal.
    pub fn new(status: u16, code: &'static str, message: impl Into<String>) -> Self {
        Self { status, code, message: message.into(), allow: None }
    }

    /// The service does not start what it could not finish.
    pub fn stopping() -> Self {
        Self::new(503, "stopping", "the service is stopping: start it again and repeat the request")
    }

    /// No time left.
    pub fn late() -> Self {
        Self::new(504, "deadline", Stopped::Late.to_string())
    }

    /// Others are before this one for longer than it may take.
    pub fn busy() -> Self {
        Self::new(503, "busy", "other requests were served until this request's deadline passed: try again")
    }

    /// The time was spent on reading the session from disk, which is not done yet.
    pub fn loading(read: usize, scans: usize) -> Self {
        let message = format!(
            "{read} of the session's {scans} scans have been read from disk so far: repeat the request, which goes on from there"
        );
        Self::new(503, "loading", message)
    }

    /// A fault of the service's own.
    pub fn internal() -> Self {
        Self::new(500, "internal", "this request failed inside the service; others are not affected")
    }

    /// Whether the same request may fare better later: such refusals are not kept for repetition.
    pub fn is_passing(&self) -> bool {
        self.status >= 500 || matches!(self.status, 408 | 429)
    }

    /// `{"error": {"code", "message"}}`.
    pub fn to_json(&self) -> Value {
        json!({ "error": { "code": self.code, "message": self.message } })
    }
}

impl From<SessionError> for Refusal {
    fn from(error: SessionError) -> Self {
        let (status, code) = match error {
            SessionError::Config(_) => (400, "bad_config"),
            SessionError::Choose(_) => (422, "planner_unusable"),
            SessionError::NoScan => (422, "no_scan"),
            SessionError::TooFewPoints { .. } => (422, "too_few_points"),
            SessionError::TooSmall { .. } => (422, "too_small"),
            SessionError::Unregistered { .. } => (422, "unregistered"),
            SessionError::Plan(_) => (422, "planner_failed"),
            SessionError::NoCurrentPosition | SessionError::DoubtedPosition { .. } => (422, "no_current_position"),
            SessionError::Check(_) => (502, "check_failed"),
            SessionError::NoTurntable(_) => (422, "no_turntable"),
            SessionError::Stopped(Stopped::Late) => return Self::late(),
            SessionError::Stopped(Stopped::Cancelled) => return Self::stopping(),
        };
        Self::new(status, code, error.to_string())
    }
}
