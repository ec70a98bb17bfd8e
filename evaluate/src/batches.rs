//! All objects of a run, as many at a time as keep the cores busy.

use crate::benchmark::{self, BenchmarkError};
use crate::config::EvaluateConfig;
use crate::journal::{Contents, Journal};
use crate::networks::Networks;
use crate::objects::{self, Object, ObjectError};
use crate::policies::Policy;
use crate::record::EpisodeKey;
use datagen::dataset::Object as Source;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};

/// Told what happens.
pub trait Watch: Sync {
    /// An episode is done.
    fn done(&self, key: &EpisodeKey);

    /// An object cannot be used.
    fn unusable(&self, object: &str, reason: &ObjectError);

    /// A recording lacks an input of a policy.
    fn left_out(&self, _object: &str, _policy: &str) {}

    /// So many episodes of a policy were run with other weights, and are run again.
    fn outdated(&self, _policy: &str, _episodes: usize) {}

    /// Of so many episodes so many are done already.
    fn begun(&self, _episodes: usize, _done: usize) {}

    /// This share of an object's surface is seen by no camera around it, and does not count.
    fn unseeable(&self, _object: &str, _share: f64) {}
}

impl Watch for () {
    fn done(&self, _key: &EpisodeKey) {}

    fn unusable(&self, _object: &str, _reason: &ObjectError) {}
}

/// How a run ended.
pub struct Outcome {
    /// The first objects, for the replay.
    pub shown: Vec<Object>,
    /// Objects that cannot be used, and why.
    pub unusable: Vec<(String, ObjectError)>,
    /// Objects that were asked for.
    pub objects: usize,
    /// Episodes that were asked for; of recordings that a stopped run had not yet read, as many as there would be at most.
    pub asked: usize,
    /// Episodes of these that are still to be run, since the run was stopped.
    pub left: usize,
}

/// Why a run that came to its end has nothing to report.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NothingRun {
    /// There was no object.
    #[error("found no object to run on")]
    NoObjects,
    /// No object can be used.
    #[error("none of {count} objects can be used: {reasons}")]
    Unusable {
        /// How many.
        count: usize,
        /// Names and reasons of the first ones.
        reasons: String,
    },
    /// No recording goes with any policy.
    #[error(
        "no sequence has the inputs that these policies need: choose others (see --list-policies), or add what is missing"
    )]
    NothingFits,
    /// No episode can be run.
    #[error("none of {count} episodes could be run: {reasons}")]
    Skipped {
        /// How many.
        count: usize,
        /// The reasons, each once.
        reasons: String,
    },
}

impl Outcome {
    /// Whether there is anything to report.
    ///
    /// # Errors
    /// Why there is not.
    pub fn anything(&self, contents: &Contents) -> Result<(), NothingRun> {
        let count = self.objects;
        if count == 0 {
            return Err(NothingRun::NoObjects);
        }
        if self.unusable.len() == count {
            let reasons: Vec<_> = self.unusable.iter().take(20).map(|(name, why)| format!("{name}: {why}")).collect();
            return Err(NothingRun::Unusable { count, reasons: reasons.join("; ") });
        }
        if contents.episodes.is_empty() && contents.skipped.is_empty() {
            return Err(NothingRun::NothingFits);
        }
        if contents.episodes.is_empty() {
            let reasons: BTreeSet<&str> = contents.skipped.iter().map(|s| s.reason.as_str()).collect();
            let reasons = reasons.into_iter().collect::<Vec<_>>().join("; ");
            return Err(NothingRun::Skipped { count: contents.skipped.len(), reasons });
        }
        Ok(())
    }
}

/// Runs what is missing of all these objects. Ends early once `stop` is set; [`Outcome::left`] says whether anything was
/// missed.
///
/// # Errors
/// As [`benchmark::run`].
pub fn run(
    sources: &[Source],
    policies: &[Policy],
    config: &EvaluateConfig,
    networks: &Networks,
    journal: &Journal,
    contents: &mut Contents,
    stop: &AtomicBool,
    watch: &impl Watch,
) -> Result<Outcome, BenchmarkError> {
    let mut wanted: Vec<EpisodeKey> = Vec::new();
    let mut reached = 0;
    let mut outcome = Outcome { shown: Vec::new(), unusable: Vec::new(), objects: sources.len(), asked: 0, left: 0 };
    for group in sources.chunks(4 * rayon::current_num_threads()) {
        let ready: Vec<_> = group.par_iter().map(|source| objects::load(source, config)).collect();
        let mut usable = Vec::new();
        for (source, object) in group.iter().zip(ready) {
            match object {
                Ok(object) => {
                    if let Some(share) = object.mesh().map(|mesh| mesh.left_out).filter(|share| *share > 0.0) {
                        watch.unseeable(&object.name, share);
                    }
                    usable.push(object);
                }
                Err(reason) => {
                    watch.unusable(&source.name, &reason);
                    outcome.unusable.push((source.name.clone(), reason));
                }
            }
        }
        for (object, policy) in usable.iter().flat_map(|o| policies.iter().map(move |p| (o, p))) {
            if !benchmark::fits(object, policy) {
                watch.left_out(&object.name, policy.name());
            }
        }
        reached += group.len();
        wanted.extend(usable.iter().flat_map(|object| benchmark::wanted(object, policies, config).map(|(_, key)| key)));
        benchmark::run(&usable, policies, config, networks, journal, contents, stop, |key| watch.done(key))?;
        // The first ones stay for the replay.
        if outcome.shown.is_empty() {
            outcome.shown = usable;
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
    }
    let have = contents.keys();
    let of = |source: &Source, policy: &Policy, episode: usize| EpisodeKey {
        object: source.name.clone(),
        policy: policy.to_string(),
        episode,
    };
    let of_object = |source: &Source| {
        let all = policies.iter().flat_map(|policy| (0..config.episodes).map(move |episode| (policy, episode)));
        all.filter(|&(policy, episode)| !have.contains(&of(source, policy, episode))).count()
    };
    let unread = &sources[reached..];
    outcome.asked = wanted.len() + unread.len() * policies.len() * config.episodes;
    outcome.left =
        wanted.iter().filter(|key| !have.contains(key)).count() + unread.iter().map(of_object).sum::<usize>();
    Ok(outcome)
}
