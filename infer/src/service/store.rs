//! Sessions on disk (`--state DIR`), so that the end of the program, however sudden, loses none.
//!
//! ```text
//! DIR/lock             held by the service that writes here
//! DIR/state.toml       version, the last name given to a session, answers to who created or deleted one
//! DIR/3/session.toml   session 3: settings, number of scans, places of rejected ones, answers kept for repetition
//! DIR/3/scan-0001      a line with the settings that the scan came under, and what a command line told beside it, then the request as it came
//! ```
//!
//! Each file begins with its checksum; those of version 1 had none. Each file is written beside its place, synced and renamed. `session.toml` is written last: what it does not count is not there.

mod error;

use super::answers::Kept;
use crate::load::Told;
use error::{damaged, io, unreadable};
use formats::checksum;
use formats::config::to_toml;
use formats::lock::{Lock, try_lock};
use formats::run::atomic_write;
use planning::SessionConfig;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

pub use error::StoreError;

/// Of the files.
const VERSION: u32 = 2;
/// Of those that had no checksum.
const UNSEALED: u32 = 1;
/// What stands before the digits of the checksum: at the beginning, so that a file cut short is noticed too.
const SEAL: &[u8] = b"# sha256 = \"";
const SCAN_SEAL: &[u8] = b"{\"sha256\":\"";
/// Of the folder. Older programs know it by this name, too.
const LOCK: &str = "lock";
const WAY_OUT: &str = "restore the file, or delete the session's folder";
/// Settings and answers take less, bytes.
const RECORD: u64 = 8 << 20;
/// Names that may have been given where nothing tells any more which were.
const FORGOTTEN: u64 = 1_000_000;

/// A folder of sessions that nobody else writes to.
pub struct Store {
    folder: PathBuf,
    #[allow(dead_code, reason = "held")]
    lock: Lock,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    version: u32,
    last: u64,
    /// The session that is being deleted: where the program ends before it is gone, it goes when the folder is opened again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    deleting: Option<u64>,
    /// To who created or deleted a session. The one to who created the last is in its record too, and may be missing here.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    answers: Vec<Kept>,
}

/// A session without its scans.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    version: u32,
    /// How many scans count.
    pub scans: usize,
    /// To requests that changed something.
    #[serde(default)]
    pub answers: Vec<Kept>,
    /// To the request that created it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub created: Option<Kept>,
    /// Cameras of scans that were rejected, and that views keep away from.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rejected_from_m: Vec<[f64; 3]>,
    /// As they are now.
    pub config: SessionConfig,
}

impl Record {
    /// Of the version written here.
    pub fn new(scans: usize, answers: Vec<Kept>, config: &SessionConfig) -> Self {
        let (created, rejected_from_m) = (None, Vec::new());
        Self { version: VERSION, scans, answers, created, rejected_from_m, config: config.clone() }
    }
}

/// What a folder holds.
#[derive(Debug)]
pub struct Found {
    /// The last name given to a session.
    pub last: u64,
    /// The sessions by name, with the number of their scans, or what is wrong with them.
    pub sessions: Vec<(u64, Result<usize, StoreError>)>,
    /// To who created or deleted a session, oldest first.
    pub answers: Vec<Kept>,
}

/// A scan as it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// Whether it is a line with the body in it, or the body alone.
    pub line: bool,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// What was told beside them, by a command line.
    pub told: Option<Told>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScanHead {
    /// First, as [`SCAN_SEAL`] expects.
    #[serde(default)]
    sha256: String,
    version: u32,
    line: bool,
    /// As TOML, whose numbers are exact.
    config: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    told: Option<Told>,
}

/// What files of every version say.
#[derive(Deserialize)]
struct Versioned {
    version: u32,
}

fn version(path: &Path, found: u32, sealed: bool) -> Result<(), StoreError> {
    match (found, sealed) {
        (VERSION, true) => Ok(()),
        (VERSION, false) => Err(damaged(path, "no checksum")),
        (UNSEALED, false) => {
            tracing::warn!("{path:?} has no checksum: an older program wrote it; damage would go unnoticed");
            Ok(())
        }
        _ => Err(StoreError::Version { path: path.to_owned(), found }),
    }
}

/// These settings with their checksum.
fn sealed(text: &str) -> Vec<u8> {
    let mut bytes = [SEAL, checksum::UNKNOWN.as_bytes(), b"\"\n", text.as_bytes()].concat();
    checksum::seal(&mut bytes, SEAL);
    bytes
}

