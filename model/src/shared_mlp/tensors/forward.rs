//! The forward pass in slices.

use super::columns::{self, Largest};
use crate::precision::Precision;
use burn::tensor::activation::relu;
use burn::tensor::{DType, Int, Tensor};

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

/// Rows of the first slice whose mean is the centre that all deviations are taken from: near enough to the mean of all that
/// sums of squares lose no digits.
const CENTRE_ROWS: usize = 64;

/// Sums of a layer's products over the slices.
#[derive(Default)]
struct Moments {
    /// [1, C].
    centre: Option<Tensor<2>>,
    /// Of deviations from the centre, and of their squares, [2, C].
    sums: Option<Tensor<2>>,
}

impl Moments {
    /// The centre, for the products of a slice.
    fn centre(&mut self, product: &Tensor<2>) -> Tensor<2> {
        let first = |product: &Tensor<2>| {
            let rows = product.dims()[0].min(CENTRE_ROWS);
            product.clone().narrow(0, 0, rows).cast(DType::F32).mean_dim(0)
        };
        self.centre.get_or_insert_with(|| first(product)).clone()
    }

    fn normalised(self, layer: &Layer, rows: usize) -> Normalised {
        let (Some(centre), Some(sums)) = (self.centre, self.sums) else { unreachable!("a batch has a slice") };
        let (first, second) = (sums.clone().narrow(0, 0, 1), sums.narrow(0, 1, 1));
        let shifted = first / rows as f64;
        let variance = (second / rows as f64 - shifted.clone() * shifted.clone()).clamp_min(0.0);
        let mean = centre + shifted;
        let deviation = (variance.clone() + layer.epsilon).sqrt();
        let scale = layer.gamma.clone() / deviation.clone();
        let shift = layer.beta.clone() - mean.clone() * scale.clone();
        Normalised { mean, variance, deviation, scale, shift }
    }
}

/// Adds to a sum that may not have begun.
pub fn add(sum: &mut Option<Tensor<2>>, part: Tensor<2>) {
    *sum = Some(match sum.take() {
        Some(sum) => sum + part,
        None => part,
    });
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
            let product = precision_of(precision, index).product(a, layer.weight.clone()); // [rows, C]
            let centre = moments.centre(&product);
            add(&mut moments.sums, columns::sums(&product, &centre));
            products.push(product);
        }
        norms.push(moments.normalised(layer, samples * n));
        hidden.push(products);
    }
    let sign = last.sign();
    let mut moments = Moments::default();
    let (mut best, mut winner, mut input_sum) = (Vec::new(), Vec::new(), None);
    for slice in 0..slices.len() {
        let (a, sum) = match hidden.last().zip(norms.last()) {
            Some((h, norm)) => columns::activated(&h[slice], norm),
            None => (slices[slice].clone(), slices[slice].clone().sum_dim(0)),
        };
        add(&mut input_sum, sum);
        // [rows, C], gone with the slice
        let product = precision_of(precision, before.len()).product_as_is(a, last.weight.clone());
        let centre = moments.centre(&product);
        let found: Largest = columns::largest(&product, &centre, &sign, n);
        add(&mut moments.sums, found.sums);
        best.push(found.best);
        winner.push(found.winner);
    }
    let Some(input_sum) = input_sum else { unreachable!("a batch has a slice") };
    let input_mean = input_sum / (samples * n) as f64;
    let norm = moments.normalised(last, samples * n);
    let best = Tensor::cat(best, 0); // [B, C]
    let out = relu(best.clone() * sign * norm.scale.clone() + norm.shift.clone());
    norms.push(norm);
    Saved { precision, points: slices, hidden, norms, best, winner, input_mean, out }
}
