//! The backward pass in plain f32.
//!
//! The last layer by algebra, since its gradient is B x C winners plus what batch statistics add. With s = gamma/std,
//! m1 = sum(dy)/R, m2 = sum(dy xhat)/R, d = s m2/std, Gram the centred a'a, S the sum over winners of a's s dy:
//!
//! dW = S - R mean(a) (s m1)' - Gram W diag(d),
//! da = winners (s dy W') - W (s m1) - (a - mean(a)) (W diag(d) W').
//!
//! Two K x K products per row instead of two K x C, and no [R, C] buffer. Hidden layers in one pass each.

use super::buffers::Buffer;
use super::columns;
use super::forward::{Input, Layer, Normalised, Saved, sign};
use super::product::{self, Matrix};
use super::rows::{self, Chunk};
use rayon::prelude::*;

/// Gradients of one layer's parameters. That of the bias is zero: batch norm takes the mean off again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LayerGradients {
    /// [inputs, outputs].
    pub weight: Vec<f32>,
    pub gamma: Vec<f32>,
    pub beta: Vec<f32>,
}

/// Gradients of all layers' parameters, given that of the output, [B, C]. Frees the saved buffers as it goes.
pub fn backward(layers: &[Layer], points: &[f32], mut saved: Saved, gradient: &[f32]) -> Vec<LayerGradients> {
    let parts = rows::parts(saved.samples, saved.n);
    let last = layers.len() - 1;
    let mut all = vec![LayerGradients::default(); layers.len()];
    let (gradients, mut flow) = last_layer(&layers[last], points, &saved, gradient, &parts);
    all[last] = gradients;
    for index in (0..last).rev() {
        let h = saved.hidden.pop().unwrap_or_default();
        let (gradients, before) = hidden_layer(&layers[index], points, &saved, index, &h, flow, &parts);
        all[index] = gradients;
        flow = before;
    }
    all
}

/// What flows into a layer's batch norm from above: dy [R, C], and per column the sums of dy and of dy (h - mean).
#[derive(Default)]
struct Flow {
    dy: Buffer,
    sum: Vec<f64>,
    product: Vec<f64>,
}

/// Batch norm's backward per column.
struct NormBackward {
    gamma: Vec<f32>,
    beta: Vec<f32>,
    /// gamma / std.
    s: Vec<f64>,
    /// sum(dy) / R.
    m1: Vec<f64>,
    /// sum(dy xhat) / R / std.
    m2_std: Vec<f64>,
}

impl NormBackward {
    fn new(layer: &Layer, norm: &Normalised, sum: &[f64], product: &[f64], r: usize) -> Self {
        let std: Vec<f64> = norm.variance.iter().map(|v| (f64::from(*v) + layer.epsilon).sqrt()).collect();
        let over_std = |v: &[f64]| v.iter().zip(&std).map(|(x, std)| x / std).collect::<Vec<f64>>();
        let xhat = over_std(product);
        Self {
            gamma: xhat.iter().map(|x| *x as f32).collect(),
            beta: sum.iter().map(|x| *x as f32).collect(),
            s: layer.gamma.iter().zip(&std).map(|(gamma, std)| f64::from(*gamma) / std).collect(),
            m1: sum.iter().map(|x| x / r as f64).collect(),
            m2_std: over_std(&xhat).iter().map(|x| x / r as f64).collect(),
        }
    }
}

