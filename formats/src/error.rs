//! The one error of this crate's readers and writers.

use std::fmt;
use std::path::{Path, PathBuf};

/// Where in a file something was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, from 1.
    Line(usize),
    /// A byte of a binary file, from 0.
    Byte(u64),
    /// A frame of a frame history, from 0.
    Frame(usize),
    /// A named part: an element of a PLY file, a tensor of a shard, a field of a header.
    Part(String),
    /// The file as a whole.
    File,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, ", line {line}"),
            Place::Byte(byte) => write!(f, ", byte {byte}"),
            Place::Frame(frame) => write!(f, ", frame {frame}"),
            Place::Part(part) => write!(f, ", {part}"),
            Place::File => Ok(()),
        }
    }
}

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// The operating system refused.
    #[error("{path:?}: cannot {action}: {cause}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried, e.g. "open".
        action: &'static str,
        /// The system's reason. No `source`: the message says it, and a chain of causes would say it again.
        cause: std::io::Error,
    },
    /// The name's ending is of no type that can be read here.
    #[error("{path:?}: files with the extension {found:?} cannot be read here; expected {expected}")]
    UnknownType {
        /// The file.
        path: PathBuf,
        /// The ending found.
        found: String,
        /// The endings that are read.
        expected: &'static str,
    },
    /// Something else stands where the format wants something.
    #[error("{path:?}{place}: found {found}, expected {expected}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where.
        place: Place,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The file ends too early.
    #[error("{path:?}{place}: the file ends here, expected {expected}")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where it ends.
        place: Place,
        /// What is missing.
        expected: String,
    },
    /// A count that the rest of the file cannot hold.
    #[error("{path:?}{place}: {found} {what} declared, but the file has room for {most} at most")]
    Count {
        /// The file.
        path: PathBuf,
        /// Where the count stands.
        place: Place,
        /// What is counted.
        what: String,
        /// The count.
        found: u64,
        /// The most that fits.
        most: u64,
    },
    /// The content would take more memory than a file of this size warrants.
    #[error(
        "{path:?}: {what} would take {found} MiB of memory, but a file of this size may take at most {most} MiB; thin or split it"
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What asks for so much.
        what: String,
        /// What it asks for, MiB.
        found: u64,
        /// The most, MiB.
        most: u64,
    },
    /// A face names a vertex that does not exist.
    #[error("{path:?}{place}: found vertex index {found}, expected one of {vertices} vertices")]
    Index {
        /// The file.
        path: PathBuf,
        /// Where.
        place: Place,
        /// The index as written.
        found: i64,
        /// Number of vertices.
        vertices: usize,
    },
    /// The file is well-formed and holds nothing of use.
    #[error("{path:?}: it contains nothing usable: found {found}, expected {expected}")]
    Empty {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// The bytes are not those that were written.
    #[error("{path:?}: damaged: found SHA-256 {found}, expected {expected}; {way_out}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Checksum of what is there.
        found: String,
        /// Checksum that was recorded.
        expected: String,
        /// What to do.
        way_out: &'static str,
    },
    /// Another file stands where one was checked and opened.
    #[error("{path:?}: it changed while it was in use; start again when no other program writes to it")]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// Written by a version of the format that this program does not know.
    #[error("{path:?}: schema version {found}, expected {expected}")]
    Version {
        /// The file.
        path: PathBuf,
        /// The version found.
        found: u32,
        /// The version known here.
        expected: u32,
    },
}

/// The way out of damage in a set of training samples.
pub const REMAKE: &str = "delete the file and run the same datagen command again to make it anew";

impl FormatError {
    /// An error of the operating system.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, cause: source }
    }

    /// Something found where something else was expected.
    pub fn syntax(path: &Path, place: Place, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Syntax { path: path.to_owned(), place, found: shorten(found.into()), expected: expected.into() }
    }

    /// The file ends too early.
    pub fn truncated(path: &Path, place: Place, expected: impl Into<String>) -> Self {
        Self::Truncated { path: path.to_owned(), place, expected: expected.into() }
    }

    /// The file concerned.
    pub fn path(&self) -> &Path {
        match self {
            Self::Io { path, .. }
            | Self::UnknownType { path, .. }
            | Self::Syntax { path, .. }
            | Self::Truncated { path, .. }
            | Self::Count { path, .. }
            | Self::TooLarge { path, .. }
            | Self::Index { path, .. }
            | Self::Empty { path, .. }
            | Self::Damaged { path, .. }
            | Self::Changed { path }
            | Self::Version { path, .. } => path,
        }
    }
}

/// A quotation of a foreign file must stay readable.
fn shorten(mut text: String) -> String {
    const MOST: usize = 120;
    if text.len() > MOST {
        let end = (0..=MOST).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
        text.truncate(end);
        text.push_str(" ...");
    }
    text
}
