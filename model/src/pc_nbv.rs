//! PC-NBV (Zeng et al., IROS 2020), the network of its PyTorch re-implementation: which of 33 fixed views adds most
//! surface.

use crate::blocks::{self, LinearBn};
use crate::config::SizeError;
use crate::nearest::nearest_in_feature_space;
use crate::published::Network;
use burn::module::{Initializer, Module, Param, RunningState};
use burn::nn::{BatchNorm, Linear};
use burn::tensor::activation::{relu, softmax};
use burn::tensor::{Device, Distribution, Tensor};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Number of fixed views.
pub const VIEWS: usize = 33;
/// Fewest points that the network takes: 16 neighbours and the point itself.
pub const MIN_POINTS: usize = NEIGHBORS + 1;
const NEIGHBORS: usize = 16;
/// Channels of the dense edge blocks' input.
const FEATURE: usize = 24;
/// Channels that each layer of a dense edge block adds.
const GROWTH: usize = 12;
/// Channels after a dense edge block.
const EDGE: usize = FEATURE + 3 * GROWTH;
/// Channels of the extracted features.
const EXTRACTED: usize = FEATURE + 4 * EDGE;
/// Channels of the attention unit: features, global feature, state.
const UNIT: usize = 2 * EXTRACTED + VIEWS;

/// Unit vectors from the origin to the 33 cameras, y up, in the order of the published list.
pub fn view_directions() -> [Vector3<f64>; VIEWS] {
    let mut views = [Vector3::y(); VIEWS];
    let elevations = [-60.0f64, -30.0, 0.0, 30.0];
    for (ring, a) in elevations.into_iter().enumerate() {
        for step in 0..8 {
            let (a, beta) = (a.to_radians(), (45.0 * f64::from(step as u8)).to_radians());
            views[1 + 8 * ring + step] = Vector3::new(beta.sin() * a.cos(), -a.sin(), beta.cos() * a.cos());
        }
    }
    views
}

/// Settings of [`PcNbvNet`]; its sizes are those of the publication.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcNbvNetConfig {
    /// Points of a training sample (512 published).
    pub points: usize,
    /// Share of the surface that one unit of the last layer's output stands for (1 published). Gains are a few percent: a
    /// unit of that size lets a short training spend its steps on their order rather than on shrinking the output.
    pub gain_unit: f64,
}

impl Default for PcNbvNetConfig {
    fn default() -> Self {
        Self { points: 512, gain_unit: 1.0 }
    }
}

impl PcNbvNetConfig {
    /// A network with fresh weights: 3,838,286 parameters.
    pub fn init(&self, device: &Device) -> PcNbvNet {
        let linear = |i, o| blocks::linear(i, o, device);
        let linear_bn = |i, o| (linear(i, o), blocks::batch_norm_layer(o, device));
        let block = || EdgeBlock {
            conv1: linear(2 * FEATURE, GROWTH),
            conv2: linear(GROWTH + FEATURE, GROWTH),
            conv3: linear(2 * GROWTH + FEATURE, GROWTH),
        };
        PcNbvNet {
            extractor: Extractor {
                lift: linear(3, FEATURE),
                reduce: (1..4).map(|i| linear(FEATURE + i * EDGE, FEATURE)).collect(),
                blocks: (0..4).map(|_| block()).collect(),
            },
            feature_norm: blocks::batch_norm_layer(EXTRACTED, device),
            attention: QueryAttention {
                query: SpectralLinear::new(UNIT, UNIT / 4, device),
                key: SpectralLinear::new(UNIT, UNIT / 4, device),
                value: SpectralLinear::new(UNIT, UNIT, device),
                scale: Initializer::Zeros.init([1], device),
            },
            attention_norm: blocks::batch_norm_layer(UNIT, device),
            encoder: (linear_bn(UNIT, 1024), linear_bn(1024, 1024)),
            head: (linear_bn(1024, 1024), linear_bn(1024, 512), linear_bn(512, 256)),
            output: linear(256, VIEWS),
            gain_unit: self.gain_unit,
        }
    }
}

/// The network.
#[derive(Module, Debug)]
pub struct PcNbvNet {
    extractor: Extractor,
    feature_norm: BatchNorm,
    attention: QueryAttention,
    attention_norm: BatchNorm,
    encoder: (LinearBn, LinearBn),
    head: (LinearBn, LinearBn, LinearBn),
    output: Linear,
    gain_unit: f64,
}

