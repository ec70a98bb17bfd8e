//! What the service answers, whatever the way a request came: sessions by name, each with a planner's memory.

mod answers;
mod config;
mod fingerprint;
mod memory;
mod refusal;
mod sessions;
mod settings;
mod store;
mod time;
mod work;

pub use answers::{Answers, Key};
pub use config::{ServeConfig, ServiceConfig};
pub use fingerprint::Fingerprint;
pub use memory::{Held, Memory};
pub use refusal::Refusal;
pub use settings::BoundedJson;
pub use store::{Store, Written};
pub use time::{Flag, OnDeadline, Patience};
pub use work::Open;

use hyper::body::Bytes;
use planning::config::MAX_POINTS;
use planning::session::ViewCheck;
use planning::{Network, SessionConfig, SessionError};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sessions::Sessions;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Memory that reading a scan takes at least, as small as it may be packed, and per byte of its body.
const SCAN: usize = 128 << 20;
const SCAN_PER_BYTE: usize = 8;

/// Memory that reading a request takes, bytes.
pub fn reading(method: Method, body: usize) -> usize {
    if method == Method::AddScan { SCAN.max(SCAN_PER_BYTE * body) } else { 1 << 20 }
}

/// An answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// HTTP status.
    pub status: u16,
    /// JSON.
    pub body: Bytes,
}

impl Reply {
    /// From JSON.
    pub fn new(status: u16, body: impl Into<Bytes>) -> Self {
        Self { status, body: body.into() }
    }

    fn of(value: &impl Serialize) -> Result<Self, Refusal> {
        let body = serde_json::to_vec(value).map_err(|e| Refusal::new(500, "internal", e.to_string()))?;
        Ok(Self::new(200, body))
    }
}

/// What can be asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Is the service there?
    Health,
    /// The open sessions.
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
    /// The measured surface as triangles.
    Mesh,
    /// End the session.
    Delete,
}

/// An open session as the list shows it, without waiting for who works on it.
pub struct Entry {
    id: u64,
    /// The session.
    pub open: Arc<tokio::sync::Mutex<Open>>,
    used: Mutex<Instant>,
    scans: AtomicUsize,
    bytes: AtomicUsize,
}

impl Entry {
    fn new(id: u64, open: Open, scans: usize) -> Self {
        let (bytes, used) = (open.memory().into(), Mutex::new(Instant::now()));
        Self { id, open: Arc::new(tokio::sync::Mutex::new(open)), used, scans: scans.into(), bytes }
    }

    /// The session's name.
    #[cfg(feature = "ros2")]
    pub fn name(&self) -> String {
        self.id.to_string()
    }

    /// Scans in it.
    #[cfg(feature = "ros2")]
    pub fn scans(&self) -> usize {
        self.scans.load(Ordering::Relaxed)
    }
}

/// When a check of views is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asks {
    /// Of every next view.
    Always,
    /// Where a request says `check`.
    WhereRequested,
}

/// All sessions.
pub struct Service {
    config: SessionConfig,
    network: Option<Network>,
    limits: ServiceConfig,
    memory: Memory,
    store: Option<Store>,
    sessions: Mutex<Sessions>,
    /// Of who creates or ends a session, one at a time: taken before that of the sessions, which the disk never holds up.
    turn: Mutex<()>,
    count: AtomicUsize,
    check: Option<(ViewCheck, Asks)>,
    /// Nothing new is begun.
    pub stopping: Flag,
    /// What runs ends now.
    pub halted: Flag,
}

/// A panic while a lock was held is answered as an error of that request; what it guarded is still whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Settings that a session of the service may have: none that leaves its memory to the input.
///
/// # Errors
/// The key, and what it must be.
pub fn check(config: &SessionConfig) -> Result<(), Refusal> {
    config.check().map_err(SessionError::Config)?;
    if i64::try_from(config.seed).is_err() {
        return Err(Refusal::new(400, "bad_config", format!("seed = {}: expected 0 to {}", config.seed, i64::MAX)));
    }
    if config.max_points == 0 {
        let message = format!("max_points = 0: the service expects 100 to {MAX_POINTS}");
        return Err(Refusal::new(400, "bad_config", message));
    }
    Ok(())
}

