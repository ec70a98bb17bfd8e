//! What the node asks, and whom: the service of `infer`, in the requests that HTTP carries too.

use serde::Serialize;

/// What can be asked of the session; the bodies are those of `docs/openapi.yaml`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Settings to change, from the next scan on, in an object like `config` of the next view, with which alone HTTP changes them.
    Configure,
    /// One more scan.
    AddScan,
    /// The next view.
    NextView,
    /// Take the last scan back.
    Undo,
    /// Forget all scans.
    Reset,
    /// The cloud and the settings.
    Export,
}

/// Why something is not done.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("{message}")]
pub struct Refused {
    /// For programs, as in `docs/openapi.yaml`.
    pub code: String,
    /// For people.
    pub message: String,
}

impl Refused {
    /// The code of a scan that was to be registered and cannot be.
    pub const UNREGISTERED: &str = "unregistered";
}

/// One session of a planner.
pub trait Planner: Sync {
    /// The answer's body.
    ///
    /// # Errors
    /// Why not; the session is as it was.
    fn ask(&self, ask: Ask, body: &[u8]) -> Result<Vec<u8>, Refused>;

    /// Which session of the service this is, and whether it outlives the program.
    fn session(&self) -> Result<SessionInfo, Refused>;
}

/// The session that the node asks.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SessionInfo {
    /// Its name, as over HTTP.
    pub name: String,
    /// Scans in it.
    pub scans: usize,
    /// Whether it is kept on disk (`--state`).
    pub kept: bool,
}

/// A request that adds a scan, and what it was made of.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanRequest {
    /// For [`Ask::AddScan`].
    pub body: Vec<u8>,
    /// What went into it.
    pub made_of: MadeOf,
}

/// What a scan was made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MadeOf {
    /// `cloud`, `organised cloud` or `depth image`.
    pub kind: &'static str,
    /// Points or pixels with a return.
    pub returns: usize,
    /// Those without.
    pub without: usize,
    /// What a user should know of how the message was read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}
