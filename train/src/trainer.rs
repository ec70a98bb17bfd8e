//! The training loop: ours, on burn's optimizers, because resumption has to be exact at any step.

use crate::TrainError;
use crate::agreement;
use crate::checkpoint::{self, TrainingState};
use crate::config::TrainConfig;
use crate::learner::{self, Learner};
use crate::loader::{Loader, epoch_plan, worker_count};
use crate::origin::{decisive_settings, resumable};
use crate::quality;
use crate::schedule::Schedule;
use crate::step::{Group, Step, UNREAD, Work};
use crate::task::Task;
use crate::watch::{EpisodesRecord, EpochRecord, Record, StepRecord, Watch};
use burn::tensor::Device;
use model::checkpoint::Checkpoint;
use model::device::works_by_itself;
use model::published::Network;
use std::collections::BTreeMap;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::time::Instant;

/// Steps in a row without a finite loss and gradient after which training gives up.
const MOST_SKIPPED: u32 = 20;

/// Where a run lives and who may stop it.
pub struct Run<'a> {
    /// Its directory: `latest/`, `best/`, `log.jsonl`, `index.html`, `tensorboard/`.
    pub dir: &'a Path,
    /// Go on from `latest/`.
    pub resume: bool,
    /// Show nothing on the terminal.
    pub quiet: bool,
    /// Asked before each step, with the steps done: true saves and ends the run.
    pub stop: &'a dyn Fn(u64) -> bool,
    /// What checkpoints say of their origin.
    pub provenance: BTreeMap<String, String>,
}

/// How a run ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Where it stands.
    pub state: TrainingState,
    /// False where it was stopped and can be resumed.
    pub finished: bool,
    /// The epochs, those before a resumption included.
    pub epochs: Vec<EpochRecord>,
}

/// The device of these settings.
///
/// # Errors
/// It cannot be had, or not in the precision that is asked for.
pub fn open_device(config: &TrainConfig) -> Result<Device, TrainError> {
    let device = model::device::open(&config.device)?;
    config.precision.check(&config.device, &device)?;
    Ok(device)
}