fn last_layer(
    layer: &Layer,
    points: &[f32],
    saved: &Saved,
    gradient: &[f32],
    parts: &[Vec<Chunk>],
) -> (LayerGradients, Flow) {
    let (k, c) = (layer.inputs, layer.outputs);
    let r = saved.samples * saved.n;
    let norm = &saved.norms[saved.norms.len() - 1];
    let (mut sum, mut product) = (vec![0.0f64; c], vec![0.0f64; c]);
    // dy of each winner; nothing flows where the ReLU is off.
    let mut dy = gradient.to_vec();
    for at in 0..dy.len() {
        let j = at % c;
        if saved.out[at] <= 0.0 {
            dy[at] = 0.0;
        }
        sum[j] += f64::from(dy[at]);
        let u = f64::from(saved.best[at] * sign(layer.gamma[j]));
        product[j] += f64::from(dy[at]) * (u - f64::from(norm.mean[j]));
    }
    let norm = NormBackward::new(layer, norm, &sum, &product, r);
    for (at, dy) in dy.iter_mut().enumerate() {
        *dy *= norm.s[at % c] as f32; // now s dy
    }

    let d: Vec<f32> = (0..c).map(|j| (norm.s[j] * norm.m2_std[j]) as f32).collect();
    let s_m1: Vec<f64> = (0..c).map(|j| norm.s[j] * norm.m1[j]).collect();
    let mut weighted = layer.weight.to_vec(); // W diag(d), [K, C]
    weighted.par_chunks_exact_mut(c).for_each(|row| row.iter_mut().zip(&d).for_each(|(w, d)| *w *= d));
    let weights = Matrix::new(layer.weight, k, c);
    // Only layers below need da.
    let below = !saved.hidden.is_empty();
    let mixing = if below { blocks(Matrix::new(&weighted, k, c), weights.transposed()) } else { Vec::new() }; // [K, K]
    let constant: Vec<f32> = (0..if below { k } else { 0 })
        .into_par_iter()
        .map(|i| {
            let direct: f64 = (0..c).map(|j| f64::from(layer.weight[i * c + j]) * s_m1[j]).sum();
            let mean: f64 = (0..k).map(|j| f64::from(saved.input_mean[j]) * f64::from(mixing[i * k + j])).sum();
            (mean - direct) as f32
        })
        .collect();
    let mut transposed = Buffer::of(c * k); // [C, K]
    transposed.par_chunks_exact_mut(k).enumerate().for_each(|(j, row)| {
        row.iter_mut().enumerate().for_each(|(i, w)| *w = layer.weight[i * c + j]);
    });

    let input = Input::of(points, &saved.hidden, &saved.norms);
    let mut da = Buffer::of(if below { r * k } else { 0 });
    let pieces = rows::split(&mut da, parts, if below { k } else { 0 });
    let mean = if below { saved.norms[saved.norms.len() - 2].mean.clone() } else { vec![0.0; k] };
    let step = LastStep {
        k,
        c,
        s_dy: &dy,
        winner: &saved.winner,
        transposed: &transposed,
        mixing: &mixing,
        constant: &constant,
        mean: &mean,
    };
    let partial: Vec<LastSums> =
        pieces.into_par_iter().zip(parts).map(|(piece, part)| last_part(&step, &input, part, piece)).collect();

    let s = rows::sums(partial.iter().map(|part| &part.winners[..]), c * k);
    let mut flow = Flow { dy: da, sum: vec![0.0; k], product: vec![0.0; k] };
    for part in &partial {
        rows::merge(&mut flow.sum, &part.sum);
        rows::merge(&mut flow.product, &part.product);
    }
    let mixed = blocks(Matrix::new(&saved.gram, k, k), Matrix::new(&weighted, k, c)); // [K, C]
    let mut weight = mixed;
    weight.par_chunks_exact_mut(c).enumerate().for_each(|(i, row)| {
        let rows_mean = r as f64 * f64::from(saved.input_mean[i]);
        for (j, w) in row.iter_mut().enumerate() {
            *w = (s[j * k + i] - rows_mean * s_m1[j] - f64::from(*w)) as f32;
        }
    });
    (LayerGradients { weight, gamma: norm.gamma, beta: norm.beta }, flow)
}

/// A product computed in fixed blocks of rows on all cores.
fn blocks(a: Matrix, b: Matrix) -> Vec<f32> {
    const BLOCK: usize = 64;
    let (m, n) = (a.rows(), b.width());
    let mut out = vec![0.0; m * n];
    out.par_chunks_mut(BLOCK * n).enumerate().for_each(|(i, out)| {
        let range = i * BLOCK..m.min((i + 1) * BLOCK);
        product::product(out, n, 0.0, 1.0, a.transposed().columns(range).transposed(), b);
    });
    out
}

struct LastStep<'a> {
    k: usize,
    c: usize,
    s_dy: &'a [f32],
    winner: &'a [u32],
    transposed: &'a [f32],
    mixing: &'a [f32],
    constant: &'a [f32],
    mean: &'a [f32],
}

struct LastSums {
    /// S transposed, [C, K].
    winners: Buffer,
    sum: Vec<f32>,
    product: Vec<f32>,
}

