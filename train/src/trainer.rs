//! The training loop: ours, on burn's optimizers, because resumption has to be exact at any step.

use crate::TrainError;
use crate::checkpoint::{self, Learner, TrainingState};
use crate::config::{OptimizerKind, TrainConfig};
use crate::gradient::{self, Statistics};
use crate::loader::{Loader, epoch_plan, worker_count};
use crate::origin::{decisive_settings, resumable};
use crate::schedule::Schedule;
use crate::task::Task;
use crate::watch::{EpisodesRecord, EpochRecord, Record, StepRecord, Watch};
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::decay::WeightDecayConfig;
use burn::optim::{AdamConfig, AdamWConfig, GradientsAccumulator, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor};
use geometry::rng::stream;
use model::checkpoint::Checkpoint;
use model::published::Network;
use rand::Rng;
use std::collections::BTreeMap;
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

/// Trains a network until its epochs are done, it no longer gets better (`validation.patience`), or it is stopped.
///
/// # Errors
///
/// A setting out of range, unusable data, a checkpoint of other settings or data, a full disk, or divergence. What
/// was saved before stays.
pub fn train<T: Task>(task: &T, config: &TrainConfig, run: &Run) -> Result<Outcome, TrainError> {
    config.validate()?;
    let device = model::device::open(&config.device)?;
    let steps_per_epoch = task.visits().div_ceil(config.batch);
    if steps_per_epoch == 0 {
        return Err(TrainError::NoData { searched: format!("{} has no training samples", task.data_name()) });
    }
    let total_steps = steps_per_epoch as u64 * u64::from(config.epochs);
    let latest = run.dir.join("latest");
    let settings = decisive_settings(config)?;
    let fresh = Schedule::new(&config.schedule, config.optimizer.learning_rate, total_steps);
    let mut learner = fresh_learner::<T>(task, config, &device)?;
    let mut state = TrainingState::fresh(settings.clone(), task.data_name(), fresh.state());
    if run.resume {
        state = resumable(task, config, run.dir)?;
        learner = checkpoint::load_into(&latest, learner)?;
    }
    checkpoint::remove_partial(run.dir);
    let mut schedule = fresh.with_state(state.schedule);
    let mut watch = Watch::open(run.dir, state.step, total_steps, config.epochs, run.quiet)?;
    let mut info = Checkpoint::new::<T::Net>(task.network(), task.encode());
    info.provenance = run.provenance.clone();
    if run.resume {
        watch.message(state.step, format!("resumed at step {}, epoch {}", state.step, state.epoch + 1))?;
    }

    let mut finished = state.stopped || state.epoch >= config.epochs;
    while !finished {
        let began = Instant::now();
        let done_before = state.step_in_epoch;
        let trained = train_epoch(task, config, run, &device, &mut learner, &mut state, &schedule, &mut watch, &info)?;
        let Some(rate) = trained else {
            break;
        };
        let train_seconds = began.elapsed().as_secs_f64();
        let net = learner.evaluated();
        let validation = task.validate(&net, &device)?;
        schedule.observe(validation.loss);
        let regret = validation.ranking.relative_regret();
        let best = state.best.observe(if validation.loss.is_finite() { regret } else { f64::NAN }, state.epoch);
        info.step = state.step;
        if best {
            note_quality(&mut info, &validation);
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
        checkpoint::save(&latest, &learner, &info, &state)?;
        if state.stopped {
            let text = format!("no lower regret in {} epochs: stopped early", config.validation.patience);
            watch.message(state.step, text)?;
        }
    }
    if !finished {
        info.step = state.step;
        checkpoint::save(&latest, &learner, &info, &state)?;
        watch.message(state.step, format!("stopped at step {}; --resume continues from there", state.step))?;
    }
    watch.flush(true)?;
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
        while state.step_in_epoch < plan.len() {
            if (run.stop)(state.step) {
                return Ok(None);
            }
            let began = Instant::now();
            let parts = match loader.next_batch() {
                Ok(parts) => parts,
                // What was learnt so far is sound, whatever became of the data.
                Err(error) => {
                    checkpoint::save(&latest, learner, &Checkpoint { step: state.step, ..info.clone() }, state)?;
                    return Err(error);
                }
            };
            let wait_seconds = began.elapsed().as_secs_f64();
            for text in task.refusals() {
                watch.message(state.step, text)?;
            }
            rate = schedule.rate(state.step, state.epoch);
            let step = train_step(task, config, device, learner, state.step, rate, parts);
            state.step += 1;
            state.step_in_epoch += 1;
            match step {
                Step::Done { loss, gradient_norm, samples } => {
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
                        seconds: began.elapsed().as_secs_f64(),
                        wait_seconds,
                    }))?;
                }
                Step::Skipped(reason) => {
                    state.skipped_in_row += 1;
                    watch.message(state.step, format!("step {} left the weights as they are: {reason}", state.step))?;
                    if state.skipped_in_row >= MOST_SKIPPED {
                        let (step, checkpoint) = (state.step, latest.clone());
                        return Err(TrainError::Diverged { steps: state.skipped_in_row, step, rate, checkpoint });
                    }
                }
            }
            let every = config.checkpoint.every_steps;
            if every > 0 && state.step >= last_save + every && state.skipped_in_row == 0 {
                last_save = state.step;
                let info = Checkpoint { step: state.step, ..info.clone() };
                checkpoint::save(&latest, learner, &info, state)?;
            }
        }
        Ok(Some(rate))
    })
}