/// Trains a network until its epochs are done, it no longer gets better (`validation.patience`), or it is stopped.
///
/// # Errors
///
/// A setting out of range, unusable data, a checkpoint of other settings or data, a full disk, divergence, an epoch without a
/// step that changed the weights, or an end without any finite validation loss. What was saved before stays.
pub fn train<T: Task>(task: &T, config: &TrainConfig, run: &Run) -> Result<Outcome, TrainError> {
    config.validate()?;
    let device = open_device(config)?;
    let steps_per_epoch = task.visits().div_ceil(config.batch);
    if steps_per_epoch == 0 {
        return Err(TrainError::NoData { searched: format!("{} has no training samples", task.data_name()) });
    }
    let total_steps = steps_per_epoch as u64 * u64::from(config.epochs);
    let latest = run.dir.join("latest");
    let settings = decisive_settings(config)?;
    let fresh = Schedule::new(&config.schedule, config.optimizer.learning_rate, total_steps);
    let mut learner = learner::fresh(task, config, &device)?;
    let mut state = TrainingState::fresh(settings.clone(), task.data_name(), fresh.state());
    if run.resume {
        state = resumable(task, config, run.dir)?;
        learner = checkpoint::load_into(&latest, learner)?;
    }
    checkpoint::remove_partial(run.dir);
    let mut schedule = fresh.with_state(state.schedule);
    let mut watch = Watch::open(run.dir, (state.step, state.epoch), total_steps, config.epochs, run.quiet)?;
    let mut info = Checkpoint::new::<T::Net>(task.network(), task.encode());
    info.provenance = run.provenance.clone();
    if run.resume {
        quality::take_over(&mut info, &latest, state.step);
        watch.message(state.step, format!("resumed at step {}, epoch {}", state.step, state.epoch + 1))?;
    }

    let mut finished = state.stopped || state.epoch >= config.epochs;
    if works_by_itself(&device) && !finished {
        let plan = epoch_plan(config.seed, state.epoch, task.visits(), config.batch, config.accumulation);
        // A run that was cut between its last step and its validation has no step left in its epoch.
        let step = plan.get(state.step_in_epoch).unwrap_or(&plan[0]);
        let batch = task.batch(state.epoch, &step[0])?;
        let agrees = || agreement::check(task, config, &device, &learner.net, &batch);
        if let Some(text) = attempt(config, &latest, agrees)?? {
            watch.message(state.step, text)?;
        }
    }
    while !finished {
        let began = Instant::now();
        let done_before = state.step_in_epoch;
        let trained = train_epoch(task, config, run, &device, &mut learner, &mut state, &schedule, &mut watch, &info)?;
        let Some(rate) = trained else {
            break;
        };
        if state.loss_samples == 0 {
            let kept = kept(run.dir, &state);
            return Err(TrainError::NothingLearnt { epoch: state.epoch + 1, steps: steps_per_epoch, rate, kept });
        }
        let train_seconds = began.elapsed().as_secs_f64();
        let net = learner.evaluated();
        let validation = attempt(config, &latest, || task.validate(&net, &device))??;
        schedule.observe(validation.loss);
        let regret = validation.ranking.relative_regret();
        let best = state.best.observe(if validation.loss.is_finite() { regret } else { f64::NAN }, state.epoch);
        quality::note(&mut info, state.step, &validation);
        if best {
            model::checkpoint::save(&run.dir.join("best"), &net, &info)?;
        }
        let epoch = state.epoch;
        let keep = config.checkpoint.keep_every_epochs;
        if keep > 0 && (epoch + 1).is_multiple_of(keep) {
            model::checkpoint::save(&run.dir.join(format!("epoch-{:04}", epoch + 1)), &net, &info)?;
        }
        let share = (steps_per_epoch - done_before) as f64 / steps_per_epoch as f64;
        watch.record(Record::Epoch(EpochRecord {
            step: state.step,
            epoch,
            train_loss: state.loss_sum / state.loss_samples.max(1) as f64,
            valid_loss: validation.loss,
            valid: validation.ranking,
            best,
            learning_rate: rate,
            seconds: began.elapsed().as_secs_f64(),
            samples_per_second: share * state.loss_samples as f64 / train_seconds.max(1e-9),
        }))?;
        state.stopped = state.best.exhausted(config.validation.patience);
        finished = state.stopped || epoch + 1 >= config.epochs;
        let every = config.episodes.every_epochs;
        if every > 0 && ((epoch + 1).is_multiple_of(every) || finished) {
            run_episodes(task, &net, &device, &state, &mut watch)?;
        }
        state.epoch += 1;
        (state.step_in_epoch, state.loss_sum, state.loss_samples) = (0, 0.0, 0);
        state.schedule = schedule.state();
        watch.flush_records()?;
        checkpoint::save(&latest, &learner, &info, &state)?;
        if state.stopped {
            let text = format!("no lower regret in {} epochs: stopped early", config.validation.patience);
            watch.message(state.step, text)?;
        }
    }
    if !finished {
        watch.flush_records()?;
        checkpoint::save(&latest, &learner, &quality::described(&info, state.step), &state)?;
        watch.message(state.step, format!("stopped at step {}; --resume continues from there", state.step))?;
    }
    watch.flush(true)?;
    if finished && state.schedule.best.is_none() {
        let (rate, kept) = (config.optimizer.learning_rate, kept(run.dir, &state));
        return Err(TrainError::NeverFinite { epochs: state.epoch, rate, kept });
    }
    let epochs = watch.records().iter().filter_map(|r| if let Record::Epoch(e) = r { Some(e.clone()) } else { None });
    Ok(Outcome { state, finished, epochs: epochs.collect() })
}

/// The rest of an epoch. Returns the last learning rate, or `None` where it was stopped.
fn train_epoch<T: Task>(
    task: &T,
    config: &TrainConfig,
    run: &Run,
    device: &Device,
    learner: &mut Learner<T::Net>,
    state: &mut TrainingState,
    schedule: &Schedule,
    watch: &mut Watch,
    info: &Checkpoint<<T::Net as Network>::Config>,
) -> Result<Option<f64>, TrainError> {
    let plan = epoch_plan(config.seed, state.epoch, task.visits(), config.batch, config.accumulation);
    let latest = run.dir.join("latest");
    let mut last_save = state.step;
    let mut rate = schedule.rate(state.step.saturating_sub(1), state.epoch);
    std::thread::scope(|scope| {
        let workers = worker_count(config.loader.workers);
        let mut loader =
            Loader::start(scope, task, state.epoch, &plan, state.step_in_epoch, workers, config.loader.ready);
        let save = |watch: &mut Watch, learner: &Learner<T::Net>, state: &TrainingState| {
            watch.flush_records()?;
            checkpoint::save(&latest, learner, &quality::described(info, state.step), state)
        };
        let every = config.checkpoint.every_steps;
        let most = if works_by_itself(device) { UNREAD } else { 1 };
        while state.step_in_epoch < plan.len() {
            let began = Instant::now();
            let mut group = Group::new(learner, most > 1);
            let (mut stopped, mut failed) = (false, None);
            let due = |step: u64| every > 0 && step >= last_save + every;
            while group.len() < most && state.step_in_epoch + group.len() < plan.len() {
                let step = state.step + group.len() as u64;
                if due(step) && !group.is_empty() {
                    break;
                }
                if (run.stop)(step) {
                    stopped = true;
                    break;
                }
                let asked = Instant::now();
                let parts = match loader.next_batch() {
                    Ok(parts) => parts,
                    Err(error) => {
                        failed = Some(error);
                        break;
                    }
                };
                let wait_seconds = asked.elapsed().as_secs_f64();
                for text in task.refusals() {
                    watch.message(step, text)?;
                }
                rate = schedule.rate(step, state.epoch);
                let work = Work::new::<T>(step, rate, wait_seconds, parts);
                attempt(config, &latest, || group.push(task, config, device, learner, work))?;
            }
            let done = attempt(config, &latest, || group.finish(task, config, device, learner))?;
            let seconds = began.elapsed().as_secs_f64() / done.len().max(1) as f64;
            for (work, step) in done {
                note(state, watch, &work, step, seconds, &latest)?;
            }
            // What was learnt so far is sound, whatever became of the data.
            if let Some(error) = failed {
                save(watch, learner, state)?;
                return Err(error);
            }
            if stopped {
                return Ok(None);
            }
            if due(state.step) && state.skipped_in_row == 0 {
                last_save = state.step;
                save(watch, learner, state)?;
            }
        }
        Ok(Some(rate))
    })
}

