//! The forward pass in slices.

use crate::precision::Precision;
use burn::tensor::activation::relu;
use burn::tensor::{Int, Tensor};

/// One layer's parameters: weight [K, C], the others [1, C].
#[derive(Clone, Debug)]
pub struct Layer {
    pub weight: Tensor<2>,
    pub gamma: Tensor<2>,
    pub beta: Tensor<2>,
    pub epsilon: f64,
}

impl Layer {
    /// 1 or -1, [1, C]: batch norm with a negative gamma turns the largest product into the smallest value.
    pub fn sign(&self) -> Tensor<2> {
        self.gamma.ones_like().mask_fill(self.gamma.clone().lower_scalar(0.0), -1.0)
    }
}

/// A layer's batch statistics, and batch norm as y = x scale + shift; all [1, C].
#[derive(Clone, Debug)]
pub struct Normalised {
    pub mean: Tensor<2>,
    /// Biased.
    pub variance: Tensor<2>,
    /// Of the variance with epsilon.
    pub deviation: Tensor<2>,
    pub scale: Tensor<2>,
    pub shift: Tensor<2>,
}

/// What the backward pass needs of the forward pass.
#[derive(Debug)]
pub struct Saved {
    /// Points per sample.
    pub n: usize,
    /// Of the products.
    pub precision: Precision,
    /// The input, per slice: [rows, 3].
    pub points: Vec<Tensor<2>>,
    /// Products of the layers before the last, before batch norm; per layer and slice: [rows, C].
    pub hidden: Vec<Vec<Tensor<2>>>,
    /// Per layer.
    pub norms: Vec<Normalised>,
    /// Largest product of the last layer times the sign of gamma, [B, C].
    pub best: Tensor<2>,
    /// Its point, per slice: [samples, C].
    pub winner: Vec<Tensor<2, Int>>,
    /// Mean of the last layer's input, [1, K].
    pub input_mean: Tensor<2>,
    /// Output, [B, C].
    pub out: Tensor<2>,
}

impl Saved {
    /// Precision of the products with the input of layer `index`.
    pub fn precision_of(&self, index: usize) -> Precision {
        precision_of(self.precision, index)
    }

    /// Input of layer `index` in a slice, and what it was before batch norm and ReLU.
    pub fn input(&self, index: usize, slice: usize) -> Tensor<2> {
        input(&self.points, &self.hidden, &self.norms, index, slice)
    }
}

/// Coordinates are never rounded.
fn precision_of(precision: Precision, index: usize) -> Precision {
    if index == 0 { Precision::F32 } else { precision }
}

fn input(
    points: &[Tensor<2>],
    hidden: &[Vec<Tensor<2>>],
    norms: &[Normalised],
    index: usize,
    slice: usize,
) -> Tensor<2> {
    match index.checked_sub(1) {
        Some(before) => {
            let norm = &norms[before];
            relu(hidden[before][slice].clone() * norm.scale.clone() + norm.shift.clone())
        }
        None => points[slice].clone(),
    }
}

/// Mean and squared deviations of columns, slice by slice, and of their merger (Chan, Golub and LeVeque 1983).
#[derive(Default)]
struct Moments {
    rows: Vec<f64>,
    means: Vec<Tensor<2>>,
    squares: Vec<Tensor<2>>,
}

impl Moments {
    /// Adds the rows of a product whose columns have this mean, [1, C].
    fn add(&mut self, product: &Tensor<2>, mean: Tensor<2>) {
        let deviation = product.clone() - mean.clone();
        self.squares.push((deviation.clone() * deviation).sum_dim(0));
        self.rows.push(product.dims()[0] as f64);
        self.means.push(mean);
    }

    fn total(&self) -> f64 {
        self.rows.iter().sum()
    }

    fn mean(&self) -> Tensor<2> {
        weighted_mean(&self.means, &self.rows)
    }

    fn normalised(self, layer: &Layer) -> Normalised {
        let (mean, total) = (self.mean(), self.total());
        let between = self.means.iter().zip(&self.rows).map(|(of_slice, rows)| {
            let d = of_slice.clone() - mean.clone();
            d.clone() * d * *rows
        });
        let variance =
            between.chain(self.squares).reduce(|a, b| a + b).map_or_else(|| mean.zeros_like(), |s| s / total);
        let deviation = (variance.clone() + layer.epsilon).sqrt();
        let scale = layer.gamma.clone() / deviation.clone();
        let shift = layer.beta.clone() - mean.clone() * scale.clone();
        Normalised { mean, variance, deviation, scale, shift }
    }
}

/// Mean of the slices' means, each by its rows.
fn weighted_mean(means: &[Tensor<2>], rows: &[f64]) -> Tensor<2> {
    let total: f64 = rows.iter().sum();
    let parts = means.iter().zip(rows).map(|(mean, rows)| mean.clone() * (rows / total));
    parts.reduce(|a, b| a + b).unwrap_or_else(|| unreachable!("a batch has a slice"))
}

/// Training, `in_slice` samples at a time: batch statistics over all rows of `points`, [B, N, 3].
pub fn train(layers: &[Layer], points: &Tensor<3>, in_slice: usize, precision: Precision) -> Saved {
    let [samples, n, columns] = points.dims();
    let sizes: Vec<usize> = (0..samples).step_by(in_slice).map(|start| in_slice.min(samples - start)).collect();
    let slices: Vec<Tensor<2>> = sizes
        .iter()
        .enumerate()
        .map(|(i, size)| points.clone().narrow(0, i * in_slice, *size).reshape([size * n, columns]))
        .collect();
    let (last, before) = (&layers[layers.len() - 1], &layers[..layers.len() - 1]);
    let (mut hidden, mut norms): (Vec<Vec<Tensor<2>>>, Vec<Normalised>) = (Vec::new(), Vec::new());
    for (index, layer) in before.iter().enumerate() {
        let mut moments = Moments::default();
        let mut products = Vec::with_capacity(slices.len());
        for slice in 0..slices.len() {
            let a = input(&slices, &hidden, &norms, index, slice);
            let product = precision_of(precision, index).product(a.clone(), layer.weight.clone()); // [rows, C]
            moments.add(&product, a.mean_dim(0).matmul(layer.weight.clone()));
            products.push(product);
        }
        norms.push(moments.normalised(layer));
        hidden.push(products);
    }
    let sign = last.sign();
    let [_, width] = last.weight.dims();
    let mut moments = Moments::default();
    let (mut best, mut winner, mut input_means) = (Vec::new(), Vec::new(), Vec::new());
    for (slice, size) in sizes.iter().enumerate() {
        let a = input(&slices, &hidden, &norms, layers.len() - 1, slice);
        // [rows, C], gone with the slice
        let product = precision_of(precision, before.len()).product(a.clone(), last.weight.clone());
        let mean = a.mean_dim(0); // [1, K]
        moments.add(&product, mean.clone().matmul(last.weight.clone()));
        input_means.push(mean);
        let (values, points) = (product * sign.clone()).reshape([*size, n, width]).max_dim_with_indices(1);
        best.push(values.reshape([*size, width]));
        winner.push(points.reshape([*size, width]));
    }
    let input_mean = weighted_mean(&input_means, &moments.rows);
    let norm = moments.normalised(last);
    let best = Tensor::cat(best, 0); // [B, C]
    let out = relu(best.clone() * sign * norm.scale.clone() + norm.shift.clone());
    norms.push(norm);
    Saved { n, precision, points: slices, hidden, norms, best, winner, input_mean, out }
}
