//! Why a journal cannot be used, and how to go on.

use crate::config::EvaluateConfig;
use std::path::PathBuf;

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
    /// It does not begin with the hash of its settings, without which it could be continued with others.
    #[error(
        "{path:?}, line 1: {message}; expected the hash of the settings that all episodes below were run with: {}",
        way_out(.restored)
    )]
    NoSettings {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
        /// The line as it follows from the settings that the directory keeps, if it keeps them.
        restored: Option<String>,
    },
    /// Made with other settings.
    #[error(
        "{path:?} was made with other settings (hash {found}, now {expected}):{}give another --out, or remove the \
         directory to start over. Only policies, episodes, objects by --only, the place of their files by --root and the \
         report may change between runs",
        in_lines(.differences)
    )]
    OtherSettings {
        /// The file.
        path: PathBuf,
        /// Hash in the file.
        found: String,
        /// Hash of the settings now.
        expected: String,
        /// What differs, in lines; empty: it cannot be told.
        differences: String,
    },
}

impl JournalError {
    /// With what differs between these settings and those that the directory keeps.
    pub(crate) fn with_differences_from(self, now: &EvaluateConfig) -> Self {
        match self {
            Self::OtherSettings { path, found, expected, .. } => {
                let kept = path.parent().and_then(EvaluateConfig::kept_in);
                let differences = kept.map(|kept| kept.differences(now)).unwrap_or_default();
                Self::OtherSettings { path, found, expected, differences }
            }
            other => other,
        }
    }
}

fn way_out(restored: &Option<String>) -> String {
    match restored {
        Some(line) => format!(
            "write this line, which follows from config.toml, at the top, in place of a damaged one, or give another \
             --out:\n{line}"
        ),
        None => "restore it from a copy, or give another --out".to_owned(),
    }
}

fn in_lines(differences: &str) -> String {
    if differences.is_empty() { " ".to_owned() } else { format!("\n{differences}") }
}
