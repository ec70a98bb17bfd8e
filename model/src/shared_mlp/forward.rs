//! The forward passes in plain f32.

use super::buffers::{self, Buffer};
use super::columns::{self, Winners};
use super::product::{self, Matrix};
use super::rows::{self, Chunk};
use super::statistics::Moments;
use rayon::prelude::*;

/// Columns of the input: a position or a normal.
pub const COORDINATES: usize = 3;

/// One layer's parameters; `weight` is [inputs, outputs], row-major.
#[derive(Clone, Copy)]
pub struct Layer<'a> {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: &'a [f32],
    pub gamma: &'a [f32],
    pub beta: &'a [f32],
    pub epsilon: f64,
}

/// One layer folded with its running statistics.
pub struct Folded {
    inputs: usize,
    outputs: usize,
    weight: Vec<f32>,
    shift: Vec<f32>,
}

impl Folded {
    /// y = x W + bias, then batch norm by `mean` and `variance`, as one product and one shift.
    pub fn new(layer: &Layer, bias: &[f32], mean: &[f32], variance: &[f32]) -> Self {
        let scale: Vec<f64> = layer
            .gamma
            .iter()
            .zip(variance)
            .map(|(gamma, variance)| f64::from(*gamma) / (f64::from(*variance) + layer.epsilon).sqrt())
            .collect();
        let weight = layer.weight.chunks_exact(layer.outputs);
        let weight = weight.flat_map(|row| row.iter().zip(&scale).map(|(w, s)| (f64::from(*w) * s) as f32)).collect();
        let shift = (0..layer.outputs)
            .map(|j| ((f64::from(bias[j]) - f64::from(mean[j])) * scale[j] + f64::from(layer.beta[j])) as f32)
            .collect();
        Self { inputs: layer.inputs, outputs: layer.outputs, weight, shift }
    }
}

/// Inference: points [samples * n, 3] -> [samples, outputs of the last layer].
pub fn infer(layers: &[Folded], points: &[f32], samples: usize, n: usize) -> Vec<f32> {
    let last = &layers[layers.len() - 1];
    let parts = rows::parts(samples, n);
    let partial: Vec<Vec<(usize, Vec<f32>)>> = parts
        .par_iter()
        .map(|part| {
            let mut buffers = [Vec::new(), Vec::new()];
            part.iter().map(|chunk| (chunk.sample, infer_chunk(layers, points, chunk, &mut buffers))).collect()
        })
        .collect();
    let mut out = vec![f32::NEG_INFINITY; samples * last.outputs];
    for (sample, best) in partial.into_iter().flatten() {
        columns::running_max(&mut out[sample * last.outputs..][..last.outputs], &best);
    }
    columns::shift_relu(&mut out, &last.shift);
    out
}

/// Largest products of the last layer over the chunk's rows.
fn infer_chunk(layers: &[Folded], points: &[f32], chunk: &Chunk, buffers: &mut [Vec<f32>; 2]) -> Vec<f32> {
    let count = chunk.rows.len();
    let [input, output] = buffers;
    let width = layers[0].inputs;
    input.clear();
    input.extend_from_slice(&points[chunk.rows.start * width..chunk.rows.end * width]);
    for (i, layer) in layers.iter().enumerate() {
        let (k, c) = (layer.inputs, layer.outputs);
        output.resize(count * c, 0.0);
        product::product(output, c, 0.0, 1.0, Matrix::new(input, count, k), Matrix::new(&layer.weight, k, c));
        if i + 1 < layers.len() {
            columns::shift_relu(output, &layer.shift);
            std::mem::swap(input, output);
        }
    }
    let mut best = vec![f32::NEG_INFINITY; layers[layers.len() - 1].outputs];
    let (columns, rows) = (best.len(), count);
    columns::running_max(&mut best, &output[..rows * columns]);
    best
}

/// A layer's batch statistics, and batch norm as y = x scale + shift.
#[derive(Clone, Debug)]
pub struct Normalised {
    pub mean: Vec<f32>,
    /// Biased.
    pub variance: Vec<f32>,
    pub scale: Vec<f32>,
    pub shift: Vec<f32>,
}

impl Normalised {
    fn new(layer: &Layer, moments: &Moments) -> Self {
        let variance = moments.variance();
        let deviation: Vec<f64> = variance.iter().map(|v| (v + layer.epsilon).sqrt()).collect();
        let scale: Vec<f64> = layer.gamma.iter().zip(&deviation).map(|(gamma, d)| f64::from(*gamma) / d).collect();
        let shift =
            (0..layer.outputs).map(|j| (f64::from(layer.beta[j]) - moments.mean[j] * scale[j]) as f32).collect();
        let single = |v: &[f64]| v.iter().map(|x| *x as f32).collect();
        Self { mean: single(&moments.mean), variance: single(&variance), scale: single(&scale), shift }
    }
}

