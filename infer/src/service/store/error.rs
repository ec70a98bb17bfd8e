//! Why sessions cannot be kept, or not be read again.

use super::{VERSION, WAY_OUT};
use crate::service::Refusal;
use formats::FormatError;
use formats::lock::LockError;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Why sessions cannot be kept, or not be read again.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// Two services, one folder, or a folder that cannot be made.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The system refuses.
    #[error("{path:?}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not as it is written here.
    #[error("{path:?}: {reason}: {WAY_OUT}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A scan that came to a program with other limits.
    #[error("{path:?}: a scan of {mib} MiB, more than service.body_mib = {most_mib} allows: raise it to {mib}")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size, rounded up.
        mib: u64,
        /// The limit.
        most_mib: u64,
    },
    /// Of another program.
    #[error("{path:?}: version {found}, expected {VERSION}: use the program that wrote it, or another folder")]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
    },
    /// Not as it is written here, though it is as it was written.
    #[error("{path:?}: {reason}: another version of infer wrote it: use that one, or another folder")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What is not known here.
        reason: String,
    },
    /// It cannot be written, or is not what was written.
    #[error(transparent)]
    Write(#[from] FormatError),
    /// Settings that TOML cannot say.
    #[error(transparent)]
    Settings(#[from] formats::ConfigError),
}

impl StoreError {
    /// Whether a file could not be written because there is no space left.
    pub(super) fn is_full(&self) -> bool {
        matches!(self, Self::Write(FormatError::Io { cause, .. }) if cause.kind() == ErrorKind::StorageFull)
    }
}

impl From<StoreError> for Refusal {
    fn from(error: StoreError) -> Self {
        Self::new(500, "state", format!("the session cannot be saved or loaded: {error}"))
    }
}

/// What the system says of a file.
pub(super) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::Io { path, source }
}

/// A file that is not as it was written, on one line.
pub(super) fn damaged(path: &Path, reason: impl ToString) -> StoreError {
    StoreError::Damaged { path: path.to_owned(), reason: one_line(reason) }
}

/// A file that is not understood: where its checksum is right, nothing is wrong with it.
pub(super) fn unreadable(path: &Path, sealed: bool, reason: impl ToString) -> StoreError {
    match sealed {
        true => StoreError::Foreign { path: path.to_owned(), reason: one_line(reason) },
        false => damaged(path, reason),
    }
}

fn one_line(reason: impl ToString) -> String {
    reason.to_string().trim_end().replace('\n', " ")
}
