//! Whether a run can be resumed: only with the settings and the data that it was started with.

use crate::TrainError;
use crate::checkpoint::{self, TrainingState};
use crate::config::TrainConfig;
use crate::data::CONTENTS;
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
    if state.data != data && state.data != without_contents(data) {
        return refuse(format!("it was trained on {}, not on {data}; name that set with --data", state.data));
    }
    Ok(())
}

/// The data's name as it was before there were digests of samples in it, so that runs from then go on.
fn without_contents(data: &str) -> String {
    let (first, rest) = data.split_once(CONTENTS).unwrap_or((data, ""));
    let after_digits = |part: &str| part.trim_start_matches(|c: char| c.is_ascii_hexdigit()).to_owned();
    first.to_owned() + &rest.split(CONTENTS).map(after_digits).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::{Schedule, ScheduleConfig};

    #[test]
    fn a_run_of_before_goes_on_with_the_data_of_its_name_and_no_other() {
        let schedule = Schedule::new(&ScheduleConfig::default(), 1.0, 1).state();
        let check = |of_run: &str, now: &str| {
            let state = TrainingState::fresh("h".into(), of_run.into(), schedule);
            check_origin(&state, "h", now, Path::new("run/latest")).map_err(|e| e.to_string())
        };
        let one = "folder (settings 4ae0, seed 0, 383 samples), contents 0123456789abcdef";
        let other = "folder (settings 4ae0, seed 0, 383 samples), contents 0123456789abcdee";
        let joined = format!("{one} + 3 frame histories, contents 00000000000000ff");
        assert_eq!(check(one, one), Ok(()));
        assert_eq!(check("folder (settings 4ae0, seed 0, 383 samples)", one), Ok(()));
        assert_eq!(check("folder (settings 4ae0, seed 0, 383 samples) + 3 frame histories", &joined), Ok(()));
        assert_eq!(check("41 objects, 7 states", "41 objects, 7 states"), Ok(()), "generated data");
        let text = check(one, other).expect_err("other samples");
        assert!(
            text.contains(&format!("it was trained on {one}, not on {other}; name that set with --data")),
            "{text}"
        );
        check("folder (settings 4ae0, seed 0, 384 samples)", one).expect_err("another number of samples");
        check(one, &joined).expect_err("more data");
    }
}
