//! A directory of results as `--compare` takes it: what its journal holds, and what its run was asked for.

use crate::journal::{self, Contents, JournalError};
use formats::ConfigError;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A folder of results.
pub struct Folder {
    /// Its name, for headers.
    pub name: String,
    /// Its journal.
    pub contents: Contents,
    /// What its `config.toml` says; `None` without one.
    pub settings: Option<Settings>,
    /// That its run did not come to its end, and how many episodes are left.
    pub unfinished: Option<String>,
}

/// The settings on which it depends whether and how runs can be compared. Other keys, and those of older programs, are left alone.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Seed of everything random.
    pub seed: u64,
    /// The objects.
    pub dataset: Dataset,
    /// The scanning loop.
    pub episode: Episode,
}

/// `[dataset]`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Dataset {
    /// Which.
    pub name: String,
}

/// `[episode]`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Episode {
    /// Next views after the first scan.
    pub num_views: usize,
}

impl Settings {
    /// Whether the run was on recorded sequences, not in the simulator.
    pub fn recorded(&self) -> bool {
        self.dataset.name == "sequences"
    }
}

/// How a run ended; the rest of `run.toml` does not matter here.
#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct Ending {
    ended: Option<String>,
    outcome: Option<String>,
}

/// Why a folder cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// Its journal cannot be used.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// One of its files is not what `evaluate` wrote.
    #[error("{0}; the command that made this directory writes the file again")]
    File(#[from] ConfigError),
}

/// The results in these folders, under names that tell them apart.
///
/// # Errors
/// As [`read`].
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Folder>, FolderError> {
    names(paths).into_iter().zip(paths).map(|(name, path)| Ok(Folder { name, ..read(path)? })).collect()
}

/// The last part of each path, and as much before it as tells it from the others.
fn names(paths: &[PathBuf]) -> Vec<String> {
    fn last(path: &Path, parts: usize) -> PathBuf {
        path.components().skip(path.components().count().saturating_sub(parts)).collect()
    }
    let name = |path: &PathBuf| {
        let alone = |parts: &usize| {
            let mut others = paths.iter().filter(|other| *other != path);
            others.all(|other| last(other, *parts) != last(path, *parts))
        };
        let all = path.components().count();
        last(path, (1..all).find(alone).unwrap_or(all)).to_string_lossy().into_owned()
    };
    paths.iter().map(name).collect()
}

/// The results in this folder.
///
/// # Errors
/// No journal; a file that cannot be used.
pub fn read(path: &Path) -> Result<Folder, FolderError> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    Ok(Folder {
        name,
        contents: journal::read(path)?,
        settings: toml_of(&path.join("config.toml"))?,
        unfinished: toml_of::<Ending>(&path.join("run.toml"))?.and_then(|ending| unfinished(&ending)),
    })
}

/// A TOML file, if it is there.
fn toml_of<T: Serialize + DeserializeOwned + Default>(path: &Path) -> Result<Option<T>, ConfigError> {
    path.exists().then(|| formats::config::load(Some(path), &[], &[])).transpose()
}

/// What [`crate::run::run`] noted of a run that did not come to its end.
fn unfinished(ending: &Ending) -> Option<String> {
    if ending.ended.is_none() {
        return Some("unfinished: it is still going, or was killed".to_owned());
    }
    let outcome = ending.outcome.as_deref().filter(|outcome| outcome.starts_with("stopped"))?;
    let said = outcome.split("; ").find(|part| part.starts_with("unfinished: "));
    // Older programs did not note how many.
    Some(said.unwrap_or("unfinished: episodes left").to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_did_not_end_is_unfinished() {
        let of = |ended: bool, outcome: &str| {
            let ended = ended.then(|| "2026-01-31T12:00:00Z".to_owned());
            unfinished(&Ending { ended, outcome: Some(outcome.to_owned()) })
        };
        assert_eq!(of(true, "finished"), None);
        let stopped = of(true, "stopped; unfinished: 3 of 4 episodes left; the same command resumes");
        assert_eq!(stopped.as_deref(), Some("unfinished: 3 of 4 episodes left"));
        assert_eq!(of(true, "stopped; the same command resumes").as_deref(), Some("unfinished: episodes left"));
        assert!(of(false, "").is_some_and(|text| text.contains("killed")));
    }

    #[test]
    fn names_tell_folders_apart() {
        let of = |paths: &[&str]| names(&paths.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["runs/x/near/", "runs/far"]), ["near", "far"]);
        assert_eq!(of(&["runs/x/near", "runs/y/near", "far"]), ["x/near", "y/near", "far"]);
        assert_eq!(of(&["near", "x/near"]), ["near", "x/near"]);
        assert_eq!(of(&["x/near", "x/near"]), ["near", "near"], "one and the same");
        let directory = tempfile::tempdir().expect("dir");
        let paths = ["x/near", "y/near"].map(|path| directory.path().join(path));
        paths.iter().for_each(|path| drop(journal::Journal::open(path, "h", "h").expect("a journal")));
        let names: Vec<String> = read_all(&paths).expect("folders").into_iter().map(|f| f.name).collect();
        assert_eq!(names, ["x/near", "y/near"]);
    }

    #[test]
    fn only_a_folder_of_evaluate_is_read() {
        let directory = tempfile::tempdir().expect("dir");
        assert!(matches!(read(directory.path()), Err(FolderError::Journal(_))));
        let config = crate::config::EvaluateConfig::default();
        drop(journal::Journal::open(directory.path(), "h", "h").expect("a journal"));
        let bare = read(directory.path()).expect("an older folder");
        assert_eq!((bare.settings, bare.unfinished), (None, None));
        formats::run::RunDir::create(directory.path(), "evaluate", "c", &config).expect("written");
        let folder = read(directory.path()).expect("a folder");
        let settings = folder.settings.expect("settings");
        assert_eq!((settings.seed, settings.recorded(), settings.episode.num_views), (0, false, 15));
        assert!(folder.unfinished.is_some(), "it has begun and not ended");
        std::fs::write(directory.path().join("config.toml"), "seed = \"x\"").expect("written");
        let error = read(directory.path()).err().expect("refused").to_string();
        assert!(error.contains("config.toml") && error.contains("seed"), "{error}");
    }
}
