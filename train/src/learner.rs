//! What changes while training: weights, their moving average, the optimizer's moments.

use crate::TrainError;
use crate::config::{OptimizerKind, TrainConfig};
use crate::gradient::Statistics;
use crate::task::Task;
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::decay::WeightDecayConfig;
use burn::optim::{AdamConfig, ModuleOptimizer};
use burn::tensor::{Device, Tensor};
use geometry::rng::stream;
use model::published::Network;
use rand::Rng;

/// A network that learns.
pub struct Learner<N> {
    /// The network in training mode.
    pub net: N,
    /// Its moving average, in evaluation mode.
    pub average: Option<N>,
    /// The optimizer with its moments.
    pub optimizer: ModuleOptimizer,
}

impl<N: Network> Learner<N> {
    /// The weights that count: the average where there is one, in evaluation mode.
    pub fn evaluated(&self) -> N {
        self.average.clone().unwrap_or_else(|| self.net.valid())
    }

    /// All of it as it is now, by reference: tensors are never written to.
    pub fn snapshot(&self) -> Snapshot<N> {
        // Clones of a network share the cells of their running statistics.
        Snapshot {
            net: self.net.clone(),
            statistics: Statistics::of(&self.net),
            average: self.average.as_ref().map(|average| (average.clone(), Statistics::of(average))),
            optimizer: self.optimizer.clone(),
        }
    }
}

/// A [`Learner`] at an earlier moment.
pub struct Snapshot<N> {
    net: N,
    statistics: Statistics,
    average: Option<(N, Statistics)>,
    optimizer: ModuleOptimizer,
}

impl<N: Network> Snapshot<N> {
    /// The learner as it was.
    pub fn restore(self) -> Learner<N> {
        Learner {
            net: self.statistics.restore(self.net),
            average: self.average.map(|(average, statistics)| statistics.restore(average)),
            optimizer: self.optimizer,
        }
    }
}

/// The learner of a new run. Initial weights belong to the seed, whatever the device: they are drawn on the CPU.
///
/// # Errors
/// Impossible sizes of the network.
pub fn fresh<T: Task>(task: &T, config: &TrainConfig, device: &Device) -> Result<Learner<T::Net>, TrainError> {
    let cpu = Device::flex();
    cpu.seed(stream(config.seed, "train/weights").next_u64());
    let net = T::Net::create(&task.network(), &cpu)
        .map_err(|e| TrainError::setting("network", "sizes as given", e.to_string()))?;
    draw_weights(&net);
    let net = net.to_device(device);
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
        OptimizerKind::Adamw => model::AdamW::new([beta_1, beta_2], epsilon, o.weight_decay as f32).init(),
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
