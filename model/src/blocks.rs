//! Parts that the networks share.

use burn::module::{Initializer, Module, Param};
use burn::nn::{BatchNorm, BatchNormConfig, LayerNorm, LayerNormConfig, Linear, LinearConfig, Relu};
use burn::tensor::activation::{relu, softmax};
use burn::tensor::{Bool, Device, Tensor};

/// Linear layer and batch norm, fields named `0` and `1` as in PyTorch's `Sequential`.
pub type LinearBn = (Linear, BatchNorm);
/// Linear layer and layer norm.
pub type LinearLn = (Linear, LayerNorm);

/// Linear layer with PyTorch's initialisation (uniform in +-1/sqrt(inputs)).
pub fn linear(inputs: usize, outputs: usize, device: &Device) -> Linear {
    LinearConfig::new(inputs, outputs).init(device)
}

/// Batch norm over channels, eps 1e-5, momentum 0.1.
pub fn batch_norm_layer(channels: usize, device: &Device) -> BatchNorm {
    BatchNormConfig::new(channels).init(device)
}

/// Layer norm over channels, eps 1e-5.
pub fn layer_norm(channels: usize, device: &Device) -> LayerNorm {
    LayerNormConfig::new(channels).init(device)
}

/// Applies a batch norm to rows [R, C]. Trains (batch statistics, running statistics updated) on an autodiff
/// device with the layer's flag on, as burn's own forward does, but keeps PyTorch's unbiased running variance,
/// and makes the new statistics visible at once to whoever saves the network.
pub fn batch_norm(bn: &BatchNorm, rows: Tensor<2>) -> Tensor<2> {
    if !(rows.device().is_autodiff() && bn.training.is_enabled()) {
        return bn.forward(rows);
    }
    let [count, _] = rows.dims();
    let out = burn::tensor::module::batch_norm_train(rows, bn.gamma.val(), bn.beta.val(), bn.epsilon);
    update_statistics(bn, out.mean.detach(), out.variance.detach(), count);
    out.output
}

/// Moves the running statistics towards those of a batch of `count` rows; `variance` is the biased one.
pub fn update_statistics(bn: &BatchNorm, mean: Tensor<1>, variance: Tensor<1>, count: usize) {
    // PyTorch divides by count - 1; a single row has no spread, and its variance stays 0.
    let unbiased = if count > 1 { count as f64 / (count - 1) as f64 } else { 1.0 };
    let keep = 1.0 - bn.momentum;
    let old_mean = bn.running_mean.value_sync();
    let (mean, variance) = (mean.to_device(&old_mean.device()), variance.to_device(&old_mean.device()));
    bn.running_mean.update((old_mean * keep + mean * bn.momentum).detach());
    bn.running_var.update((bn.running_var.value_sync() * keep + variance * (bn.momentum * unbiased)).detach());
    // An update is parked per thread until the next reading; without this a saved network would miss it.
    bn.running_mean.value_sync();
    bn.running_var.value_sync();
}

/// Linear, batch norm, ReLU on rows [R, C].
pub fn linear_bn_relu(layer: &LinearBn, rows: Tensor<2>) -> Tensor<2> {
    relu(batch_norm(&layer.1, layer.0.forward(rows)))
}

/// Linear, layer norm, ReLU.
pub fn linear_ln_relu<const D: usize>(linear: &Linear, norm: &LayerNorm, x: Tensor<D>) -> Tensor<D> {
    relu(norm.forward(linear.forward(x)))
}

/// Shared MLP over points: a linear layer (PyTorch: `Conv1d` of kernel 1), batch norm and ReLU per width.
pub fn shared_mlp(inputs: usize, widths: &[usize], device: &Device) -> Vec<LinearBn> {
    let mut inputs = inputs;
    widths
        .iter()
        .map(|&width| {
            let layer = (linear(inputs, width, device), batch_norm_layer(width, device));
            inputs = width;
            layer
        })
        .collect()
}

/// The shared MLP and the maximum over points, in plain layers: [B, N, C] -> [B, widths.last()].
pub fn shared_mlp_max(layers: &[LinearBn], points: Tensor<3>) -> Tensor<2> {
    let [b, n, c] = points.dims();
    let rows = points.reshape([b * n, c]); // [B*N, C]
    let rows = layers.iter().fold(rows, |rows, layer| linear_bn_relu(layer, rows)); // [B*N, width]
    let [_, width] = rows.dims();
    rows.reshape([b, n, width]).max_dim(1).squeeze_dim(1) // [B, width]
}

