//! The backward pass in slices; its mathematics is in [`crate::shared_mlp::backward`].

use super::columns::{self, Winners};
use super::forward::{Layer, Normalised, Saved, add};
use burn::tensor::Tensor;

/// Gradients of one layer's parameters. That of the bias is zero: batch norm takes the mean off again.
#[derive(Clone, Debug)]
pub struct LayerGradients {
    /// [K, C].
    pub weight: Tensor<2>,
    /// [C].
    pub gamma: Tensor<1>,
    /// [C].
    pub beta: Tensor<1>,
}

/// What flows into a layer's batch norm from above: dy per slice, and per column the sums of dy and of dy (h - mean), [1, C].
struct Flow {
    dy: Vec<Tensor<2>>,
    sum: Tensor<2>,
    product: Tensor<2>,
}

/// Batch norm's backward per column, [1, C].
struct NormBackward {
    gamma: Tensor<1>,
    beta: Tensor<1>,
    /// gamma / std.
    s: Tensor<2>,
    /// s sum(dy) / R.
    s_m1: Tensor<2>,
    /// s sum(dy xhat) / R / std.
    d: Tensor<2>,
}

impl NormBackward {
    fn new(norm: &Normalised, sum: Tensor<2>, product: Tensor<2>, rows: usize) -> Self {
        let xhat = product / norm.deviation.clone();
        let s = norm.scale.clone();
        Self {
            s_m1: s.clone() * sum.clone() / rows as f64,
            d: s.clone() * xhat.clone() / norm.deviation.clone() / rows as f64,
            gamma: xhat.squeeze_dim(0),
            beta: sum.squeeze_dim(0),
            s,
        }
    }
}

/// Gradients of all layers' parameters, given that of the output, [B, C]. Frees the saved buffers as it goes.
pub fn backward(layers: &[Layer], mut saved: Saved, gradient: Tensor<2>) -> Vec<LayerGradients> {
    let rows: usize = saved.points.iter().map(|slice| slice.dims()[0]).sum();
    let (gradients, mut flow) = last_layer(&layers[layers.len() - 1], &saved, gradient, rows);
    let mut all = vec![gradients];
    for index in (0..layers.len() - 1).rev() {
        let h = saved.hidden.pop().unwrap_or_default();
        let Some(above) = flow.take() else { break };
        let (gradients, below) = hidden_layer(&layers[index], &saved, index, h, above, rows);
        all.push(gradients);
        flow = below;
    }
    all.reverse();
    all
}

fn last_layer(layer: &Layer, saved: &Saved, gradient: Tensor<2>, rows: usize) -> (LayerGradients, Option<Flow>) {
    let norm = &saved.norms[saved.norms.len() - 1];
    // dy of each winner; nothing flows where the ReLU is off.
    let dy = gradient.mask_fill(saved.out.clone().lower_equal_scalar(0.0), 0.0); // [B, C]
    let product = (dy.clone() * (saved.best.clone() * layer.sign() - norm.mean.clone())).sum_dim(0);
    let back = NormBackward::new(norm, dy.clone().sum_dim(0), product, rows);
    let s_dy = dy * back.s.clone(); // [B, C]

    let weighted = layer.weight.clone() * back.d.clone(); // W diag(d)
    let transposed = layer.weight.clone().transpose(); // [C, K]
    let mixing = weighted.clone().matmul(transposed.clone()); // [K, K]
    let constant = saved.input_mean.clone().matmul(mixing.clone()) - back.s_m1.clone().matmul(transposed.clone()); // [1, K]
    let below = saved.hidden.len().checked_sub(1);
    let precision = saved.precision_of(saved.hidden.len());
    let mut weight: Option<Tensor<2>> = None; // S transposed, [C, K]
    let mut gram: Option<Tensor<2>> = None; // [K, K]
    let mut flow = Sums::default();
    let mut first = 0;
    for (slice, winner) in saved.winner.iter().enumerate() {
        let [size, _] = winner.dims();
        let a = saved.input(saved.hidden.len(), slice); // [rows, K]
        let s_dy = s_dy.clone().narrow(0, first, size);
        first += size;
        add(&mut weight, columns::at_winners(&a, &s_dy, winner));
        let centred = a.clone() - saved.input_mean.clone();
        add(&mut gram, precision.product_over_rows(centred.clone(), centred));
        let Some(below) = below else { continue };
        let mixed = precision.product(a, mixing.clone()); // [rows, K]
        let winners = Winners { s_dy: &s_dy, winner, transposed: &transposed };
        let (h, norm) = (&saved.hidden[below][slice], &saved.norms[below]);
        flow.push(columns::through_winners(mixed, &constant, winners, h, norm));
    }
    let (Some(s), Some(gram)) = (weight, gram) else { unreachable!("a batch has a slice") };
    let mean = saved.input_mean.clone().transpose().matmul(back.s_m1.clone()) * rows as f64; // [K, C]
    let weight = s.transpose() - mean - gram.matmul(weighted);
    (LayerGradients { weight, gamma: back.gamma, beta: back.beta }, flow.finish())
}

/// Gathers a [`Flow`].
#[derive(Default)]
struct Sums {
    dy: Vec<Tensor<2>>,
    /// [2, C].
    sums: Option<Tensor<2>>,
}

impl Sums {
    fn push(&mut self, (dy, sums): (Tensor<2>, Tensor<2>)) {
        add(&mut self.sums, sums);
        self.dy.push(dy);
    }

    fn finish(self) -> Option<Flow> {
        let sums = self.sums?;
        Some(Flow { dy: self.dy, sum: sums.clone().narrow(0, 0, 1), product: sums.narrow(0, 1, 1) })
    }
}

fn hidden_layer(
    layer: &Layer,
    saved: &Saved,
    index: usize,
    h: Vec<Tensor<2>>,
    flow: Flow,
    rows: usize,
) -> (LayerGradients, Option<Flow>) {
    let norm = &saved.norms[index];
    let back = NormBackward::new(norm, flow.sum, flow.product, rows);
    // dh = s (dy - m1 - xhat m2) = s dy - p - d h.
    let p = back.s_m1.clone() - back.d.clone() * norm.mean.clone();
    let transposed = layer.weight.clone().transpose();
    let precision = saved.precision_of(index);
    let mut weight: Option<Tensor<2>> = None;
    let mut below = Sums::default();
    for (slice, (dy, h)) in flow.dy.into_iter().zip(h).enumerate() {
        let dh = dy * back.s.clone() - p.clone() - h * back.d.clone(); // [rows, C]
        let a = saved.input(index, slice); // [rows, K]
        add(&mut weight, precision.product_over_rows(a, dh.clone()));
        if let Some(before) = index.checked_sub(1) {
            let da = precision.product(dh, transposed.clone()); // [rows, K]
            below.push(columns::through_relu(da, &saved.hidden[before][slice], &saved.norms[before]));
        }
    }
    let Some(weight) = weight else { unreachable!("a batch has a slice") };
    (LayerGradients { weight, gamma: back.gamma, beta: back.beta }, below.finish())
}