/// What the backward pass needs of the forward pass.
pub struct Saved {
    pub samples: usize,
    /// Points per sample.
    pub n: usize,
    /// Products of the layers before the last, before batch norm, [R, outputs].
    pub hidden: Vec<Buffer>,
    /// Per layer.
    pub norms: Vec<Normalised>,
    /// Largest product of the last layer times the sign of gamma, per sample and channel, [B, C].
    pub best: Vec<f32>,
    /// Its row among all R, [B, C].
    pub winner: Vec<u32>,
    /// Mean of the last layer's input, [K].
    pub input_mean: Vec<f32>,
    /// Sum over rows of the centred input's outer product, [K, K].
    pub gram: Vec<f32>,
    /// Output, [B, C].
    pub out: Vec<f32>,
}

/// Training: batch statistics over all rows.
pub fn train(layers: &[Layer], points: &[f32], samples: usize, n: usize) -> Saved {
    buffers::begin();
    let parts = rows::parts(samples, n);
    let r = samples * n;
    let (last, before) = (&layers[layers.len() - 1], &layers[..layers.len() - 1]);
    let mut hidden: Vec<Buffer> = Vec::with_capacity(before.len());
    let mut norms: Vec<Normalised> = Vec::with_capacity(layers.len());
    for layer in before {
        let mut h = Buffer::of(r * layer.outputs);
        let input = Input::of(points, &hidden, &norms);
        let pieces = rows::split(&mut h, &parts, layer.outputs);
        let moments: Vec<Moments> =
            pieces.into_par_iter().zip(&parts).map(|(piece, part)| hidden_part(layer, &input, part, piece)).collect();
        norms.push(Normalised::new(layer, &joined(&moments)));
        hidden.push(h);
    }
    let input = Input::of(points, &hidden, &norms);
    let partial: Vec<LastPart> = parts.par_iter().map(|part| last_part(last, &input, part)).collect();
    finish(last, samples, n, hidden, norms, &partial)
}

fn finish(
    last: &Layer,
    samples: usize,
    n: usize,
    hidden: Vec<Buffer>,
    mut norms: Vec<Normalised>,
    partial: &[LastPart],
) -> Saved {
    let (k, c) = (last.inputs, last.outputs);
    let mut moments = Moments::default();
    let mut sums = vec![0.0f64; k];
    let gram = rows::sums(partial.iter().map(|part| &part.gram[..]), k * k);
    let (mut best, mut winner) = (vec![f32::NEG_INFINITY; samples * c], vec![0u32; samples * c]);
    for part in partial {
        moments.merge(&part.moments);
        for (total, sum) in sums.iter_mut().zip(&part.sums) {
            *total += sum;
        }
        for (sample, values, rows) in &part.winners {
            let at = sample * c..(sample + 1) * c;
            let all = best[at.clone()].iter_mut().zip(&mut winner[at]);
            for ((best, winner), (value, row)) in all.zip(values.iter().zip(rows)) {
                if value > best {
                    (*best, *winner) = (*value, *row);
                }
            }
        }
    }
    let r = (samples * n) as f64;
    let mean: Vec<f64> = sums.iter().map(|s| s / r).collect();
    let mut gram: Vec<f32> = (0..k * k).map(|i| (gram[i] - r * mean[i / k] * mean[i % k]) as f32).collect();
    product::mirror(&mut gram, k);

    let norm = Normalised::new(last, &moments);
    let mut out = best.clone();
    for row in out.chunks_exact_mut(c) {
        for j in 0..c {
            row[j] = row[j] * sign(last.gamma[j]) * norm.scale[j];
        }
    }
    columns::shift_relu(&mut out, &norm.shift);
    norms.push(norm);
    let input_mean = mean.iter().map(|m| *m as f32).collect();
    Saved { samples, n, hidden, norms, best, winner, input_mean, gram, out }
}

/// 1 or -1: batch norm with a negative gamma turns the largest product into the smallest value.
pub fn sign(gamma: f32) -> f32 {
    if gamma < 0.0 { -1.0 } else { 1.0 }
}

/// A layer's input: the points, or the activation of the layer before.
pub struct Input<'a> {
    values: &'a [f32],
    columns: usize,
    norm: Option<&'a Normalised>,
}

