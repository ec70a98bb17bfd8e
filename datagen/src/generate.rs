//! From a list of objects to a directory of shards.
//!
//! One shard per object, named after it, written whole or not at all: what exists is done. So a run that was stopped
//! at any moment resumes with the same command, and several processes fill one directory, each with its part of
//! the list. Nothing that is written depends on the number of threads or the clock, but for `run*.toml`.

mod manifest;
mod meshes;
mod object;

use crate::config::DatagenConfig;
use crate::dataset::{DatasetError, Object};
use crate::output::{OutputError, OutputKind, check_output};
use formats::lock::{LOCK, Lock, LockError};
use formats::run::{RunDir, RunError};
use formats::{ConfigError, FormatError, ObjectRecord, ObjectStatus};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

pub use manifest::{shard_path, skip_path};

/// Why data generation stopped.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// The data set cannot be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A file cannot be written or read.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The settings cannot be read or stored.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The run directory cannot be made.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The directory holds the output of another program.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The directory holds a set made with other settings.
    #[error(
        "{out:?} contains a set made with different settings:\n{differences}give another --out, or delete it to start over"
    )]
    OtherSettings {
        /// The directory.
        out: PathBuf,
        /// One line per setting.
        differences: String,
    },
    /// The directory holds shards of other meshes.
    #[error(
        "{out:?} contains shards that were made from other meshes of these names: {objects}; give another --out, or delete \
         these shards to make them anew"
    )]
    OtherMeshes {
        /// The directory.
        out: PathBuf,
        /// The first objects.
        objects: String,
    },
    /// Another process makes the same part.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The threads cannot be started.
    #[error("cannot start threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Which share of the work list a process takes: objects whose place, modulo `count`, is `index`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// From 0.
    pub index: usize,
    /// Number of parts.
    pub count: usize,
}

impl Part {
    /// All of the work.
    pub const WHOLE: Part = Part { index: 0, count: 1 };
}

/// The outcome for the objects of this process.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Shards written now.
    pub made: usize,
    /// Shards that were there.
    pub kept: usize,
    /// Damaged shards that were made anew.
    pub damaged: Vec<PathBuf>,
    /// Objects that cannot be used, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Objects left undone because the run was stopped.
    pub left: usize,
    /// Samples in the shards of this process.
    pub samples: usize,
    /// Mean final coverage of the objects in these shards, in [0, 1]; absent where there is none.
    pub final_coverage: Option<f64>,
    /// First views drawn again.
    pub void_episodes: usize,
}

/// What a directory of shards is made of.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// The settings.
    pub config: &'a DatagenConfig,
    /// The whole work list.
    pub objects: &'a [Object],
    /// This process's share.
    pub part: Part,
    /// The directory.
    pub out: &'a Path,
    /// Number of threads; 0: one per core.
    pub jobs: usize,
    /// Commit that the program was built from, noted in the shards.
    pub commit: &'a str,
}

impl<'a> Job<'a> {
    /// This process's share of the objects.
    fn mine(&self) -> Vec<&'a Object> {
        self.objects.iter().skip(self.part.index).step_by(self.part.count.max(1)).collect()
    }
}

/// What happened to one object.
#[derive(Clone, Debug)]
enum Outcome {
    /// Its shard was written, or was there.
    Done {
        record: ObjectRecord,
        kept: bool,
    },
    Skipped(String),
    Left,
}

