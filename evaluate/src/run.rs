//! A whole run in its directory: the episodes that are missing, then the report on all that were asked for.

use crate::batches::{self, NothingRun, Watch};
use crate::benchmark::BenchmarkError;
use crate::config::EvaluateConfig;
use crate::journal::{Contents, Journal, JournalError};
use crate::networks::Networks;
use crate::objects::{self, files};
use crate::policies::{Policy, weights_of};
use crate::record::EpisodeKey;
use crate::report::{self, Missing, Unfinished, tables::Rows};
use datagen::dataset::DatasetError;
use datagen::{OutputError, OutputKind, check_output};
use formats::lock::{LOCK, LockError, try_lock};
use formats::run::RunDir;
use formats::{ConfigError, FormatError};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// There are no such objects.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The directory is another program's.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Another process writes there.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The journal cannot be used.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The directory's episodes were run on other objects of the same names.
    #[error(transparent)]
    Files(#[from] files::OtherFiles),
    /// The settings cannot be kept.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The directory cannot be used.
    #[error(transparent)]
    Directory(#[from] formats::run::RunError),
    /// A policy cannot be made.
    #[error(transparent)]
    Benchmark(#[from] BenchmarkError),
    /// A file cannot be written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// Nothing could be run.
    #[error(transparent)]
    Nothing(#[from] NothingRun),
}

/// How a run ended.
pub enum Ended {
    /// Interrupted, with a preliminary report if any episode is done; the same call resumes it.
    Stopped {
        /// Episodes that are done.
        done: usize,
        /// Episodes that are not.
        left: usize,
    },
    /// All is done and reported.
    Finished {
        /// Rows of the tables.
        rows: Box<Rows>,
        /// What they were made of.
        contents: Contents,
    },
}

/// Runs what is missing of these policies on the objects of the settings, and reports on these alone: the journal of a run to which
/// policies, objects or episodes were added holds more. The settings are known to be good ([`EvaluateConfig::validate`]),
/// the policies too ([`crate::policies::check`]).
///
/// # Errors
/// No objects, a directory in use, or of other settings or objects, nothing that could be run.
pub fn run(
    out: &Path,
    policies: &[Policy],
    config: &EvaluateConfig,
    networks: &Networks,
    stop: &AtomicBool,
    watch: &impl Watch,
) -> Result<Ended, ReportError> {
    let names: Vec<String> = policies.iter().map(Policy::to_string).collect();
    let sources = objects::list(config)?;
    check_output(out, OutputKind::Evaluation)?;
    let _lock = try_lock(out, LOCK, "evaluate")?;
    let (journal, mut contents) = Journal::open(out, &config.outcome_hash()?, &config.placed_hash()?)
        .map_err(|error| error.with_differences_from(config))?;
    files::check(out, &sources, config.surface, &mut contents)?;
    for policy in policies {
        if policy.is_own() {
            contents.forget_skipped(policy.name());
        }
        let outdated = if policy.may_have_changed() {
            contents.forget(policy.name())
        } else {
            contents.forget_other_weights(policy.name(), weights_of(policy, config, networks).as_deref())
        };
        if outdated > 0 {
            watch.outdated(policy.name(), outdated);
        }
    }
    let mut directory = RunDir::create(out, "evaluate", built::COMMIT, config)?;
    let mixture = directory.mixture("episodes");
    let total = sources.len() * policies.len() * config.episodes;
    let objects: BTreeSet<&str> = sources.iter().map(|source| source.name.as_str()).collect();
    let wanted = |key: &EpisodeKey| {
        objects.contains(key.object.as_str()) && names.contains(&key.policy) && key.episode < config.episodes
    };
    let done = contents.keys().iter().filter(|k| wanted(k)).count();
    if let Some(mixture) = mixture.filter(|_| (1..total).contains(&done)) {
        tracing::warn!("{mixture}");
    }
    watch.begun(total, done);
    let outcome = batches::run(&sources, policies, config, networks, &journal, &mut contents, stop, watch)?;
    contents.episodes.retain(|(r, _)| wanted(&r.key));
    contents.skipped.retain(|s| wanted(&s.key));
    let missing = Missing {
        unfinished: (outcome.left > 0).then_some(Unfinished { left: outcome.left, asked: outcome.asked }),
        unusable: outcome.unusable.iter().map(|(name, reason)| (name.clone(), reason.to_string())).collect(),
        objects: outcome.objects,
    };
    if missing.unfinished.is_some() {
        let done = contents.episodes.len();
        if done > 0 {
            report::write(out, &contents, config, &names, &outcome.shown, &missing)?;
        }
        directory.finish(&missing.outcome())?;
        return Ok(Ended::Stopped { done, left: outcome.left });
    }
    if let Err(nothing) = outcome.anything(&contents) {
        directory.finish("nothing could be run")?;
        return Err(nothing.into());
    }
    let rows = report::write(out, &contents, config, &names, &outcome.shown, &missing)?;
    directory.finish(&missing.outcome())?;
    Ok(Ended::Finished { rows: Box::new(rows), contents })
}