/// Runs what a GPU may fail in.
fn attempt<R>(config: &TrainConfig, latest: &Path, step: impl FnOnce() -> R) -> Result<R, TrainError> {
    // Nothing that was caught in the middle of a step is used again.
    std::panic::catch_unwind(AssertUnwindSafe(step)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| text.to_string()));
        TrainError::DeviceFailed {
            device: config.device.clone(),
            reason: text.unwrap_or_else(|| "no reason given".into()),
            accumulation: config.accumulation,
            batch: config.batch,
            checkpoint: latest.to_path_buf(),
        }
    })
}

/// Books a step.
fn note<B>(
    state: &mut TrainingState,
    watch: &mut Watch,
    work: &Work<B>,
    step: Step,
    seconds: f64,
    latest: &Path,
) -> Result<(), TrainError> {
    let (rate, samples) = (work.rate, work.samples);
    state.step += 1;
    state.step_in_epoch += 1;
    match step {
        Step::Done { loss, gradient_norm } => {
            state.skipped_in_row = 0;
            state.loss_sum += loss * samples as f64;
            state.loss_samples += samples;
            watch.record(Record::Step(StepRecord {
                step: state.step,
                epoch: state.epoch,
                loss,
                learning_rate: rate,
                gradient_norm,
                samples,
                seconds,
                wait_seconds: work.wait_seconds,
            }))
        }
        Step::Skipped(reason) => {
            state.skipped_in_row += 1;
            watch.message(state.step, format!("step {} did not change the weights: {reason}", state.step))?;
            if state.skipped_in_row < MOST_SKIPPED {
                return Ok(());
            }
            let (step, checkpoint) = (state.step, latest.to_path_buf());
            Err(TrainError::Diverged { steps: state.skipped_in_row, step, rate, checkpoint })
        }
    }
}

/// What is left of a run that comes to nothing, for its user.
fn kept(dir: &Path, state: &TrainingState) -> String {
    let (best, latest) = (dir.join("best"), dir.join("latest"));
    match state.best.value {
        Some(_) => format!("the weights of the best epoch are kept in {best:?}"),
        None if checkpoint::exists(&latest) => format!("the last saved state is kept in {latest:?}"),
        None => "nothing was saved before".into(),
    }
}

fn run_episodes<T: Task>(
    task: &T,
    net: &T::Net,
    device: &Device,
    state: &TrainingState,
    watch: &mut Watch,
) -> Result<(), TrainError> {
    let began = Instant::now();
    let Some(e) = task.episodes(net, device) else {
        return Ok(());
    };
    if e.count == 0 {
        return watch.message(
            state.step,
            "not one closed-loop episode could be run with this network: no coverage is recorded",
        );
    }
    watch.record(Record::Episodes(EpisodesRecord {
        step: state.step,
        epoch: state.epoch,
        episodes: e.count,
        coverage: e.coverage,
        views_to_90: e.views_to_90,
        seconds: began.elapsed().as_secs_f64(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_fails_is_an_error_that_names_the_settings() {
        let config = TrainConfig { device: "wgpu".into(), accumulation: 2, ..TrainConfig::default() };
        let failed =
            attempt::<()>(&config, Path::new("run/latest"), || panic!("can't allocate buffer of {} bytes", 1u64 << 31));
        let text = failed.expect_err("it panicked").to_string();
        for part in
            ["`wgpu` failed", "buffer of 2147483648 bytes", "`accumulation` (now 2)", "`batch` (now 128)", "run/latest"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert_eq!(attempt(&config, Path::new("run/latest"), || 3).expect("no panic"), 3);
    }
}
