//! What a journal holds, and what of it does not count any more.

use crate::record::{EpisodeKey, EpisodeRecord, Skipped, Timing};
use std::collections::{BTreeMap, BTreeSet};

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
        self.each_key().cloned().collect()
    }

    /// Names of the objects.
    pub(crate) fn objects(&self) -> BTreeSet<&str> {
        self.each_key().map(|key| key.object.as_str()).collect()
    }

    fn each_key(&self) -> impl Iterator<Item = &EpisodeKey> {
        self.episodes.iter().map(|(r, _)| &r.key).chain(self.skipped.iter().map(|s| &s.key))
    }

    /// Forgets the episodes of this policy with other weights than these, and says how many; those that could not be run with
    /// others too: older programs did not note with which.
    pub fn forget_other_weights(&mut self, policy: &str, weights: Option<&str>) -> usize {
        self.skipped.retain(|s| s.key.policy != policy || s.weights.as_deref() == weights);
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

    /// Objects of which episodes were run on other files than these, given by object. Older programs did not note the files.
    pub(crate) fn on_other_files(&self, now: &BTreeMap<&str, Option<String>>) -> BTreeSet<String> {
        let other = |r: &&EpisodeRecord| {
            r.files.is_some() && now.get(r.key.object.as_str()).is_some_and(|files| *files != r.files)
        };
        self.episodes.iter().map(|(r, _)| r).filter(other).map(|r| r.key.object.clone()).collect()
    }

    /// Forgets what could not be run on other files than these, given by object.
    pub(crate) fn forget_skipped_on_other_files(&mut self, now: &BTreeMap<&str, Option<String>>) {
        self.skipped.retain(|s| now.get(s.key.object.as_str()).is_none_or(|files| *files == s.files));
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
