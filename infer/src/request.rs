//! Bodies of requests to the service.

mod scan;

pub use scan::{Unit, cloud_body};

use crate::load::{Loaded, Told};
use crate::service::{BoundedJson, Method, OnDeadline, Refusal, Written};
use formats::config::overlaid;
use planning::SessionConfig;
use scan::ScanRequest;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::Value;
use std::marker::PhantomData;

/// Memory of a decision beside what its session holds already, bytes.
const DECISION: usize = 64 << 20;
/// The same of what takes little.
const SMALL: usize = 1 << 20;

/// The bytes of a request.
#[derive(Clone, Copy, Debug)]
pub enum Body<'a> {
    /// What is asked; nothing at all is `{}`.
    Whole(&'a [u8]),
    /// A line that has it under `params`.
    Line(&'a [u8]),
}

/// What is written as an object: a list could be read as one, field by field, and is refused.
#[derive(Clone, Debug, Default)]
pub struct Object<T>(pub T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Object<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Fields<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Fields<T> {
            type Value = T;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map))
            }
        }
        deserializer.deserialize_map(Fields(PhantomData)).map(Self)
    }
}

impl<'a> Body<'a> {
    fn parse<T: Deserialize<'a> + Default>(self) -> Result<T, Refusal> {
        #[derive(Deserialize)]
        struct Params<T> {
            params: Option<Object<T>>,
        }
        let parsed = match self {
            Self::Whole(bytes) if bytes.iter().all(u8::is_ascii_whitespace) => Ok(T::default()),
            Self::Whole(bytes) => serde_json::from_slice::<Object<T>>(bytes).map(|o| o.0),
            Self::Line(bytes) => serde_json::from_slice::<Params<T>>(bytes).map(|p| p.params.unwrap_or_default().0),
        };
        parsed.map_err(|e| Refusal::new(400, "bad_request", format!("the body is not as expected: {e}")))
    }
}

/// What is asked of a session, or for one.
#[derive(Debug)]
pub enum Ask {
    /// A new session.
    Create(CreateRequest),
    /// One more scan.
    AddScan {
        /// The scan, as it was read.
        scan: Box<Loaded>,
        /// A depth image that leaves it to the session's settings what its misses mean. Those of an organised cloud are unknown, whatever
        /// the settings.
        misses_by_settings: bool,
        /// As given.
        deadline_ms: Option<u64>,
        /// As it came, where it is to be kept on disk.
        written: Option<Written>,
    },
    /// The next view.
    NextView(NextRequest),
    /// Other settings, known to be in range; asked by this program alone.
    Configure(Box<SessionConfig>),
    /// Take the last scan back.
    Undo,
    /// Forget all scans.
    Reset,
    /// The cloud and the settings.
    Export,
    /// The measured surface as triangles.
    Mesh,
}