/// Whether the bytes have a checksum; it is that of these bytes.
fn is_sealed(path: &Path, bytes: &[u8], key: &[u8]) -> Result<bool, StoreError> {
    let sealed = bytes.starts_with(key);
    if sealed {
        checksum::check(path, bytes, key, WAY_OUT)?;
    }
    Ok(sealed)
}

/// Bytes of a regular file: of what else may lie there, none is opened.
fn size(path: &Path) -> Result<u64, StoreError> {
    let about = fs::metadata(path).map_err(io(path))?;
    if about.is_file() { Ok(about.len()) } else { Err(damaged(path, "not a regular file")) }
}

fn read_toml<T: DeserializeOwned>(path: &Path) -> Result<T, StoreError> {
    let size = size(path)?;
    if size > RECORD {
        return Err(damaged(path, format!("{} MiB, and no such file is larger than {}", size >> 20, RECORD >> 20)));
    }
    let text = fs::read_to_string(path).map_err(io(path))?;
    let sealed = is_sealed(path, text.as_bytes(), SEAL)?;
    let Versioned { version: found } = toml::from_str(&text).map_err(|e| damaged(path, e))?;
    version(path, found, sealed)?;
    toml::from_str(&text).map_err(|e| unreadable(path, sealed, e))
}

impl Store {
    /// This folder, made where there is none, and what it holds. What is damaged in it keeps nobody from the rest.
    ///
    /// # Errors
    /// It is in use, cannot be read, or is of another version.
    pub fn open(folder: &Path) -> Result<(Self, Found), StoreError> {
        let lock = try_lock(folder, LOCK, "infer")?;
        let store = Self { folder: folder.to_owned(), lock };
        let at = folder.join("state.toml");
        let mut state = State::default();
        let mut forgotten = false;
        if fs::exists(&at).map_err(io(&at))? {
            match read_toml(&at) {
                Ok(read) => state = read,
                Err(error @ (StoreError::Version { .. } | StoreError::Foreign { .. })) => return Err(error),
                Err(error) => {
                    tracing::warn!("{error}; new sessions get names that no older one can have had");
                    forgotten = true;
                }
            }
        }
        if let Some(id) = state.deleting.take() {
            // Once: a folder of that name may be put back by hand.
            let ended = store.remove(id).and_then(|()| store.write_state(&state));
            ended.unwrap_or_else(|error| tracing::warn!("{error}"));
        }
        let State { last, mut answers, .. } = state;
        let mut sessions = Vec::new();
        for entry in fs::read_dir(folder).map_err(io(folder))? {
            let name = entry.map_err(io(folder))?.file_name();
            let Some(id) = name.to_str().and_then(|name| name.parse::<u64>().ok()) else { continue };
            let at = store.record_path(id);
            // Begun, and never answered for.
            if !fs::exists(&at).map_err(io(&at))? {
                continue;
            }
            let record = store.record(id);
            let created = record.as_ref().ok().filter(|_| id == last).and_then(|record| record.created.clone());
            let created = created.filter(|created| !answers.contains(created));
            answers.extend(created);
            sessions.push((id, record.map(|record| record.scans)));
        }
        sessions.sort_by_key(|(id, _)| *id);
        let last = sessions.last().map_or(last, |(id, _)| last.max(*id));
        let last = last.saturating_add(if forgotten { FORGOTTEN } else { 0 });
        Ok((store, Found { last, sessions, answers }))
    }

    fn record_path(&self, id: u64) -> PathBuf {
        self.folder.join(id.to_string()).join("session.toml")
    }

    fn scan_path(&self, id: u64, number: usize) -> PathBuf {
        self.folder.join(id.to_string()).join(format!("scan-{number:04}"))
    }

    fn write_state(&self, state: &State) -> Result<(), StoreError> {
        Ok(atomic_write(&self.folder.join("state.toml"), &sealed(&to_toml(state)?))?)
    }

