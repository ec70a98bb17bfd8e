//! What the service answers, whatever the way a request came: sessions by name, each with a planner's memory.

use crate::request::{CreateRequest, NextRequest, ScanRequest};
use planning::session::Request;
use planning::{Network, Session, SessionConfig, SessionError};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Limits of the service: fixed, no settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest request body, bytes.
    pub body: usize,
    /// Sessions at once; the one idle longest makes room if it is idle for longer than `idle`.
    pub sessions: usize,
    /// Scans of one session.
    pub scans: usize,
    /// Memory of one session's scans, bytes.
    pub memory: usize,
    /// A session not used for so long may be dropped.
    pub idle: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self { body: 64 << 20, sessions: 64, scans: 100, memory: 256 << 20, idle: Duration::from_secs(900) }
    }
}

/// Why a request gets no answer: an HTTP status, a word for programs, a sentence for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// HTTP status.
    pub status: u16,
    /// For programs.
    pub code: &'static str,
    /// For people.
    pub message: String,
}

impl Refusal {
    /// A refusal.
    pub fn new(status: u16, code: &'static str, message: impl Into<String>) -> Self {
        Self { status, code, message: message.into() }
    }

    /// `{"error": {"code", "message"}}`.
    pub fn to_json(&self) -> Value {
        json!({ "error": { "code": self.code, "message": self.message } })
    }
}

impl From<SessionError> for Refusal {
    fn from(error: SessionError) -> Self {
        let code = match error {
            SessionError::Config(_) => "bad_config",
            SessionError::Choose(_) => "planner_unusable",
            SessionError::NoScan => "no_scan",
            SessionError::TooFewPoints { .. } => "too_few_points",
            SessionError::TooSmall { .. } => "too_small",
            SessionError::Plan(_) => "planner_failed",
            SessionError::NoCurrentPosition => "no_current_position",
        };
        let status = if code == "bad_config" { 400 } else { 422 };
        Self::new(status, code, error.to_string())
    }
}

/// A request's body.
pub enum Body<'a> {
    /// As it came.
    Bytes(&'a [u8]),
    /// Already JSON.
    Value(Value),
}

impl Body<'_> {
    /// The body as what was asked for; an empty one is `{}`.
    fn parse<T: DeserializeOwned>(self) -> Result<T, Refusal> {
        let parsed = match self {
            Self::Bytes(bytes) if bytes.iter().all(u8::is_ascii_whitespace) => serde_json::from_slice(b"{}"),
            Self::Bytes(bytes) => serde_json::from_slice(bytes),
            Self::Value(Value::Null) => serde_json::from_slice(b"{}"),
            Self::Value(value) => serde_json::from_value(value),
        };
        parsed.map_err(|e| Refusal::new(400, "bad_request", format!("the body is not as expected: {e}")))
    }
}

/// What can be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Is the service there?
    Health,
    /// Names of the sessions.
    List,
    /// A new session.
    Create,
    /// One more scan.
    AddScan,
    /// The next view.
    NextView,
    /// Take the last scan back.
    Undo,
    /// Forget all scans.
    Reset,
    /// The accumulated cloud and the settings.
    Export,
    /// End the session.
    Delete,
}

struct Entry {
    session: Mutex<Session>,
    used: Mutex<Instant>,
}

/// All sessions.
pub struct Service {
    config: SessionConfig,
    network: Option<Network>,
    limits: Limits,
    sessions: Mutex<(u64, BTreeMap<u64, Arc<Entry>>)>,
}

