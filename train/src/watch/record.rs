//! What is reported while training: one record per step, per epoch, per round of closed-loop episodes.

use crate::metrics::RankingMetrics;
use serde::{Deserialize, Deserializer, Serialize};

/// One line of `log.jsonl`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Record {
    /// An optimizer step.
    Step(StepRecord),
    /// An epoch and its validation.
    Epoch(EpochRecord),
    /// Closed-loop episodes on held-out objects.
    Episodes(EpisodesRecord),
    /// Something that a person should know: a refused sample, a skipped step, a resumption.
    Message {
        /// Steps done.
        step: u64,
        /// The sentence.
        text: String,
    },
}

impl Record {
    /// Optimizer steps done when it was written.
    pub fn step(&self) -> u64 {
        match self {
            Record::Step(r) => r.step,
            Record::Epoch(r) => r.step,
            Record::Episodes(r) => r.step,
            Record::Message { step, .. } => *step,
        }
    }

    /// The epoch, from 0, at whose end it was written: after its last step.
    pub fn ended_epoch(&self) -> Option<u32> {
        match self {
            Record::Epoch(r) => Some(r.epoch),
            Record::Episodes(r) => Some(r.epoch),
            Record::Step(_) | Record::Message { .. } => None,
        }
    }
}

/// One optimizer step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRecord {
    /// Steps done, this one included.
    pub step: u64,
    /// Epoch, from 0.
    pub epoch: u32,
    /// Training loss of the step's batch.
    #[serde(deserialize_with = "null_as_nan")]
    pub loss: f64,
    /// Learning rate.
    #[serde(deserialize_with = "null_as_nan")]
    pub learning_rate: f64,
    /// L2 norm of the whole gradient before clipping.
    #[serde(deserialize_with = "null_as_nan")]
    pub gradient_norm: f64,
    /// Samples in the step.
    pub samples: usize,
    /// Wall time of the step, seconds.
    #[serde(deserialize_with = "null_as_nan")]
    pub seconds: f64,
    /// Of it, the wait for the loader.
    #[serde(deserialize_with = "null_as_nan")]
    pub wait_seconds: f64,
}

/// One epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpochRecord {
    /// Steps done.
    pub step: u64,
    /// Epoch, from 0.
    pub epoch: u32,
    /// Mean training loss over the epoch.
    #[serde(deserialize_with = "null_as_nan")]
    pub train_loss: f64,
    /// Loss on the validation objects.
    #[serde(deserialize_with = "null_as_nan")]
    pub valid_loss: f64,
    /// How the validation candidates are ordered.
    pub valid: RankingMetrics,
    /// Whether this is the lowest validation regret so far.
    pub best: bool,
    /// Learning rate of the last step.
    #[serde(deserialize_with = "null_as_nan")]
    pub learning_rate: f64,
    /// Wall time, seconds, validation included.
    #[serde(deserialize_with = "null_as_nan")]
    pub seconds: f64,
    /// Training samples per second, validation excluded.
    #[serde(deserialize_with = "null_as_nan")]
    pub samples_per_second: f64,
}

/// Closed-loop episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodesRecord {
    /// Steps done.
    pub step: u64,
    /// Epoch, from 0.
    pub epoch: u32,
    /// Episodes that counted.
    pub episodes: usize,
    /// Mean final coverage, in [0, 1].
    #[serde(deserialize_with = "null_as_nan")]
    pub coverage: f64,
    /// Mean number of views to 90 % coverage; never reached counts one more than the views of an episode.
    #[serde(deserialize_with = "null_as_nan")]
    pub views_to_90: f64,
    /// Wall time, seconds.
    #[serde(deserialize_with = "null_as_nan")]
    pub seconds: f64,
}

/// A number as JSON has it, where NaN and the infinities are null: read as NaN.
///
/// # Errors
/// Neither a number nor null.
pub(crate) fn null_as_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