impl Service {
    /// No session yet; each new one starts with `config`.
    pub fn new(config: SessionConfig, network: Option<Network>, limits: ServiceConfig) -> Self {
        let (memory, count) = (Memory::new(limits.memory_mib), AtomicUsize::new(0));
        let [stopping, halted] = [Flag::default(), Flag::default()];
        let (store, check, sessions, turn) = (None, None, Mutex::default(), Mutex::default());
        Self { config, network, limits, memory, store, sessions, turn, count, check, stopping, halted }
    }

    /// The same where somebody knows which views can be taken.
    #[must_use]
    pub fn checking_with(self, check: ViewCheck, asks: Asks) -> Self {
        Self { check: Some((check, asks)), ..self }
    }

    /// The same with the sessions of a folder, in which all is kept from now on. Each is read, within the memory that there is, when it
    /// is first asked for; what is wrong with it is answered then.
    ///
    /// # Errors
    /// The folder is in use, or cannot be read.
    pub fn keeping_state(mut self, folder: &Path) -> anyhow::Result<Self> {
        let (store, found) = Store::open(folder)?;
        let mut sessions = Sessions::known(found.last, Answers::from_disk(found.answers));
        for (id, scans) in found.sessions {
            let scans = scans.unwrap_or_else(|error| {
                tracing::warn!("session {id}: {error}");
                0
            });
            let open = Open::on_disk(self.config.clone(), self.network.clone(), &self.memory)
                .map_err(|e| anyhow::anyhow!("{}", e.message))?;
            sessions.open.insert(id, Arc::new(Entry::new(id, open, scans)));
        }
        self.count.store(sessions.open.len(), Ordering::Relaxed);
        self.sessions = Mutex::new(sessions);
        self.store = Some(store);
        Ok(self)
    }

    /// Whether sessions are kept on disk.
    pub fn keeps_state(&self) -> bool {
        self.store.is_some()
    }

    /// The limits.
    pub fn limits(&self) -> &ServiceConfig {
        &self.limits
    }

    /// What is held.
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// For one request.
    pub fn patience(&self) -> Patience {
        Patience::new(self.limits.deadline(), &self.halted)
    }

    /// Is the service there? Waits for nothing.
    pub fn health(&self) -> Result<Reply, Refusal> {
        let status = if self.stopping.is_set() { "stopping" } else { "ok" };
        Reply::of(&json!({
            "status": status, "sessions": self.count.load(Ordering::Relaxed), "network": self.network.is_some(),
            "memory_mib": self.memory.used() >> 20,
        }))
    }

    /// The open sessions.
    pub fn list(&self) -> Result<Reply, Refusal> {
        let sessions = lock(&self.sessions);
        let show = |(id, entry): (&u64, &Arc<Entry>)| {
            json!({
                "session": id.to_string(), "scans": entry.scans.load(Ordering::Relaxed),
                "memory_mib": entry.bytes.load(Ordering::Relaxed) >> 20, "idle_s": lock(&entry.used).elapsed().as_secs(),
            })
        };
        let open: Vec<_> = sessions.open.iter().map(show).collect();
        Reply::of(&json!({ "sessions": sessions.names(), "open": open }))
    }

    /// Names of the open sessions, in the order in which they were opened.
    pub fn names(&self) -> Vec<String> {
        lock(&self.sessions).names()
    }

    /// The session of this name.
    ///
    /// # Errors
    /// There is none.
    pub fn entry(&self, name: Option<&str>) -> Result<Arc<Entry>, Refusal> {
        let name = name.ok_or_else(|| Refusal::new(400, "no_session", "name the session (create one first)"))?;
        let id: u64 = name.parse().map_err(|_| unknown(name))?;
        let entry = lock(&self.sessions).open.get(&id).cloned().ok_or_else(|| unknown(name))?;
        *lock(&entry.used) = Instant::now();
        Ok(entry)
    }
}

fn unknown(name: &str) -> Refusal {
    let shown: String = name.chars().take(40).collect();
    Refusal::new(404, "unknown_session", format!("there is no session {shown:?}"))
}

#[cfg(test)]
mod tests;
