//! Optimizer steps, and the guard against those whose loss, gradient or statistics are not finite: weights, moments,
//! average and running statistics are then what they were before.
//!
//! On the CPU a step is read before it is applied. A GPU works asynchronously, and a reading waits until
//! it has nothing left to do; there the steps of a [`Group`] are applied unread, and where one of them turns out bad, all are
//! taken back and done again one by one.

use crate::config::TrainConfig;
use crate::gradient::{self, Factor, Statistics};
use crate::learner::{Learner, Snapshot};
use crate::task::Task;
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor};
use geometry::rng::stream;
use model::precision::within;
use model::published::Network;
use rand::Rng;

/// Steps of a group on devices that work by themselves: a reading in eight steps costs nothing that could be measured.
pub const UNREAD: usize = 8;

/// A step to do: those parts of its batch that have usable samples.
pub struct Work<B> {
    /// Steps done before it, which its random draws belong to.
    pub step: u64,
    /// Learning rate.
    pub rate: f64,
    /// Seconds waited for the batch.
    pub wait_seconds: f64,
    /// Samples.
    pub samples: usize,
    /// Each with its share of the loss.
    parts: Vec<(B, f64)>,
}

impl<B> Work<B> {
    /// Of these parts.
    pub fn new<T: Task<Batch = B>>(step: u64, rate: f64, wait_seconds: f64, parts: Vec<B>) -> Self {
        let sizes: Vec<(usize, usize)> = parts.iter().map(T::size).collect();
        let samples = sizes.iter().map(|s| s.0).sum();
        let terms: usize = sizes.iter().filter(|s| s.0 > 0).map(|s| s.1).sum();
        let usable = parts.into_iter().zip(sizes).filter(|(_, (samples, _))| *samples > 0);
        let parts = usable.map(|(part, (_, part_terms))| (part, part_terms as f64 / terms as f64)).collect();
        Self { step, rate, wait_seconds, samples, parts }
    }
}

/// What a step came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// The weights moved.
    Done {
        /// Loss of the batch.
        loss: f64,
        /// L2 norm of the gradient before clipping.
        gradient_norm: f64,
    },
    /// Nothing changed, for this reason.
    Skipped(String),
}

/// Steps that are read together.
pub struct Group<N, B> {
    /// What to go back to; absent where every step is read by itself.
    before: Option<Snapshot<N>>,
    steps: Vec<(Work<B>, State)>,
}

#[allow(clippy::large_enum_variant, reason = "a few at a time")]
enum State {
    Read(Step),
    /// Loss, gradient norm and sum of the statistics, [3].
    Unread(Tensor<1>),
}

impl<N: Network, B> Group<N, B> {
    /// Without steps yet. `unread`: see the head of this file.
    pub fn new(learner: &Learner<N>, unread: bool) -> Self {
        Self { before: unread.then(|| learner.snapshot()), steps: Vec::new() }
    }

    /// Steps in it.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Does a step.
    pub fn push<T>(&mut self, task: &T, config: &TrainConfig, device: &Device, learner: &mut Learner<N>, work: Work<B>)
    where
        T: Task<Net = N, Batch = B>,
    {
        let state = match self.before {
            Some(_) if work.samples > 0 => State::Unread(unread_step(task, config, device, learner, &work)),
            _ => State::Read(read_step(task, config, device, learner, &work)),
        };
        self.steps.push((work, state));
    }

    /// Reads what is unread. Afterwards every step stands, or is as if it had not been.
    pub fn finish<T>(
        self,
        task: &T,
        config: &TrainConfig,
        device: &Device,
        learner: &mut Learner<N>,
    ) -> Vec<(Work<B>, Step)>
    where
        T: Task<Net = N, Batch = B>,
    {
        let unread = |state: &State| if let State::Unread(report) = state { Some(report.clone()) } else { None };
        let reports: Vec<Tensor<1>> = self.steps.iter().filter_map(|(_, state)| unread(state)).collect();
        let values: Vec<f64> = match reports.is_empty() {
            true => Vec::new(),
            false => Tensor::cat(reports, 0).into_data().iter::<f64>().collect(), // The one reading.
        };
        if let Some(before) = self.before.filter(|_| !values.iter().all(|x| x.is_finite())) {
            *learner = before.restore();
            let again = self.steps.into_iter().map(|(work, _)| {
                let step = read_step(task, config, device, learner, &work);
                (work, step)
            });
            return again.collect();
        }
        let mut values = values.chunks_exact(3);
        let read = self.steps.into_iter().map(|(work, state)| match (state, &mut values) {
            (State::Read(step), _) => (work, step),
            (State::Unread(_), values) => {
                let of_step = values.next().unwrap_or(&[f64::NAN; 3]);
                (work, Step::Done { loss: of_step[0], gradient_norm: of_step[1] })
            }
        });
        read.collect()
    }
}