impl Ask {
    /// From a body. `may_read_files`: whether a scan may be given as a path; `keep`: whether a scan shall say how it came.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(method: Method, body: Body, may_read_files: bool, keep: bool) -> Result<Self, Refusal> {
        #[derive(Default, Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Nothing {}
        let nothing = |ask| body.parse::<Nothing>().map(|_| ask);
        match method {
            Method::Create => body.parse().map(Self::Create),
            Method::NextView => body.parse().map(Self::NextView),
            Method::AddScan => {
                let request: ScanRequest = body.parse()?;
                if keep && request.file.is_some() && may_read_files {
                    // What is kept is independent of the file.
                    let whole = request.with_its_file()?;
                    return Self::parse(method, Body::Whole(&whole), false, true);
                }
                let written = keep.then(|| match body {
                    Body::Whole(bytes) => Written { line: false, bytes: bytes.to_vec(), told: None },
                    Body::Line(bytes) => Written { line: true, bytes: bytes.to_vec(), told: None },
                });
                let misses_by_settings = request.depth.as_ref().is_some_and(|d| d.0.misses.is_none());
                let deadline_ms = request.deadline_ms;
                let scan = Box::new(request.into_scan(may_read_files)?);
                Ok(Self::AddScan { scan, misses_by_settings, deadline_ms, written })
            }
            Method::Undo => nothing(Self::Undo),
            Method::Reset => nothing(Self::Reset),
            Method::Mesh => nothing(Self::Mesh),
            _ => nothing(Self::Export),
        }
    }

    /// A scan of which this is told beside its request, and kept with it.
    #[must_use]
    pub fn told(mut self, told: Told) -> Self {
        if let Self::AddScan { scan, written, .. } = &mut self {
            told.lay_over(scan);
            if let Some(written) = written {
                written.told = Some(told);
            }
        }
        self
    }

    /// Memory that doing it may need beside what the session holds already, bytes.
    pub fn work(&self) -> usize {
        match self {
            Self::AddScan { scan, written, .. } => {
                scan::work(&scan.scan) + written.as_ref().map_or(0, |w| w.bytes.len()) + SMALL
            }
            Self::NextView(_) => DECISION,
            _ => SMALL,
        }
    }

    /// How long it may take, where it says so.
    pub fn deadline_ms(&self) -> Option<u64> {
        match self {
            Self::AddScan { deadline_ms, .. } => *deadline_ms,
            Self::NextView(request) => request.deadline_ms,
            _ => None,
        }
    }
}

/// A new session: settings that differ from the service's.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CreateRequest {
    /// As in `configs/infer.toml`, as JSON.
    pub config: Option<BoundedJson>,
}

/// These settings laid over `base`.
///
/// # Errors
/// An unknown key or a wrong type, by name.
pub fn over(base: &SessionConfig, changes: Option<BoundedJson>) -> Result<SessionConfig, Refusal> {
    match changes {
        None | Some(BoundedJson(Value::Null)) => Ok(base.clone()),
        Some(BoundedJson(changes)) => {
            changed_settings(base, changes).map_err(|message| Refusal::new(400, "bad_config", message))
        }
    }
}

/// `base` with changes laid over it: JSON with tables for tables. A working distance replaces a range of them that was set before.
///
/// # Errors
/// An unknown key or a wrong type, by name.
pub fn changed_settings(base: &SessionConfig, changes: Value) -> Result<SessionConfig, String> {
    let is_fixed = changes.get("working_distance_m").is_some() && changes.get("working_distance_range_m").is_none();
    let mut config = overlaid(base, changes, "config")?;
    if is_fixed {
        config.working_distance_range_m = None;
    }
    Ok(config)
}

/// What may change from view to view.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NextRequest {
    /// Where the camera is now.
    pub current_position_m: Option<[f64; 3]>,
    /// Settings to change, for this and later views.
    pub config: Option<BoundedJson>,
    /// How long it may take from its arrival on; the service's setting if absent.
    pub deadline_ms: Option<u64>,
    /// What to do when that has passed.
    pub on_deadline: OnDeadline,
    /// Whether the client is asked which views it can take; over stdin and stdout.
    pub check: bool,
    /// Plan so many views at once beside the next one.
    pub plan_views: Option<usize>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_working_distance_replaces_a_range_and_only_that() {
        let base = SessionConfig { working_distance_range_m: Some([0.6, 1.2]), ..SessionConfig::default() };
        let distances = |changes: Value| {
            over(&base, Some(BoundedJson(changes))).map(|config| config.working_distances()).map_err(|e| e.code)
        };
        assert_eq!(distances(json!({ "working_distance_m": 0.5 })), Ok(vec![0.5]));
        assert_eq!(distances(json!({ "stop_below": 0.1 })), Ok(base.working_distances()));
        let both =
            json!({ "working_distance_m": 0.5, "working_distance_range_m": [0.4, 0.8], "working_distance_steps": 2 });
        assert_eq!(distances(both), Ok(vec![0.4, 0.8]));
        assert_eq!(distances(json!({ "working_distance_m": null })), Err("bad_config"));
    }
}