impl PcNbvNet {
    /// Points [B, N, 3], each cloud normalised by [`normalise`], N at least [`MIN_POINTS`], and states [B, 33] (1 for
    /// used views) -> expected gain of each view as a share of the surface, [B, 33]. Trains (batch statistics) where
    /// the weights are on an autodiff device.
    pub fn forward(&self, points: Tensor<3>, state: Tensor<2>) -> Tensor<2> {
        let [b, n, _] = points.dims();
        assert!(n >= MIN_POINTS, "{n} points, expected at least {MIN_POINTS}");
        let features = self.extractor.forward(points); // [B*N, 264]
        let x = blocks::batch_norm(&self.feature_norm, features); // [B*N, 264]
        let global = x.clone().reshape([b, n, EXTRACTED]).max_dim(1); // [B, 1, 264]
        let everywhere = |t: Tensor<3>, c| t.expand([b, n, c]).reshape([b * n, c]);
        let z = Tensor::cat(vec![x, everywhere(global, EXTRACTED), everywhere(state.reshape([b, 1, VIEWS]), VIEWS)], 1); // [B*N, 561]
        let z = self.attention.forward(relu(z).reshape([b, n, UNIT])); // [B, N, 561]
        let z = blocks::batch_norm(&self.attention_norm, z.reshape([b * n, UNIT])); // [B*N, 561]
        let z = blocks::linear_bn_relu(&self.encoder.0, z); // [B*N, 1024]
        let z = blocks::batch_norm(&self.encoder.1.1, self.encoder.1.0.forward(z)); // [B*N, 1024]
        let [_, code] = z.dims();
        let z = z.reshape([b, n, code]).max_dim(1).reshape([b, code]); // [B, 1024]
        let z = blocks::linear_bn_relu(&self.head.0, z);
        let z = blocks::linear_bn_relu(&self.head.1, z);
        self.output.forward(blocks::linear_bn_relu(&self.head.2, z)) * self.gain_unit // [B, 33]
    }
}

impl Network for PcNbvNet {
    type Config = PcNbvNetConfig;
    const KIND: &'static str = "pc-nbv";

    fn create(config: &PcNbvNetConfig, device: &Device) -> Result<Self, SizeError> {
        if config.points < MIN_POINTS {
            return Err(SizeError::value("points", config.points, format!("at least {MIN_POINTS}")));
        }
        if !(config.gain_unit > 0.0 && config.gain_unit.is_finite()) {
            return Err(SizeError::value("gain_unit", config.gain_unit, "a positive number"));
        }
        Ok(config.init(device))
    }

    /// Its layers have fixed sizes.
    fn least_weights(_: &PcNbvNetConfig) -> f64 {
        0.0
    }

    fn is_conv(_: &str) -> bool {
        false
    }
}

/// Sum over batch and views of (prediction - target)^2, targets [B, 33] (PC-NBV's loss; weight decay is the
/// optimizer's).
pub fn gain_loss(prediction: Tensor<2>, target: Tensor<2>) -> Tensor<1> {
    let difference = prediction - target;
    (difference.clone() * difference).sum()
}

/// Moves the centroid to the origin and the farthest point to distance 1. A cloud without extent is only centred.
pub fn normalise(points: &[nalgebra::Point3<f64>]) -> Vec<[f32; 3]> {
    let count = points.len().max(1) as f64;
    let centroid = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / count;
    let largest = points.iter().map(|p| (p.coords - centroid).norm()).fold(0.0, f64::max);
    let scale = if largest > 0.0 { 1.0 / largest } else { 1.0 };
    points.iter().map(|p| (p.coords - centroid) * scale).map(|v| [v.x as f32, v.y as f32, v.z as f32]).collect()
}

#[derive(Module, Debug)]
struct Extractor {
    lift: Linear,
    reduce: Vec<Linear>,
    blocks: Vec<EdgeBlock>,
}

impl Extractor {
    /// [B, N, 3] -> [B*N, 264].
    fn forward(&self, points: Tensor<3>) -> Tensor<2> {
        let [b, n, _] = points.dims();
        let lifted = self.lift.forward(points.reshape([b * n, 3])); // [B*N, 24]
        let mut all = Tensor::cat(vec![self.blocks[0].forward(lifted.clone(), b, n), lifted], 1); // [B*N, 84]
        for (reduce, block) in self.reduce.iter().zip(&self.blocks[1..]) {
            let x = relu(reduce.forward(all.clone())); // [B*N, 24]
            all = Tensor::cat(vec![block.forward(x, b, n), all], 1); // + 60
        }
        all
    }
}

/// Dense edge block: three layers on [x_i, x_j - x_i] over the 16 neighbours j in feature space, each fed with all
/// before it, then the maximum over neighbours.
#[derive(Module, Debug)]
struct EdgeBlock {
    conv1: Linear,
    conv2: Linear,
    conv3: Linear,
}

