//! Why training cannot start or continue.

use std::path::{Path, PathBuf};

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The operating system refuses.
    #[error("cannot {action} {path:?}: {cause}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
    },
    /// A data or output file is unreadable or cannot be written.
    #[error(transparent)]
    Format(#[from] formats::FormatError),
    /// Another process writes there.
    #[error(transparent)]
    Lock(#[from] formats::lock::LockError),
    /// A run directory cannot be made.
    #[error(transparent)]
    Run(#[from] formats::run::RunError),
    /// A setting is out of its range.
    #[error("setting {key} = {found}: {expected}")]
    Setting {
        /// Its dotted key.
        key: &'static str,
        /// The value.
        found: String,
        /// What would do.
        expected: String,
    },
    /// There is no data set to train from.
    #[error(
        "{searched}; make a data set with `datagen` (for example `datagen --dataset procedural --out runs/data/first`), \
         or name one with --data DIR"
    )]
    NoData {
        /// Where, and what was missing.
        searched: String,
    },
    /// A data set cannot be trained from.
    #[error("{path:?}: {problem}; {way_out}")]
    Data {
        /// The data set or file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
        /// What to do.
        way_out: String,
    },
    /// A checkpoint cannot be used.
    #[error("checkpoint {path:?}: {problem}")]
    Checkpoint {
        /// Its directory or file.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// Weights cannot be read or written.
    #[error(transparent)]
    Weights(#[from] model::checkpoint::CheckpointError),
    /// The device cannot be had.
    #[error(transparent)]
    Device(#[from] model::device::DeviceError),
    /// A device computes something else than the CPU does.
    #[error(
        "device `{device}` gives wrong results: {found}; losses may differ by {loss} % and gradients by {gradient} %. There is a fault in its kernels or its driver: try CUBECL_AUTOTUNE_LEVEL=minimal in the environment, another driver, or `--device cpu`"
    )]
    Disagrees {
        /// Its name.
        device: String,
        /// What came out on both.
        found: String,
        /// Share by which losses may differ, percent.
        loss: f64,
        /// Share by which gradients may differ, percent.
        gradient: f64,
    },
    /// A GPU gave up in a step; burn says so by a panic.
    #[error(
        "device `{device}` failed in a step: {reason}. If its memory is too small, a larger `accumulation` (now {accumulation}) \
         computes a batch in more parts (batch norm sees a part at a time), and a smaller `batch` (now {batch}) takes less; \
         what was learnt up to the last save is in {checkpoint:?}"
    )]
    DeviceFailed {
        /// Its name.
        device: String,
        /// The panic's message.
        reason: String,
        /// The setting.
        accumulation: usize,
        /// The setting.
        batch: usize,
        /// Where the last save is.
        checkpoint: PathBuf,
    },
    /// Loss or gradient were not finite for too many steps in a row.
    #[error(
        "loss or gradient was not finite in {steps} steps in a row (last at step {step}); the last good state is in \
         {checkpoint:?}; lower optimizer.learning_rate (now {rate}), set optimizer.clip_norm, or look for bad data in log.jsonl"
    )]
    Diverged {
        /// Steps in a row.
        steps: u32,
        /// Steps done.
        step: u64,
        /// Learning rate.
        rate: f64,
        /// Where the last good state is.
        checkpoint: PathBuf,
    },
    /// Not one step of an epoch changed the weights.
    #[error(
        "not one of the {steps} steps of epoch {epoch} changed the weights: loss or gradient was not finite, or no sample could be \
         used (log.jsonl says which); {kept}; start a new run with a lower --lr (now {rate:e}) or with optimizer.clip_norm, or look \
         for bad data in log.jsonl"
    )]
    NothingLearnt {
        /// The epoch, from 1.
        epoch: u32,
        /// Its steps.
        steps: usize,
        /// Learning rate.
        rate: f64,
        /// What is left of the run, and where.
        kept: String,
    },
    /// Every epoch was trained, and no validation came out finite.
    #[error(
        "the validation loss was not finite in any of {epochs} epochs: the weights are of no use ({kept}); start a new run with a \
         lower --lr (now {rate:e}) or with optimizer.clip_norm, or look for bad data in log.jsonl"
    )]
    NeverFinite {
        /// Epochs done.
        epochs: u32,
        /// The setting.
        rate: f64,
        /// What is left of the run, and where.
        kept: String,
    },
    /// The loader ended early.
    #[error("a loader thread ended without a batch: {0}")]
    Loader(String),
}

impl TrainError {
    /// An error of the operating system.
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> TrainError {
        TrainError::Io { action, path: path.to_path_buf(), cause: source }
    }

    /// A setting out of range.
    pub(crate) fn setting(key: &'static str, found: impl ToString, expected: impl Into<String>) -> TrainError {
        TrainError::Setting { key, found: found.to_string(), expected: expected.into() }
    }
}
