//! The file in which a run keeps its finished work, so that it can be interrupted at any time and resumed.

mod contents;
mod error;

use crate::config::EvaluateConfig;
use crate::record::{EpisodeKey, EpisodeRecord, Skipped, Timing};
use formats::config::digest;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

pub use contents::Contents;
pub use error::JournalError;

/// File name inside the run's directory.
pub const JOURNAL: &str = "journal.jsonl";

/// A line of the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(clippy::large_enum_variant, reason = "one at a time is in memory, and nearly all are episodes")]
pub enum Entry {
    /// First line: hash of the settings that outcomes depend on.
    Settings(String),
    /// A finished episode.
    Episode {
        /// Outcome.
        record: EpisodeRecord,
        /// Times.
        timing: Timing,
    },
    /// An episode that cannot be run.
    Skipped(Skipped),
}

/// An open journal; a line is written at once and whole.
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens or makes the journal of a run's directory and answers with what it holds. A last line that was cut off is
    /// removed. `settings` is the hash of the settings, `placed` what older programs took for it
    /// ([`EvaluateConfig::placed_hash`]).
    ///
    /// # Errors
    /// What the operating system refuses; a damaged journal, or one of other settings.
    pub fn open(directory: &Path, settings: &str, placed: &str) -> Result<(Self, Contents), JournalError> {
        let path = directory.join(JOURNAL);
        let io = |action| {
            let path = path.clone();
            move |source| JournalError::Io { path, action, cause: source }
        };
        std::fs::create_dir_all(directory).map_err(io("make the directory of"))?;
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(io("open"))?;
        let (contents, whole) = parse(&path, BufReader::new(&file), Some(Hashes { settings, placed }))?;
        file.set_len(whole).map_err(io("shorten"))?;
        file.seek(SeekFrom::End(0)).map_err(io("seek in"))?;
        let journal = Self { path, file: Mutex::new(file) };
        if whole == 0 {
            journal.append(&Entry::Settings(settings.to_owned()))?;
        }
        Ok((journal, contents))
    }

    /// Adds a line.
    pub fn append(&self, entry: &Entry) -> Result<(), JournalError> {
        let fail =
            |source: std::io::Error| JournalError::Io { path: self.path.clone(), action: "write", cause: source };
        let line = format!("{}\n", line_of(entry).map_err(|e| fail(e.into()))?);
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes()).and_then(|()| file.sync_data()).map_err(fail)
    }
}

/// What the journal of a finished or unfinished run holds.
///
/// # Errors
/// What the operating system refuses; a damaged journal.
pub fn read(directory: &Path) -> Result<Contents, JournalError> {
    let path = directory.join(JOURNAL);
    let file = File::open(&path).map_err(|source| JournalError::Io {
        path: path.clone(),
        action: "read (is it a folder of `evaluate`?)",
        cause: source,
    })?;
    Ok(parse(&path, BufReader::new(file), None)?.0)
}

/// The hashes that a journal may begin with.
#[derive(Clone, Copy)]
struct Hashes<'a> {
    /// Of the settings.
    settings: &'a str,
    /// Of the settings and the place of the objects.
    placed: &'a str,
}

/// Marks a number that an older program wrote as text.
const EXACT: &str = "f64:";

/// What is text whatever it begins with.
const TEXTS: [&str; 3] = ["object", "policy", "reason"];

/// Older programs' numbers as numbers.
fn read_back(value: &mut Value) {
    match value {
        Value::String(text) => {
            if let Some(number) = text.strip_prefix(EXACT).and_then(|t| t.parse::<f64>().ok()) {
                *value = Value::from(number);
            }
        }
        Value::Array(list) => list.iter_mut().for_each(read_back),
        Value::Object(map) => {
            map.iter_mut().filter(|(key, _)| !TEXTS.contains(&key.as_str())).for_each(|(_, value)| read_back(value));
        }
        _ => {}
    }
}

/// An entry as a line has it.
fn line_of(entry: &Entry) -> serde_json::Result<String> {
    Ok(sealed(&serde_json::to_value(entry)?.to_string()))
}

