//! `SHA256SUMS` of a checkpoint: the checksum of each of its files, in the form that `sha256sum -c` reads.

use crate::checkpoint::CheckpointError;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Name of the file.
pub const SUMS: &str = "SHA256SUMS";

/// The text of the file for these files.
pub fn text(files: &[(&str, &[u8])]) -> String {
    files.iter().fold(String::new(), |mut text, (name, bytes)| {
        let _ = writeln!(text, "{:x}  {name}", Sha256::digest(bytes));
        text
    })
}

/// What a directory's file says.
#[derive(Clone, Debug)]
pub struct Sums {
    directory: PathBuf,
    /// Absent in checkpoints of older programs.
    by_name: Option<BTreeMap<String, String>>,
}

impl Sums {
    /// Reads them; where there are none, there is a warning, and nothing can be checked.
    ///
    /// # Errors
    /// A file that cannot be read, or a line of another form.
    pub fn read(directory: &Path) -> Result<Self, CheckpointError> {
        let file = directory.join(SUMS);
        let mut sums = Self { directory: directory.to_owned(), by_name: None };
        let bytes = match std::fs::read(&file) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                if directory.is_dir() {
                    tracing::warn!("{directory:?} has no {SUMS}: damage to its weights would go unnoticed");
                }
                return Ok(sums);
            }
            Err(cause) => return Err(CheckpointError::Io { file: format!("{file:?}"), cause }),
        };
        let text = String::from_utf8_lossy(&bytes);
        let lines = text.lines().map(|line| {
            let (sum, name) = line.split_once("  ")?;
            Some((name.to_owned(), sum.to_owned()))
        });
        let by_name = lines.collect::<Option<BTreeMap<_, _>>>().ok_or_else(|| CheckpointError::Description {
            file: format!("{file:?}"),
            reason: "expected lines of a SHA-256, two spaces and the name of a file, as sha256sum writes them"
                .to_owned(),
        })?;
        sums.by_name = Some(by_name);
        Ok(sums)
    }

    /// Holds the bytes of a file of the directory against its checksum.
    ///
    /// # Errors
    /// Other bytes than were written, or a file without a checksum.
    pub fn check(&self, name: &str, bytes: &[u8]) -> Result<(), CheckpointError> {
        let Some(sums) = &self.by_name else { return Ok(()) };
        let found = format!("{:x}", Sha256::digest(bytes));
        let expected = sums.get(name).map_or("none", String::as_str);
        if found == expected {
            return Ok(());
        }
        let file = format!("{:?}", self.directory.join(name));
        Err(CheckpointError::Damaged { file, found, expected: expected.to_owned() })
    }
}
