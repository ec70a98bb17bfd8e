//! The backward pass in slices; its mathematics is in [`crate::shared_mlp::backward`].

use super::forward::{Layer, Normalised, Saved};
use burn::tensor::{IndexingUpdateOp, Int, Tensor};

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
    let [k, c] = layer.weight.dims();
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
        let s_dy = s_dy.clone().narrow(0, first, size).reshape([size * c, 1]);
        first += size;
        let at = rows_of(winner, saved.n); // [samples * C]
        let of_winners = a.clone().select(0, at.clone()) * s_dy.clone(); // [samples * C, K]
        add(&mut weight, of_winners.reshape([size, c, k]).sum_dim(0).reshape([c, k]));
        let centred = a.clone() - saved.input_mean.clone();
        add(&mut gram, precision.product(centred.clone().transpose(), centred));
        let Some(below) = below else { continue };
        let da = constant.clone() - precision.product(a.clone(), mixing.clone()); // [rows, K]
        let to_winners = transposed.clone().unsqueeze::<3>().expand([size, c, k]).reshape([size * c, k]) * s_dy;
        let at = at.reshape([size * c, 1]).expand([size * c, k]);
        let da = da.scatter(0, at, to_winners, IndexingUpdateOp::Add);
        flow.push(da, a, saved.hidden[below][slice].clone(), &saved.norms[below]);
    }
    let (Some(s), Some(gram)) = (weight, gram) else { unreachable!("a batch has a slice") };
    let mean = saved.input_mean.clone().transpose().matmul(back.s_m1.clone()) * rows as f64; // [K, C]
    let weight = s.transpose() - mean - gram.matmul(weighted);
    (LayerGradients { weight, gamma: back.gamma, beta: back.beta }, flow.finish())
}

/// Rows of a slice that hold these points of its samples: [samples, C] -> [samples * C].
fn rows_of(winner: &Tensor<2, Int>, n: usize) -> Tensor<1, Int> {
    let [size, c] = winner.dims();
    let first = Tensor::<1, Int>::arange(0..size as i64, &winner.device()).reshape([size, 1]) * n as i64;
    (winner.clone() + first).reshape([size * c])
}

fn add(sum: &mut Option<Tensor<2>>, part: Tensor<2>) {
    *sum = Some(match sum.take() {
        Some(sum) => sum + part,
        None => part,
    });
}

/// Gathers a [`Flow`].
#[derive(Default)]
struct Sums {
    dy: Vec<Tensor<2>>,
    sum: Option<Tensor<2>>,
    product: Option<Tensor<2>>,
}

impl Sums {
    /// Through the ReLU of a slice, whose output is `a`, and whose batch norm's input is `h`.
    fn push(&mut self, da: Tensor<2>, a: Tensor<2>, h: Tensor<2>, norm: &Normalised) {
        let dy = da.mask_fill(a.lower_equal_scalar(0.0), 0.0);
        add(&mut self.sum, dy.clone().sum_dim(0));
        add(&mut self.product, (dy.clone() * (h - norm.mean.clone())).sum_dim(0));
        self.dy.push(dy);
    }

    fn finish(self) -> Option<Flow> {
        Some(Flow { dy: self.dy, sum: self.sum?, product: self.product? })
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
        add(&mut weight, precision.product(a.clone().transpose(), dh.clone()));
        if let Some(before) = index.checked_sub(1) {
            let da = precision.product(dh, transposed.clone()); // [rows, K]
            below.push(da, a, saved.hidden[before][slice].clone(), &saved.norms[before]);
        }
    }
    let Some(weight) = weight else { unreachable!("a batch has a slice") };
    (LayerGradients { weight, gamma: back.gamma, beta: back.beta }, below.finish())
}
