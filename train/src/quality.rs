//! The figures of a validation, which a checkpoint carries only of its own weights.

use crate::task::Validation;
use model::checkpoint::{self, Checkpoint};
use serde::de::DeserializeOwned;
use std::path::Path;

/// What their keys in `[provenance]` begin with.
const PREFIX: &str = "validation_";

/// Notes the figures of the weights after `step` steps, in place of those before.
pub fn note<C>(info: &mut Checkpoint<C>, step: u64, validation: &Validation) {
    let r = &validation.ranking;
    for (key, value) in [
        ("loss", validation.loss),
        ("relative_regret", r.relative_regret()),
        ("rank_correlation", r.rank_correlation),
        ("hit_rate", r.hit_rate),
    ] {
        info.provenance.insert(format!("{PREFIX}{key}"), format!("{value:.4}"));
    }
    info.step = step;
}

/// The description of the weights after `step` steps: without figures where those known are of an earlier step.
pub fn described<C: Clone>(info: &Checkpoint<C>, step: u64) -> Checkpoint<C> {
    let mut info = info.clone();
    if info.step != step {
        info.provenance.retain(|key, _| !key.starts_with(PREFIX));
        info.step = step;
    }
    info
}

/// Takes the figures of the checkpoint that a run goes on from, at `step`, so that they stay where it is saved again without a
/// further step. A description that cannot be read, which resuming does not need, has none.
pub fn take_over<C: DeserializeOwned>(info: &mut Checkpoint<C>, latest: &Path, step: u64) {
    info.step = step;
    if let Some(stored) = checkpoint::description::<C>(latest).ok().filter(|stored| stored.step == step) {
        info.provenance.extend(stored.provenance.into_iter().filter(|(key, _)| key.starts_with(PREFIX)));
    }
}