/// Makes the shards that are missing, and the manifest. `stop` ends the run after the objects in hand; `progress` is
/// told after each object how many of how many are done, and its name.
///
/// # Errors
/// A directory of other settings; the first file that cannot be written (what is finished stays).
pub fn generate(
    job: &Job,
    stop: &AtomicBool,
    progress: impl Fn(usize, usize, &str) + Sync,
) -> Result<Summary, GenerateError> {
    let hash = formats::config::hash(&job.config.without_places())?;
    let mine = job.mine();
    let damaged = Mutex::new(vec![]);
    let failure: Mutex<Option<GenerateError>> = Mutex::new(None);
    let done = AtomicUsize::new(0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(job.jobs).build()?;
    let outcomes: Vec<Outcome> = pool.install(|| {
        mine.par_iter()
            .with_max_len(1)
            .map(|object| {
                if stop.load(Ordering::Relaxed) {
                    return Outcome::Left;
                }
                let outcome = object::make(job, &hash, object, &damaged).unwrap_or_else(|error| {
                    stop.store(true, Ordering::Relaxed);
                    lock(&failure).get_or_insert(error);
                    Outcome::Left
                });
                if !matches!(outcome, Outcome::Left) {
                    progress(done.fetch_add(1, Ordering::Relaxed) + 1, mine.len(), &object.name);
                }
                outcome
            })
            .collect()
    });
    if let Some(error) = lock(&failure).take() {
        return Err(error);
    }
    manifest::assemble(job, &hash)?;

    let mut summary = Summary { damaged: std::mem::take(&mut lock(&damaged)), ..Summary::default() };
    summary.damaged.sort();
    let mut final_coverages = vec![];
    for (object, outcome) in mine.iter().zip(outcomes) {
        match outcome {
            Outcome::Left => summary.left += 1,
            Outcome::Skipped(reason) => summary.skipped.push((object.name.clone(), reason)),
            Outcome::Done { record, kept } => {
                summary.kept += usize::from(kept);
                summary.made += usize::from(!kept);
                if let ObjectStatus::Done { samples, coverage, void_episodes, .. } = record.status {
                    summary.samples += samples;
                    summary.void_episodes += void_episodes;
                    final_coverages.extend(coverage.last().copied());
                }
            }
        }
    }
    if !final_coverages.is_empty() {
        summary.final_coverage = Some(final_coverages.iter().sum::<f64>() / final_coverages.len() as f64);
    }
    Ok(summary)
}

/// A panic elsewhere must not cost what is behind the lock.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A run directory that this process may fill.
#[derive(Debug)]
pub struct Prepared {
    /// Notes how the run ends.
    pub run: RunDir,
    /// Held as long as the part is worked on.
    _lock: Lock,
}

/// Makes the run directory: refuses one that holds the output of another program or a set of other settings or meshes, or of
/// which another process makes the same part; stores the settings.
///
/// # Errors
/// Another program's output; other settings, with what differs; other meshes; another process; what the operating system
/// refuses.
pub fn prepare(job: &Job, program: &str) -> Result<Prepared, GenerateError> {
    let name = match job.part {
        Part::WHOLE => "run.toml".to_owned(),
        Part { index, count } => format!("run-{index}-of-{count}.toml"),
    };
    // Before anything is written, the lock included.
    check_output(job.out, OutputKind::DataSet)?;
    meshes::check(job)?;
    manifest::locked(job.out, || {
        let stored = job.out.join("config.toml");
        if stored.exists() {
            check_same_settings(job, &stored)?;
        }
        let lock = lock_part(job.out, job.part)?;
        // Left by a process that was killed.
        for file in ["config.toml", formats::manifest::MANIFEST, &name] {
            formats::run::remove_temporaries(&job.out.join(file));
        }
        let run = RunDir::create_part(job.out, program, job.commit, job.config, &name)?;
        let mine = job.mine();
        let made = mine.iter().filter(|object| shard_path(job.out, &object.name).exists()).count();
        if let Some(mixture) = run.mixture("shards").filter(|_| (1..mine.len()).contains(&made)) {
            tracing::warn!("{mixture}");
        }
        Ok(Prepared { run, _lock: lock })
    })
}

/// A lock for as long as a part is worked on.
pub(crate) fn lock_part(out: &Path, part: Part) -> Result<Lock, LockError> {
    let name = format!("{LOCK}-{}-of-{}", part.index, part.count);
    formats::lock::try_lock(out, &name, &format!("datagen, part {} of {}", part.index, part.count))
}

fn check_same_settings(job: &Job, stored: &Path) -> Result<(), GenerateError> {
    formats::config::check_stored(stored)?;
    let old: DatagenConfig = formats::config::load(Some(stored), &[], &[])?;
    let (old, new) = (old.without_places(), job.config.without_places());
    if old == new {
        return Ok(());
    }
    let (old, new) = (formats::config::to_toml(&old)?, formats::config::to_toml(&new)?);
    let only = |a: &str, b: &str, mark: &str| -> String {
        a.lines().filter(|l| !b.lines().any(|m| m == *l)).map(|l| format!("  {mark} {l}\n")).collect()
    };
    let differences = only(&old, &new, "there:") + &only(&new, &old, "now:  ");
    Err(GenerateError::OtherSettings { out: job.out.to_owned(), differences })
}