impl<'a> Input<'a> {
    /// The input of the layer that comes after these.
    pub fn of(points: &'a [f32], hidden: &'a [Buffer], norms: &'a [Normalised]) -> Self {
        match hidden.last() {
            Some(h) => {
                let norm = &norms[hidden.len() - 1];
                Self { values: h, columns: norm.mean.len(), norm: Some(norm) }
            }
            None => Self { values: points, columns: COORDINATES, norm: None },
        }
    }

    /// The values before activation, of these rows.
    pub fn raw(&self, chunk: &Chunk) -> &'a [f32] {
        &self.values[chunk.rows.start * self.columns..chunk.rows.end * self.columns]
    }

    /// The input of these rows; `buffer` holds it where it had to be computed. Adds the columns' sums.
    pub fn activated<'b>(&'b self, chunk: &Chunk, buffer: &'b mut [f32], sums: &mut [f32]) -> &'b [f32] {
        let values = self.raw(chunk);
        match self.norm {
            Some(norm) => {
                let out = &mut buffer[..values.len()];
                columns::activate(out, values, &norm.scale, &norm.shift, sums);
                out
            }
            None => {
                columns::column_sums(sums, values);
                values
            }
        }
    }
}

/// Mean of a product's columns from the sums of its input: (sums / count) W.
fn centre(layer: &Layer, sums: &[f32], count: usize) -> Vec<f32> {
    let mut mean = vec![0.0; layer.outputs];
    for (sum, row) in sums.iter().zip(layer.weight.chunks_exact(layer.outputs)) {
        columns::add_scaled(&mut mean, sum / count as f32, row);
    }
    mean
}

fn joined(parts: &[Moments]) -> Moments {
    parts.iter().fold(Moments::default(), |mut all, part| {
        all.merge(part);
        all
    })
}

fn hidden_part(layer: &Layer, input: &Input, part: &[Chunk], out: &mut [f32]) -> Moments {
    let (k, c) = (layer.inputs, layer.outputs);
    let mut buffer = Buffer::of(rows::longest(part) * k);
    let mut moments = Moments::default();
    let mut rest = out;
    for chunk in part {
        let count = chunk.rows.len();
        let (h, after) = rest.split_at_mut(count * c);
        rest = after;
        let mut sums = vec![0.0; k];
        let a = input.activated(chunk, &mut buffer, &mut sums);
        product::product(h, c, 0.0, 1.0, Matrix::new(a, count, k), Matrix::new(layer.weight, k, c));
        let centre = centre(layer, &sums, count);
        let (mut first, mut second) = (vec![0.0; c], vec![0.0; c]);
        columns::deviations(h, &centre, &mut first, &mut second);
        moments.merge(&Moments::of_chunk(count, &centre, &first, &second));
    }
    moments
}

struct LastPart {
    moments: Moments,
    sums: Vec<f64>,
    /// Upper blocks of the sum of a'a.
    gram: Buffer,
    /// Per chunk: sample, best values, their rows.
    winners: Vec<(usize, Vec<f32>, Vec<u32>)>,
}

fn last_part(layer: &Layer, input: &Input, part: &[Chunk]) -> LastPart {
    let (k, c) = (layer.inputs, layer.outputs);
    let signs: Vec<f32> = layer.gamma.iter().map(|g| sign(*g)).collect();
    let longest = rows::longest(part);
    let (mut buffer, mut u) = (Buffer::of(longest * k), Buffer::of(longest * c));
    let (mut moments, mut total) = (Moments::default(), vec![0.0f64; k]);
    let mut gram = Buffer::zeros(k * k);
    let mut winners = Vec::with_capacity(part.len());
    for chunk in part {
        let count = chunk.rows.len();
        let mut sums = vec![0.0; k];
        let a = input.activated(chunk, &mut buffer, &mut sums);
        product::add_gram(&mut gram, a, count, k);
        let u = &mut u[..count * c];
        product::product(u, c, 0.0, 1.0, Matrix::new(a, count, k), Matrix::new(layer.weight, k, c));
        let centre = centre(layer, &sums, count);
        rows::merge(&mut total, &sums);
        let (mut first, mut second) = (vec![0.0; c], vec![0.0; c]);
        let (mut best, mut winner) = (vec![f32::NEG_INFINITY; c], vec![0; c]);
        let row = chunk.rows.start as u32;
        let mut found = Winners { sign: &signs, best: &mut best, row: &mut winner };
        columns::deviations_and_winners(u, row, &centre, &mut first, &mut second, &mut found);
        moments.merge(&Moments::of_chunk(count, &centre, &first, &second));
        winners.push((chunk.sample, best, winner));
    }
    LastPart { moments, sums: total, gram, winners }
}