/// Two layers of linear + batch norm + ReLU; fields `0 1 3 4` carry weights.
pub type EncoderBn = (Linear, BatchNorm, Relu, Linear, BatchNorm);
/// Two layers of linear + layer norm + ReLU; fields `0 1 3 4` carry weights.
pub type EncoderLn = (Linear, LayerNorm, Relu, Linear, LayerNorm);

/// An encoder of rows `[R, inputs] -> [R, widths[1]]` with batch norm.
pub fn encoder_bn(inputs: usize, widths: [usize; 2], device: &Device) -> EncoderBn {
    let [a, b] = widths;
    let (first, second) = (linear(inputs, a, device), linear(a, b, device));
    (first, batch_norm_layer(a, device), Relu, second, batch_norm_layer(b, device))
}

/// An encoder of rows with layer norm.
pub fn encoder_ln(inputs: usize, widths: [usize; 2], device: &Device) -> EncoderLn {
    let [a, b] = widths;
    let (first, second) = (linear(inputs, a, device), linear(a, b, device));
    (first, layer_norm(a, device), Relu, second, layer_norm(b, device))
}

/// Applies an [`EncoderBn`] to rows [R, C].
pub fn encode_bn(encoder: &EncoderBn, rows: Tensor<2>) -> Tensor<2> {
    let hidden = relu(batch_norm(&encoder.1, encoder.0.forward(rows)));
    relu(batch_norm(&encoder.4, encoder.3.forward(hidden)))
}

/// Applies an [`EncoderLn`].
pub fn encode_ln<const D: usize>(encoder: &EncoderLn, x: Tensor<D>) -> Tensor<D> {
    linear_ln_relu(&encoder.3, &encoder.4, linear_ln_relu(&encoder.0, &encoder.1, x))
}

/// x + LN(Linear(ReLU(LN(Linear x)))).
#[derive(Module, Debug)]
pub struct ResBlock {
    net: (Linear, LayerNorm, Relu, Linear, LayerNorm),
}

impl ResBlock {
    /// A block of this many channels.
    pub fn new(channels: usize, device: &Device) -> Self {
        Self { net: encoder_ln(channels, [channels, channels], device) }
    }

    /// [.., C] -> [.., C].
    pub fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        let hidden = linear_ln_relu(&self.net.0, &self.net.1, x.clone());
        x + self.net.4.forward(self.net.3.forward(hidden))
    }
}

/// Multi-head self-attention with PyTorch's packed projection, as `nn.MultiheadAttention(batch_first=True)`.
#[derive(Module, Debug)]
pub struct SelfAttention {
    /// [3E, E]: rows of query, key, value.
    in_proj_weight: Param<Tensor<2>>,
    /// [3E].
    in_proj_bias: Param<Tensor<1>>,
    out_proj: Linear,
    heads: usize,
}

impl SelfAttention {
    /// Width E and number of heads, which divides it. Starts as PyTorch does: Xavier-uniform, biases 0.
    pub fn new(width: usize, heads: usize, device: &Device) -> Self {
        let xavier = Initializer::XavierUniform { gain: 1.0 };
        let mut out_proj = linear(width, width, device);
        out_proj.bias = Some(Initializer::Zeros.init([width], device));
        Self {
            in_proj_weight: xavier.init_with([3 * width, width], Some(width), Some(3 * width), device),
            in_proj_bias: Initializer::Zeros.init([3 * width], device),
            out_proj,
            heads,
        }
    }

    /// [B, K, E] -> [B, K, E]; `padding` [B, K] is true where a key is padding and must not be attended to.
    pub fn forward(&self, x: Tensor<3>, padding: Option<Tensor<2, Bool>>) -> Tensor<3> {
        let [b, k, e] = x.dims();
        let (h, d) = (self.heads, e / self.heads);
        let packed = x.reshape([b * k, e]).matmul(self.in_proj_weight.val().transpose())
            + self.in_proj_bias.val().unsqueeze::<2>(); // [B*K, 3E]
        let packed = packed.reshape([b, k, 3, h, d]).permute([2, 0, 3, 1, 4]); // [3, B, H, K, D]
        let part = |i: usize| packed.clone().narrow(0, i, 1).reshape([b, h, k, d]); // [B, H, K, D]
        let (query, key, value) = (part(0), part(1), part(2));
        let mut weights = query.matmul(key.transpose()) / (d as f64).sqrt(); // [B, H, K, K]
        if let Some(padding) = padding {
            let padding = padding.reshape([b, 1, 1, k]).expand([b, h, k, k]); // [B, H, K, K]
            weights = weights.mask_fill(padding, f32::NEG_INFINITY);
        }
        let out = softmax(weights, 3).matmul(value); // [B, H, K, D]
        let out = out.permute([0, 2, 1, 3]).reshape([b, k, e]); // [B, K, E]
        self.out_proj.forward(out)
    }
}