fn last_part(step: &LastStep, input: &Input, part: &[Chunk], out: &mut [f32]) -> LastSums {
    let (k, c) = (step.k, step.c);
    let mut sums = LastSums { winners: Buffer::zeros(c * k), sum: vec![0.0; k], product: vec![0.0; k] };
    let mut buffer = Buffer::of(rows::longest(part) * k);
    let mut unused = vec![0.0; k];
    let mut rest = out;
    for chunk in part {
        let count = chunk.rows.len();
        let a = input.activated(chunk, &mut buffer, &mut unused);
        let below = !step.mixing.is_empty();
        let (da, after) = rest.split_at_mut(if below { count * k } else { 0 });
        rest = after;
        if below {
            for row in da.chunks_exact_mut(k) {
                row.copy_from_slice(step.constant);
            }
            product::product(da, k, 1.0, -1.0, Matrix::new(a, count, k), Matrix::new(step.mixing, k, k));
        }
        for j in 0..c {
            let at = chunk.sample * c + j;
            let (row, s_dy) = (step.winner[at] as usize, step.s_dy[at]);
            if s_dy == 0.0 || !chunk.rows.contains(&row) {
                continue;
            }
            let local = (row - chunk.rows.start) * k..(row - chunk.rows.start + 1) * k;
            columns::add_scaled(&mut sums.winners[j * k..(j + 1) * k], s_dy, &a[local.clone()]);
            if below {
                columns::add_scaled(&mut da[local], s_dy, &step.transposed[j * k..(j + 1) * k]);
            }
        }
        if below {
            columns::mask_and_sum(da, a, input.raw(chunk), step.mean, &mut sums.sum, &mut sums.product);
        }
    }
    sums
}

struct HiddenSums {
    weight: Buffer,
    sum: Vec<f32>,
    product: Vec<f32>,
}

fn hidden_layer(
    layer: &Layer,
    points: &[f32],
    saved: &Saved,
    index: usize,
    h: &[f32],
    mut flow: Flow,
    parts: &[Vec<Chunk>],
) -> (LayerGradients, Flow) {
    let (k, c) = (layer.inputs, layer.outputs);
    let r = saved.samples * saved.n;
    let norm = &saved.norms[index];
    let back = NormBackward::new(layer, norm, &flow.sum, &flow.product, r);
    // dh = s (dy - m1 - xhat m2) = s dy - p - q h.
    let s: Vec<f32> = back.s.iter().map(|s| *s as f32).collect();
    let q: Vec<f32> = (0..c).map(|j| (back.s[j] * back.m2_std[j]) as f32).collect();
    let p: Vec<f32> = (0..c).map(|j| (back.s[j] * back.m1[j]) as f32 - q[j] * norm.mean[j]).collect();

    let input = Input::of(points, &saved.hidden, &saved.norms);
    let below = index > 0;
    let mut before = Flow { dy: Buffer::of(if below { r * k } else { 0 }), sum: vec![0.0; k], product: vec![0.0; k] };
    let mean = if below { &saved.norms[index - 1].mean[..] } else { &[] };
    let incoming = rows::split(&mut flow.dy, parts, c);
    let outgoing = rows::split(&mut before.dy, parts, if below { k } else { 0 });
    let partial: Vec<HiddenSums> = incoming
        .into_par_iter()
        .zip(outgoing)
        .zip(parts)
        .map(|((dy, out), part)| {
            let mut sums = HiddenSums { weight: Buffer::zeros(k * c), sum: vec![0.0; k], product: vec![0.0; k] };
            let (mut buffer, mut unused) = (Buffer::of(rows::longest(part) * k), vec![0.0; k]);
            let (mut dy, mut out) = (dy, out);
            for chunk in part {
                let count = chunk.rows.len();
                let (dh, rest) = std::mem::take(&mut dy).split_at_mut(count * c);
                dy = rest;
                columns::normalisation_backward(dh, &h[chunk.rows.start * c..chunk.rows.end * c], &s, &p, &q);
                let a = input.activated(chunk, &mut buffer, &mut unused);
                let (inputs, outputs) = (Matrix::new(a, count, k), Matrix::new(dh, count, c));
                product::product(&mut sums.weight, c, 1.0, 1.0, inputs.transposed(), outputs);
                if below {
                    let (da, rest) = std::mem::take(&mut out).split_at_mut(count * k);
                    out = rest;
                    product::product(da, k, 0.0, 1.0, outputs, Matrix::new(layer.weight, k, c).transposed());
                    columns::mask_and_sum(da, a, input.raw(chunk), mean, &mut sums.sum, &mut sums.product);
                }
            }
            sums
        })
        .collect();
    let weight = rows::sums(partial.iter().map(|part| &part.weight[..]), k * c);
    for part in &partial {
        rows::merge(&mut before.sum, &part.sum);
        rows::merge(&mut before.product, &part.product);
    }
    let weight = weight.iter().map(|x| *x as f32).collect();
    (LayerGradients { weight, gamma: back.gamma, beta: back.beta }, before)
}
