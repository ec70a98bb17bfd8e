//! The whole state of a run on disk: a checkpoint directory of `model` with what exact resumption needs beside it.
//!
//! `training.bpk` holds the weights with their parameter ids (the optimizer's state is keyed by those, and a set of
//! weights loaded from `model.safetensors` would have fresh ones), `optimizer.bpk` the moments, `average.bpk` the
//! moving average where there is one, `training.toml` everything else. The directory appears whole or not at all, and each
//! of its files is held against `SHA256SUMS` when it is read.

use crate::TrainError;
use crate::learner::Learner;
use crate::schedule::{Best, ScheduleState};
use burn::store::ModuleRecord;
use burn::tensor::Bytes;
use model::checkpoint::Checkpoint;
use model::published::Network;
use model::sums::Sums;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Names of the files.
const WEIGHTS: &str = "training.bpk";
const MOMENTS: &str = "optimizer.bpk";
const AVERAGE: &str = "average.bpk";
const STATE: &str = "training.toml";

/// Version of `training.toml`.
const SCHEMA_VERSION: u32 = 1;

/// Where a run stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingState {
    /// Version of this layout.
    pub schema_version: u32,
    /// Hash of the settings that decide the weights.
    pub settings: String,
    /// The data's name.
    pub data: String,
    /// Optimizer steps done, skipped ones included.
    pub step: u64,
    /// Epoch under way, from 0.
    pub epoch: u32,
    /// Steps of it that are done.
    pub step_in_epoch: usize,
    /// Sum of its losses, by sample.
    pub loss_sum: f64,
    /// Samples in that sum.
    pub loss_samples: usize,
    /// Steps in a row, up to now, without a finite loss and gradient.
    #[serde(default)]
    pub skipped_in_row: u32,
    /// Whether early stopping has ended the run.
    pub stopped: bool,
    /// The learning rate's memory.
    pub schedule: ScheduleState,
    /// Lowest relative validation regret.
    pub best: Best,
}

impl TrainingState {
    /// The start of a run.
    pub fn fresh(settings: String, data: String, schedule: ScheduleState) -> Self {
        TrainingState {
            schema_version: SCHEMA_VERSION,
            settings,
            data,
            step: 0,
            epoch: 0,
            step_in_epoch: 0,
            loss_sum: 0.0,
            loss_samples: 0,
            skipped_in_row: 0,
            stopped: false,
            schedule,
            best: Best::default(),
        }
    }
}

/// Saves everything to `directory`, replacing what is there.
pub fn save<N: Network>(
    directory: &Path,
    learner: &Learner<N>,
    info: &Checkpoint<N::Config>,
    state: &TrainingState,
) -> Result<(), TrainError> {
    let failed = |name: &str, e: &dyn std::fmt::Display| {
        TrainError::io("write", &directory.join(name), std::io::Error::other(e.to_string()))
    };
    let text = toml::to_string(state).map_err(|e| failed(STATE, &e))?;
    let weights = learner.net.clone().into_record().into_bytes().map_err(|e| failed(WEIGHTS, &e))?;
    let moments = learner.optimizer.into_bytes().map_err(|e| failed(MOMENTS, &e))?;
    let average = learner.average.clone().map(|average| average.into_record().into_bytes()).transpose();
    let average = average.map_err(|e| failed(AVERAGE, &e))?;
    let mut files = vec![(WEIGHTS, &weights[..]), (MOMENTS, &moments[..]), (STATE, text.as_bytes())];
    files.extend(average.as_ref().map(|bytes| (AVERAGE, &bytes[..])));
    Ok(model::checkpoint::save_with(directory, &learner.evaluated(), info, &files)?)
}

/// The directory, or where a crash came between the two renames of a save, the previous one beside it.
fn surviving(directory: &Path) -> PathBuf {
    let aside = directory.file_name().map(|n| directory.with_file_name(format!(".{}.old", n.to_string_lossy())));
    match aside {
        Some(aside) if !directory.exists() && aside.join(STATE).exists() => aside,
        _ => directory.to_path_buf(),
    }
}

/// Whether a run can be resumed from here.
pub fn exists(directory: &Path) -> bool {
    surviving(directory).join(STATE).exists()
}

/// Removes what a killed save left behind. A save's staging directory ends in `.partial`.
pub fn remove_partial(parent: &Path) {
    for entry in std::fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') && name.ends_with(".partial") {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

/// Where the run in `directory` stands.
pub fn load_state(directory: &Path) -> Result<TrainingState, TrainError> {
    let directory = surviving(directory);
    let path = directory.join(STATE);
    let bytes = std::fs::read(&path).map_err(|e| TrainError::io("read", &path, e))?;
    Sums::read(&directory)?.check(STATE, &bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let bad = |problem: String| TrainError::Checkpoint { path: path.clone(), problem };
    let state: TrainingState = toml::from_str(&text).map_err(|e| bad(e.to_string()))?;
    if state.schema_version != SCHEMA_VERSION {
        return Err(bad(format!(
            "schema_version = {}, but this program reads {SCHEMA_VERSION}; use the program that wrote it",
            state.schema_version
        )));
    }
    Ok(state)
}

/// Loads weights, moments and average into a learner of the same shape (fresh from the same settings).
pub fn load_into<N: Network>(directory: &Path, learner: Learner<N>) -> Result<Learner<N>, TrainError> {
    let directory = surviving(directory);
    let sums = Sums::read(&directory)?;
    let read = |name: &str| {
        let path = directory.join(name);
        let bytes = std::fs::read(&path).map_err(|e| TrainError::io("read", &path, e))?;
        sums.check(name, &bytes)?;
        Ok::<_, TrainError>((Bytes::from_bytes_vec(bytes), path))
    };
    let bad = |path: &Path, e: &dyn std::fmt::Display| TrainError::Checkpoint {
        path: path.to_path_buf(),
        problem: format!("{e}; it is damaged or belongs to another network: use another checkpoint"),
    };
    let record = |name: &str| {
        let (bytes, path) = read(name)?;
        let record = ModuleRecord::from_bytes(bytes).map_err(|e| bad(&path, &e))?;
        Ok::<_, TrainError>((record, path))
    };
    let (weights, path) = record(WEIGHTS)?;
    let net = learner.net.try_load_record(weights).map_err(|e| bad(&path, &e))?;
    let (moments, path) = read(MOMENTS)?;
    model::device::check_default()?;
    let optimizer = learner.optimizer.from_bytes(moments).map_err(|e| bad(&path, &e))?;
    let average = match learner.average {
        Some(average) => {
            let (weights, path) = record(AVERAGE)?;
            Some(average.try_load_record(weights).map_err(|e| bad(&path, &e))?)
        }
        None => None,
    };
    Ok(Learner { net, average, optimizer })
}