    /// A new session; `answers` are those to who created or deleted others.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(&self, id: u64, record: &Record, answers: Vec<Kept>) -> Result<(), StoreError> {
        self.write_state(&State { version: VERSION, last: id, deleting: None, answers })?;
        let folder = self.folder.join(id.to_string());
        fs::create_dir_all(&folder).map_err(io(&folder))?;
        Ok(atomic_write(&self.record_path(id), &sealed(&to_toml(record)?))?)
    }

    /// The session as it is now, `scan` being its last one if that is new.
    ///
    /// # Errors
    /// It cannot be written: what was written before is still there.
    pub fn write(&self, id: u64, record: &Record, scan: Option<&Written>) -> Result<(), StoreError> {
        let known = self.record_path(id);
        if !fs::exists(&known).map_err(io(&known))? {
            return Err(damaged(&known, "it is gone"));
        }
        if let Some(Written { line, bytes, told }) = scan {
            let (sha256, told) = (checksum::UNKNOWN.to_owned(), told.clone());
            let head = ScanHead { sha256, version: VERSION, line: *line, config: to_toml(&record.config)?, told };
            let path = self.scan_path(id, record.scans);
            let mut text = serde_json::to_vec(&head).map_err(|e| damaged(&path, e))?;
            text.push(b'\n');
            text.extend_from_slice(bytes);
            checksum::seal(&mut text, SCAN_SEAL);
            atomic_write(&path, &text)?;
        }
        atomic_write(&self.record_path(id), &sealed(&to_toml(record)?))?;
        let mut next = record.scans + 1;
        while fs::remove_file(self.scan_path(id, next)).is_ok() {
            next += 1;
        }
        Ok(())
    }

    /// A session as it was written last.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn record(&self, id: u64) -> Result<Record, StoreError> {
        read_toml(&self.record_path(id))
    }

    /// Bytes of a scan with its settings, of a body of at most `body`.
    ///
    /// # Errors
    /// It cannot be read, or is larger.
    pub fn scan_size(&self, id: u64, number: usize, body: usize) -> Result<usize, StoreError> {
        let path = self.scan_path(id, number);
        let (size, most) = (size(&path)?, body as u64 + RECORD);
        match size > most {
            true => Err(StoreError::TooLarge { path, mib: size.div_ceil(1 << 20), most_mib: body as u64 >> 20 }),
            false => Ok(size as usize),
        }
    }

    /// A scan, from 1, and the settings that it came under.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn scan(&self, id: u64, number: usize) -> Result<(SessionConfig, Written), StoreError> {
        let path = self.scan_path(id, number);
        let text = fs::read(&path).map_err(io(&path))?;
        let sealed = is_sealed(&path, &text, SCAN_SEAL)?;
        let end = text.iter().position(|b| *b == b'\n').ok_or_else(|| damaged(&path, "no first line"))?;
        let Versioned { version: found } = serde_json::from_slice(&text[..end]).map_err(|e| damaged(&path, e))?;
        version(&path, found, sealed)?;
        let head: ScanHead = serde_json::from_slice(&text[..end]).map_err(|e| unreadable(&path, sealed, e))?;
        let config = toml::from_str(&head.config).map_err(|e| unreadable(&path, sealed, e))?;
        Ok((config, Written { line: head.line, bytes: text[end + 1..].to_vec(), told: head.told }))
    }

    /// What is wrong with a scan that was read and is refused.
    pub fn refused(&self, id: u64, number: usize, why: impl ToString) -> StoreError {
        unreadable(&self.scan_path(id, number), true, why)
    }

    /// Ends a session together with the answer to who asked for that, the last of `answers`; `last` is the last name that was given.
    /// Where there is no space left for the answer, the session makes room for it first.
    ///
    /// # Errors
    /// It cannot be written, or removed: the session is still there, and stays.
    pub fn delete(&self, id: u64, last: u64, answers: Vec<Kept>) -> Result<(), StoreError> {
        let state = State { version: VERSION, last, deleting: Some(id), answers };
        self.delete_with(id, state, |state| self.write_state(state))
    }

    fn delete_with(
        &self,
        id: u64,
        mut state: State,
        write: impl Fn(&State) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        match write(&state) {
            Err(error) if error.is_full() => tracing::warn!("{error}; session {id} is removed first"),
            written => written?,
        }
        let removed = self.remove(id);
        if removed.is_err() {
            // Otherwise the session would go at the next start, and be called deleted until then.
            state.answers.pop();
        }
        state.deleting = None;
        // The session is gone, or there, whether this can be said or not.
        write(&state).unwrap_or_else(|error| tracing::warn!("{error}"));
        removed
    }

    /// Ends a session, if it is there. Files left of one that is ended are no session.
    ///
    /// # Errors
    /// It cannot be removed: it is still there.
    pub fn remove(&self, id: u64) -> Result<(), StoreError> {
        // First what makes it one, so that half of it is none.
        let record = self.record_path(id);
        match fs::remove_file(&record) {
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(io(&record)(e)),
            _ => {}
        }
        let folder = self.folder.join(id.to_string());
        match fs::remove_dir_all(&folder) {
            Err(e) if e.kind() != ErrorKind::NotFound => {
                tracing::warn!("{folder:?}: {e}: session {id} is deleted; remove what is left of its folder");
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