/// A panic while a lock was held is answered as an error of that request; what it guarded is still whole or is reset.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Service {
    /// No session yet; each new one starts with `config`.
    pub fn new(config: SessionConfig, network: Option<Network>, limits: Limits) -> Self {
        Self { config, network, limits, sessions: Mutex::default() }
    }

    /// The limits.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Answers one request. `may_read_files`: whether a scan may be given as a path.
    ///
    /// # Errors
    /// What is wrong with the request.
    pub fn handle(
        &self,
        method: Method,
        session: Option<&str>,
        body: Body,
        may_read_files: bool,
    ) -> Result<Value, Refusal> {
        match method {
            Method::Health => {
                return Ok(
                    json!({ "status": "ok", "sessions": lock(&self.sessions).1.len(), "network": self.network.is_some() }),
                );
            }
            Method::List => {
                let names: Vec<String> = lock(&self.sessions).1.keys().map(u64::to_string).collect();
                return Ok(json!({ "sessions": names }));
            }
            Method::Create => return self.create(body.parse()?),
            _ => {}
        }
        let name = session.ok_or_else(|| Refusal::new(400, "no_session", "name the session (create one first)"))?;
        let unknown = || Refusal::new(404, "unknown_session", format!("there is no session {name:?}"));
        let id: u64 = name.parse().map_err(|_| unknown())?;
        if method == Method::Delete {
            let gone = lock(&self.sessions).1.remove(&id);
            return gone.map(|_| json!({ "deleted": name })).ok_or_else(unknown);
        }
        let entry = lock(&self.sessions).1.get(&id).cloned().ok_or_else(unknown)?;
        *lock(&entry.used) = Instant::now();
        let mut session = lock(&entry.session);
        match method {
            Method::AddScan => self.add_scan(&mut session, body.parse()?, may_read_files),
            Method::NextView => next_view(&mut session, body.parse()?),
            Method::Undo if session.undo() => Ok(json!({ "scans": session.num_scans() })),
            Method::Undo => Err(SessionError::NoScan.into()),
            Method::Reset => {
                session.reset();
                Ok(json!({ "scans": 0 }))
            }
            _ => Ok(export(&session)),
        }
    }

    fn create(&self, request: CreateRequest) -> Result<Value, Refusal> {
        let config = request.over(&self.config)?;
        let session = Session::new(config, self.network.clone())?;
        let mut sessions = lock(&self.sessions);
        if sessions.1.len() >= self.limits.sessions {
            let idle = sessions.1.iter().map(|(id, entry)| (*lock(&entry.used), *id)).min();
            match idle.filter(|(used, _)| used.elapsed() > self.limits.idle) {
                Some((_, id)) => sessions.1.remove(&id),
                None => {
                    let message =
                        format!("{} sessions are open, no more are allowed: delete one", self.limits.sessions);
                    return Err(Refusal::new(429, "too_many_sessions", message));
                }
            };
        }
        sessions.0 += 1;
        let id = sessions.0;
        sessions.1.insert(id, Arc::new(Entry { session: Mutex::new(session), used: Mutex::new(Instant::now()) }));
        Ok(json!({ "session": id.to_string() }))
    }

    fn add_scan(&self, session: &mut Session, request: ScanRequest, may_read_files: bool) -> Result<Value, Refusal> {
        let full =
            |what: String| Refusal::new(429, "session_full", format!("{what}: undo, reset or start another session"));
        if session.num_scans() >= self.limits.scans {
            return Err(full(format!("the session has {} scans, the most allowed", session.num_scans())));
        }
        let scan = request.into_scan(session.config(), may_read_files)?;
        let report = session.add_scan(scan)?;
        if session.memory() > self.limits.memory {
            session.undo();
            return Err(full(format!("the scans of a session may hold {} MiB", self.limits.memory >> 20)));
        }
        Ok(json!({ "scans": session.num_scans(), "report": report }))
    }
}

fn next_view(session: &mut Session, request: NextRequest) -> Result<Value, Refusal> {
    if request.config.is_some() {
        let config = CreateRequest { config: request.config }.over(session.config())?;
        session.configure(config)?;
    }
    let answer = session.next_view_for(&Request { current_position_m: request.current_position_m })?;
    serde_json::to_value(answer).map_err(|e| Refusal::new(500, "internal", e.to_string()))
}

fn export(session: &Session) -> Value {
    let cloud = session.cloud();
    json!({
        "scans": session.num_scans(), "config": session.config(),
        "points_m": cloud.points, "normals": cloud.normals, "spacing_m": session.state().grid_size,
    })
}