/// A step that is read before it is applied.
fn read_step<T: Task>(
    task: &T,
    config: &TrainConfig,
    device: &Device,
    learner: &mut Learner<T::Net>,
    work: &Work<T::Batch>,
) -> Step {
    if work.samples == 0 {
        return Step::Skipped("none of its samples can be used".into());
    }
    let statistics = Statistics::of(&learner.net);
    let mut loss = 0.0;
    let mut gradients = differentiate(task, config, device, &learner.net, work, |part| {
        let value = f64::from(part.clone().into_scalar::<f32>());
        loss += value;
        value.is_finite()
    });
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
        gradient::scale(&learner.net, &mut gradients, Factor::Number(limit / gradient_norm));
    }
    apply(config, learner, work.rate, gradients);
    Step::Done { loss, gradient_norm }
}

/// A step that nothing is read of: loss, gradient norm and sum of the statistics, [3], still on the device.
fn unread_step<T: Task>(
    task: &T,
    config: &TrainConfig,
    device: &Device,
    learner: &mut Learner<T::Net>,
    work: &Work<T::Batch>,
) -> Tensor<1> {
    let mut losses = Vec::with_capacity(work.parts.len());
    let mut gradients = differentiate(task, config, device, &learner.net, work, |part| {
        losses.push(part.clone().without_autodiff());
        true
    });
    let loss = Tensor::cat(losses, 0).sum(); // [1]
    let zero = || Tensor::zeros([1], &device.clone().inner());
    let norm = gradient::squares(&learner.net, &gradients).map_or_else(zero, |squares| squares.sum().sqrt()); // [1]
    let statistics = Statistics::of(&learner.net).sums().map_or_else(zero, Tensor::sum); // [1]
    let limit = config.optimizer.clip_norm;
    if limit > 0.0 {
        let factor = (norm.clone().recip() * limit).clamp_max(1.0); // [1]
        gradient::scale(&learner.net, &mut gradients, Factor::OnDevice(factor));
    }
    apply(config, learner, work.rate, gradients);
    Tensor::cat(vec![loss, norm, statistics], 0)
}

/// Gradients of the whole batch; ends early, with part of them, where `go_on` says so of a part's loss, [1].
fn differentiate<T: Task>(
    task: &T,
    config: &TrainConfig,
    device: &Device,
    net: &T::Net,
    work: &Work<T::Batch>,
    mut go_on: impl FnMut(&Tensor<1>) -> bool,
) -> GradientsParams {
    // In place of a saved generator: what dropout draws depends on seed and step alone.
    device.seed(stream(config.seed, &format!("train/step/{}", work.step)).next_u64());
    let only = work.parts.len() == 1;
    let mut accumulator = GradientsAccumulator::new();
    let mut gradients = GradientsParams::new();
    for (part, share) in &work.parts {
        let loss = within(config.precision, || task.loss(net, part, device)) * *share; // [1]
        if !go_on(&loss) {
            break;
        }
        let of_part = GradientsParams::from_grads(loss.backward(), net);
        if only {
            gradients = of_part;
        } else {
            accumulator.accumulate(net, of_part);
        }
    }
    if only { gradients } else { accumulator.grads() }
}

fn apply<N: Network>(config: &TrainConfig, learner: &mut Learner<N>, rate: f64, gradients: GradientsParams) {
    learner.net = learner.optimizer.step(rate, learner.net.clone(), gradients);
    if let Some(average) = learner.average.take() {
        learner.average = Some(gradient::average(average, &learner.net, config.optimizer.average_decay));
    }
}