impl EdgeBlock {
    /// [B*N, 24] -> [B*N, 60]. What depends on x_i or x_j alone is computed per point, not per edge.
    fn forward(&self, x: Tensor<2>, b: usize, n: usize) -> Tensor<2> {
        let rows = b * n;
        let neighbors = nearest_in_feature_space(&x, b, n, NEIGHBORS); // [B*N*16]
        let part = |linear: &Linear, from: usize, to: usize| linear.weight.val().narrow(0, from, to - from);
        let bias = |linear: &Linear| match &linear.bias {
            Some(bias) => bias.val().unsqueeze::<2>(),
            None => Tensor::zeros([1, GROWTH], &x.device()),
        };
        let spread = |t: Tensor<2>| {
            t.reshape([rows, 1, GROWTH]).expand([rows, NEIGHBORS, GROWTH]).reshape([rows * NEIGHBORS, GROWTH])
        };
        // conv1 [x_i, x_j - x_i] = x_i (W_a - W_b) + x_j W_b.
        let (wa, wb) = (part(&self.conv1, 0, FEATURE), part(&self.conv1, FEATURE, 2 * FEATURE));
        let other = x.clone().matmul(wb.clone()).select(0, neighbors); // [B*N*16, 12]
        let own = x.clone().matmul(wa - wb) + bias(&self.conv1); // [B*N, 12]
        let y1 = relu(spread(own) + other); // [B*N*16, 12]
        // conv2 [y1, x_i].
        let own = x.clone().matmul(part(&self.conv2, GROWTH, GROWTH + FEATURE)) + bias(&self.conv2);
        let y2 = relu(y1.clone().matmul(part(&self.conv2, 0, GROWTH)) + spread(own));
        // conv3 [y2, y1, x_i].
        let own = x.clone().matmul(part(&self.conv3, 2 * GROWTH, 2 * GROWTH + FEATURE)) + bias(&self.conv3);
        let below = Tensor::cat(vec![y2.clone(), y1.clone()], 1).matmul(part(&self.conv3, 0, 2 * GROWTH));
        let y3 = below + spread(own);
        let edges = Tensor::cat(vec![y3, y2, y1], 1).reshape([rows, NEIGHBORS, 3 * GROWTH]);
        Tensor::cat(vec![edges.max_dim(1).reshape([rows, 3 * GROWTH]), x], 1)
    }
}

/// Linear layer whose weight is divided by its largest singular value, estimated by one step of power iteration per
/// forward pass. Training keeps the estimate; evaluation takes the step and forgets it, so that the same input
/// gives the same output.
#[derive(Module, Debug)]
struct SpectralLinear {
    /// [in, out].
    weight: Param<Tensor<2>>,
    bias: Param<Tensor<1>>,
    /// Left singular vector of PyTorch's weight [out, in], [out].
    weight_u: RunningState<Tensor<1>>,
}

impl SpectralLinear {
    fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        let kaiming = Initializer::KaimingUniform { gain: std::f64::consts::SQRT_2, fan_out_only: false };
        let u = Tensor::random([outputs], Distribution::Normal(0.0, 1.0), &device.clone().inner());
        Self {
            weight: kaiming.init_with([inputs, outputs], Some(inputs), Some(outputs), device),
            bias: Initializer::Zeros.init([outputs], device),
            weight_u: RunningState::new(unit(u)),
        }
    }

    /// [R, in] -> [R, out].
    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let weight = self.weight.val();
        let plain = weight.clone().detach();
        let u = self.weight_u.value_sync().to_device(&plain.device().inner());
        let [inputs, outputs] = plain.dims();
        let v = unit(plain.clone().matmul(u.reshape([outputs, 1])).reshape([inputs])); // [in]
        let u = unit(plain.transpose().matmul(v.clone().reshape([inputs, 1])).reshape([outputs])); // [out]
        if x.device().is_autodiff() {
            self.weight_u.update(u.clone().detach().without_autodiff());
            self.weight_u.value_sync();
        }
        let sigma = v.reshape([1, inputs]).matmul(weight.clone()).matmul(u.reshape([outputs, 1])); // [1, 1]
        x.matmul(weight / sigma) + self.bias.val().unsqueeze::<2>()
    }
}

/// Unit vector; a zero vector stays.
fn unit(v: Tensor<1>) -> Tensor<1> {
    let norm = (v.clone() * v.clone()).sum().sqrt().clamp_min(1e-12);
    v / norm
}

/// Self-attention over points with the softmax over queries, scaled by a learned factor (gamma in the publication) that starts at 0.
#[derive(Module, Debug)]
struct QueryAttention {
    query: SpectralLinear,
    key: SpectralLinear,
    value: SpectralLinear,
    scale: Param<Tensor<1>>,
}

impl QueryAttention {
    /// [B, N, 561] -> [B, N, 561]: out_j = scale sum_i value_i A_ij + z_j, where each column of A sums to 1.
    fn forward(&self, z: Tensor<3>) -> Tensor<3> {
        let [b, n, c] = z.dims();
        let rows = z.clone().reshape([b * n, c]);
        let query = self.query.forward(rows.clone()).reshape([b, n, c / 4]);
        let key = self.key.forward(rows.clone()).reshape([b, n, c / 4]);
        let value = self.value.forward(rows).reshape([b, n, c]);
        let attention = softmax(key.matmul(query.swap_dims(1, 2)), 2); // [B, N key, N query]
        let out = attention.matmul(value); // [B, N, 561]
        z + out * self.scale.val().reshape([1, 1, 1])
    }
}