enum Step {
    Done { loss: f64, gradient_norm: f64, samples: usize },
    Skipped(String),
}

/// One optimizer step on the parts of a batch. Weights, moments and running statistics stay as they were where loss
/// or gradient is not finite, or no sample could be used.
fn train_step<T: Task>(
    task: &T,
    config: &TrainConfig,
    device: &Device,
    learner: &mut Learner<T::Net>,
    step: u64,
    rate: f64,
    parts: Vec<T::Batch>,
) -> Step {
    let parts: Vec<(T::Batch, usize, usize)> = parts
        .into_iter()
        .map(|part| {
            let (samples, terms) = T::size(&part);
            (part, samples, terms)
        })
        .filter(|&(_, samples, _)| samples > 0)
        .collect();
    let samples = parts.iter().map(|p| p.1).sum();
    let terms: usize = parts.iter().map(|p| p.2).sum();
    if samples == 0 {
        return Step::Skipped("none of its samples can be used".into());
    }
    let statistics = Statistics::of(&learner.net);
    // In place of a saved generator: what dropout draws depends on seed and step alone.
    device.seed(stream(config.seed, &format!("train/step/{step}")).next_u64());
    let only = parts.len() == 1;
    let mut accumulator = GradientsAccumulator::new();
    let mut loss = 0.0;
    let mut gradients = GradientsParams::new();
    for (part, _, part_terms) in parts {
        let share = part_terms as f64 / terms as f64;
        let part_loss = task.loss(&learner.net, part, device) * share; // [1]
        let value: f64 = part_loss.clone().into_scalar::<f32>().into();
        loss += value;
        if !value.is_finite() {
            break;
        }
        let of_part = GradientsParams::from_grads(part_loss.backward(), &learner.net);
        if only {
            gradients = of_part;
        } else {
            accumulator.accumulate(&learner.net, of_part);
        }
    }
    if !only {
        gradients = accumulator.grads();
    }
    let gradient_norm = if loss.is_finite() { gradient::norm(&learner.net, &gradients) } else { f64::NAN };
    // A batch's statistics can overflow where its loss does not.
    let statistics_hold = Statistics::of(&learner.net).are_finite();
    if !gradient_norm.is_finite() || !statistics_hold {
        learner.net = statistics.restore(learner.net.clone());
        let overflow = if statistics_hold { "" } else { ", its statistics overflow" };
        return Step::Skipped(format!("loss {loss}, gradient norm {gradient_norm}{overflow}"));
    }
    let limit = config.optimizer.clip_norm;
    if limit > 0.0 && gradient_norm > limit {
        gradient::scale(&learner.net, &mut gradients, limit / gradient_norm);
    }
    learner.net = learner.optimizer.step(rate, learner.net.clone(), gradients);
    if let Some(average) = learner.average.take() {
        learner.average = Some(gradient::average(average, &learner.net, config.optimizer.average_decay));
    }
    Step::Done { loss, gradient_norm, samples }
}

fn fresh_learner<T: Task>(task: &T, config: &TrainConfig, device: &Device) -> Result<Learner<T::Net>, TrainError> {
    device.seed(stream(config.seed, "train/weights").next_u64());
    let net = T::Net::create(&task.network(), device)
        .map_err(|e| TrainError::setting("network", "sizes as given", e.to_string()))?;
    draw_weights(&net);
    let average = (config.optimizer.average_decay > 0.0).then(|| net.valid());
    Ok(Learner { net: net.train(), average, optimizer: optimizer(config) })
}

/// Draws the initial weights, which burn does at first use, before anything else draws from the generator.
fn draw_weights<M: Module>(net: &M) {
    struct Touch;
    impl ModuleVisitor for Touch {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            param.val();
        }
    }
    net.visit(&mut Touch);
}

fn optimizer(config: &TrainConfig) -> ModuleOptimizer {
    let o = &config.optimizer;
    let (beta_1, beta_2, epsilon) = (o.beta_1 as f32, o.beta_2 as f32, o.epsilon as f32);
    match o.kind {
        OptimizerKind::Adamw => AdamWConfig::new()
            .with_beta_1(beta_1)
            .with_beta_2(beta_2)
            .with_epsilon(epsilon)
            .with_weight_decay(o.weight_decay as f32)
            .init(),
        OptimizerKind::Adam => {
            let decay = (o.weight_decay > 0.0).then(|| WeightDecayConfig::new(o.weight_decay as f32));
            AdamConfig::new()
                .with_beta_1(beta_1)
                .with_beta_2(beta_2)
                .with_epsilon(epsilon)
                .with_weight_decay(decay)
                .init()
        }
    }
}

fn note_quality<C>(info: &mut Checkpoint<C>, validation: &crate::task::Validation) {
    let r = &validation.ranking;
    for (key, value) in [
        ("validation_loss", validation.loss),
        ("validation_relative_regret", r.relative_regret()),
        ("validation_rank_correlation", r.rank_correlation),
        ("validation_hit_rate", r.hit_rate),
    ] {
        info.provenance.insert(key.into(), format!("{value:.4}"));
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
    watch.record(Record::Episodes(EpisodesRecord {
        step: state.step,
        epoch: state.epoch,
        episodes: e.count,
        coverage: e.coverage,
        views_to_90: e.views_to_90,
        seconds: began.elapsed().as_secs_f64(),
    }))
}
