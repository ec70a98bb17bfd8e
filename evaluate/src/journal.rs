//! The file in which a run keeps its finished work, so that it can be interrupted at any time and resumed.

use crate::record::{EpisodeKey, EpisodeRecord, Skipped, Timing};
use formats::config::digest;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// File name inside the run's directory.
pub const JOURNAL: &str = "journal.jsonl";

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The operating system refuses.
    #[error("{path:?}: cannot {action}: {cause}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried.
        action: &'static str,
        /// Why not.
        cause: std::io::Error,
    },
    /// A line in the middle is no record, or not the one that was written.
    #[error("{path:?}, line {line}: {message}; delete this line, and the same command runs that episode again")]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// Made with other settings.
    #[error(
        "{path:?} was made with other settings (hash {found}, now {expected}): give another --out, or remove the \
         directory to start over. Only policies, episodes, objects by --only and the report may change between runs"
    )]
    OtherSettings {
        /// The file.
        path: PathBuf,
        /// Hash in the file.
        found: String,
        /// Hash of the settings now.
        expected: String,
    },
}

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

/// What a journal holds.
#[derive(Clone, Debug, Default)]
pub struct Contents {
    /// Finished episodes with their times, by key.
    pub episodes: Vec<(EpisodeRecord, Timing)>,
    /// Those that could not be run, by key.
    pub skipped: Vec<Skipped>,
}

impl Contents {
    /// Keys of everything that need not be run again.
    pub fn keys(&self) -> BTreeSet<EpisodeKey> {
        self.episodes.iter().map(|(r, _)| &r.key).chain(self.skipped.iter().map(|s| &s.key)).cloned().collect()
    }

    /// Forgets the episodes of this policy with other weights than these; says how many.
    pub fn forget_other_weights(&mut self, policy: &str, weights: Option<&str>) -> usize {
        let before = self.episodes.len();
        self.episodes.retain(|(r, _)| r.key.policy != policy || r.weights.as_deref() == weights);
        before - self.episodes.len()
    }

    /// Forgets the episodes of this policy that could not be run: they are tried again.
    pub fn forget_skipped(&mut self, policy: &str) {
        self.skipped.retain(|s| s.key.policy != policy);
    }

    /// Forgets the episodes of this policy; says how many.
    pub fn forget(&mut self, policy: &str) -> usize {
        let before = self.episodes.len();
        self.episodes.retain(|(r, _)| r.key.policy != policy);
        before - self.episodes.len()
    }

    /// Into the order of keys.
    pub(crate) fn sort(&mut self) {
        self.episodes.sort_by(|a, b| a.0.key.cmp(&b.0.key));
        // An episode that was run again, since its weights had changed: the later one.
        self.episodes.dedup_by(|later, earlier| {
            let again = later.0.key == earlier.0.key;
            if again {
                std::mem::swap(later, earlier);
            }
            again
        });
        self.skipped.sort_by(|a, b| a.key.cmp(&b.key));
        self.skipped.dedup_by(|later, earlier| {
            let again = later.key == earlier.key;
            if again {
                std::mem::swap(later, earlier);
            }
            again
        });
    }
}

/// An open journal; a line is written at once and whole.
pub struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens or makes the journal of a run's directory and answers with what it holds. A last line that was cut off is
    /// removed.
    pub fn open(directory: &Path, settings: &str) -> Result<(Self, Contents), JournalError> {
        let path = directory.join(JOURNAL);
        let io = |action| {
            let path = path.clone();
            move |source| JournalError::Io { path, action, cause: source }
        };
        std::fs::create_dir_all(directory).map_err(io("make the directory of"))?;
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(io("open"))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(io("read"))?;
        // Bytes that are no text make a line whose checksum says so.
        let text = String::from_utf8_lossy(&bytes);
        let whole = text.rfind('\n').map_or(0, |i| i + 1);
        let contents = parse(&path, &text[..whole], Some(settings))?;
        let end = bytes.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
        file.set_len(end as u64).map_err(io("shorten"))?;
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
        let mut value = serde_json::to_value(entry).map_err(|e| fail(e.into()))?;
        spell_out(&mut value);
        let line = format!("{}\n", sealed(&value.to_string()));
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes()).and_then(|()| file.sync_data()).map_err(fail)
    }
}

/// What the journal of a finished or unfinished run holds.
pub fn read(directory: &Path) -> Result<Contents, JournalError> {
    let path = directory.join(JOURNAL);
    let bytes = std::fs::read(&path).map_err(|source| JournalError::Io {
        path: path.clone(),
        action: "read (is it a folder of `evaluate`?)",
        cause: source,
    })?;
    let text = String::from_utf8_lossy(&bytes);
    let whole = text.rfind('\n').map_or(0, |i| i + 1);
    parse(&path, &text[..whole], None)
}

/// Marks a number written as text.
const EXACT: &str = "f64:";

/// Numbers with a fraction become text: serde_json reads them back with the last bit wrong (its exact reader is a feature
/// that would rebuild every crate), and a resumed run must end in the same bytes.
fn spell_out(value: &mut Value) {
    match value {
        Value::Number(n) if n.is_f64() => *value = Value::String(format!("{EXACT}{n}")),
        Value::Array(list) => list.iter_mut().for_each(spell_out),
        Value::Object(map) => map.values_mut().for_each(spell_out),
        _ => {}
    }
}

fn read_back(value: &mut Value) {
    match value {
        Value::String(text) => {
            if let Some(number) = text.strip_prefix(EXACT).and_then(|t| t.parse::<f64>().ok()) {
                *value = Value::from(number);
            }
        }
        Value::Array(list) => list.iter_mut().for_each(read_back),
        Value::Object(map) => map.values_mut().for_each(read_back),
        _ => {}
    }
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

fn parse(path: &Path, text: &str, settings: Option<&str>) -> Result<Contents, JournalError> {
    let mut contents = Contents::default();
    // The final outcome of an episode: it may have been tried again.
    let mut was_run: BTreeMap<EpisodeKey, bool> = BTreeMap::new();
    let unsealed = text.lines().filter(|line| !line.starts_with(SUM)).count();
    if unsealed > 0 {
        tracing::warn!("{path:?}: {unsealed} lines of an older program have no checksum: damage would go unnoticed");
    }
    for (i, line) in text.lines().enumerate() {
        let read = |line| {
            let mut value = serde_json::from_str(&opened(line)?).map_err(|e| e.to_string())?;
            read_back(&mut value);
            serde_json::from_value(value).map_err(|e| e.to_string())
        };
        let entry: Entry =
            read(line).map_err(|message| JournalError::Line { path: path.to_owned(), line: i + 1, message })?;
        match entry {
            Entry::Settings(found) => {
                if let Some(expected) = settings
                    && expected != found
                {
                    let (path, expected) = (path.to_owned(), expected.to_owned());
                    return Err(JournalError::OtherSettings { path, found, expected });
                }
            }
            Entry::Episode { record, timing } => {
                was_run.insert(record.key.clone(), true);
                contents.episodes.push((record, timing));
            }
            Entry::Skipped(skipped) => {
                was_run.insert(skipped.key.clone(), false);
                contents.skipped.push(skipped);
            }
        }
    }
    contents.episodes.retain(|(r, _)| was_run.get(&r.key) == Some(&true));
    contents.skipped.retain(|s| was_run.get(&s.key) == Some(&false));
    contents.sort();
    Ok(contents)
}

#[cfg(test)]
mod tests;