/// What begins a line: 16 hexadecimal digits of the SHA-256 of the JSON object that they are put into follow.
const SUM: &str = "{\"sum\":\"";

/// The object with its own checksum as its first entry.
fn sealed(object: &str) -> String {
    format!("{SUM}{}\",{}", digest(object.as_bytes()), object.trim_start_matches('{'))
}

/// The object in a sealed line; of older programs' lines, the line.
fn opened(line: &str) -> Result<Cow<'_, str>, String> {
    let Some(rest) = line.strip_prefix(SUM) else { return Ok(line.into()) };
    let (expected, object) = rest.split_once("\",").unwrap_or((rest, ""));
    let object = format!("{{{object}");
    let found = digest(object.as_bytes());
    match found == expected {
        true => Ok(object.into()),
        false => Err(format!("damaged: its checksum is {found}, but it says {expected}")),
    }
}

/// What a journal holds, read line by line, and the bytes of its whole lines: a last one without an end was cut off.
fn parse(path: &Path, mut text: impl BufRead, hashes: Option<Hashes>) -> Result<(Contents, u64), JournalError> {
    let mut contents = Contents::default();
    // The final outcome of an episode: it may have been tried again.
    let mut was_run: BTreeMap<EpisodeKey, bool> = BTreeMap::new();
    let (mut whole, mut unsealed) = (0, 0);
    let other_settings = |found: &str, expected: &str| JournalError::OtherSettings {
        path: path.to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
        differences: String::new(),
    };
    let mut begun = String::new();
    let mut bytes = Vec::new();
    for i in 0.. {
        bytes.clear();
        let read = text.read_until(b'\n', &mut bytes);
        read.map_err(|cause| JournalError::Io { path: path.to_owned(), action: "read", cause })?;
        let Some((b'\n', line)) = bytes.split_last() else { break };
        whole += bytes.len() as u64;
        // Bytes that are no text make a line whose checksum says so.
        let line = String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line));
        unsealed += usize::from(!line.starts_with(SUM));
        let entry = entry_in(&line).map_err(|message| match i {
            0 => no_settings(path, message),
            _ => JournalError::Line { path: path.to_owned(), line: i + 1, message },
        })?;
        match entry {
            Entry::Settings(found) => {
                if let Some(Hashes { settings, placed }) = hashes
                    && found != settings
                    && found != placed
                {
                    return Err(other_settings(&found, settings));
                }
                begun = found;
            }
            _ if i == 0 => return Err(no_settings(path, "found an episode".to_owned())),
            Entry::Episode { record, timing } => {
                // Objects that lie elsewhere are the same ones if their files are, which older programs did not note.
                if let Some(Hashes { placed, .. }) = hashes.filter(|h| record.files.is_none() && begun != h.placed) {
                    return Err(other_settings(&begun, placed));
                }
                was_run.insert(record.key.clone(), true);
                contents.episodes.push((record, timing));
            }
            Entry::Skipped(skipped) => {
                was_run.insert(skipped.key.clone(), false);
                contents.skipped.push(skipped);
            }
        }
    }
    if unsealed > 0 {
        tracing::warn!("{path:?}: {unsealed} lines of an older program have no checksum: damage would go unnoticed");
    }
    contents.episodes.retain(|(r, _)| was_run.get(&r.key) == Some(&true));
    contents.skipped.retain(|s| was_run.get(&s.key) == Some(&false));
    contents.sort();
    Ok((contents, whole))
}

fn entry_in(line: &str) -> Result<Entry, String> {
    let mut value = serde_json::from_str(&opened(line)?).map_err(|e| e.to_string())?;
    read_back(&mut value);
    serde_json::from_value(value).map_err(|e| e.to_string())
}

/// The first line is not what it must be; with the one that follows from the settings that the directory keeps.
fn no_settings(path: &Path, message: String) -> JournalError {
    let kept = path.parent().and_then(EvaluateConfig::kept_in);
    let restored = kept.and_then(|kept| line_of(&Entry::Settings(kept.outcome_hash().ok()?)).ok());
    JournalError::NoSettings { path: path.to_owned(), message, restored }
}

#[cfg(test)]
mod tests;
