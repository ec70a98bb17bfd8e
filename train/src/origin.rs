//! Whether a run can be resumed: only with the settings and the data that it was started with.

use crate::TrainError;
use crate::checkpoint::{self, TrainingState};
use crate::config::TrainConfig;
use crate::task::Task;
use std::path::Path;

/// Hash of the settings that decide the weights of a step; a resumed run may change the others.
///
/// # Errors
/// Settings that TOML cannot say.
pub fn decisive_settings(config: &TrainConfig) -> Result<String, TrainError> {
    let other = TrainConfig::default();
    let decisive = TrainConfig {
        data: other.data,
        epochs: 1,
        device: other.device,
        validation: config.validation.clone(),
        episodes: other.episodes,
        checkpoint: other.checkpoint,
        loader: other.loader,
        ..config.clone()
    };
    let text = formats::config::to_toml(&decisive).map_err(formats::run::RunError::from)?;
    // As it was hashed before there was this setting, so that runs from then go on.
    let lines: String = text.split_inclusive('\n').filter(|line| !line.starts_with("precision = ")).collect();
    Ok(formats::config::digest(lines.as_bytes()))
}

/// Where the run in `dir` stands, which is to resume with this task and these settings.
///
/// # Errors
/// No such run, a damaged one, or one of other settings or data.
pub fn resumable<T: Task>(task: &T, config: &TrainConfig, dir: &Path) -> Result<TrainingState, TrainError> {
    let latest = dir.join("latest");
    let state = checkpoint::load_state(&latest)?;
    check_origin(&state, &decisive_settings(config)?, &task.data_name(), &latest)?;
    Ok(state)
}

fn check_origin(state: &TrainingState, settings: &str, data: &str, latest: &Path) -> Result<(), TrainError> {
    let refuse = |problem: String| Err(TrainError::Checkpoint { path: latest.to_path_buf(), problem });
    if state.settings != settings {
        return refuse(
            "it was made with different settings; resume with --resume, which uses those of the run (only \
             epochs, device, precision, episodes, checkpoint and loader may change), or start a new run in another --out"
                .into(),
        );
    }
    if state.data != data {
        return refuse(format!("it was trained on {}, not on {data}; name that set with --data", state.data));
    }
    Ok(())
}
