//! The operation in burn's tensor operations, for GPUs: the same mathematics as on the CPU ([`super::forward`],
//! [`super::backward`]), in slices of the batch.
//!
//! Kept for the backward pass are the products of the layers before the last, nothing as wide as the last, and no
//! buffer is larger than `SLICE_BYTES` (or one sample) whatever the batch: plain layers hold some twenty buffers of
//! [B*N, C], of which wgpu refuses any of 2 GiB. Statistics are summed over the slices, so they are those of the whole batch.

mod backward;
mod columns;
mod forward;
#[cfg(feature = "wgpu")]
mod kernels;

use super::{MOST_LAYERS, PARAMETERS};
use crate::blocks::{self, LinearBn};
use crate::precision;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::NoCheckpointing};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, NodeGuard, Ops, OpsKind};
use burn::backend::{Autodiff, Backend, DispatchKindConversion, DispatchTensor};
use burn::tensor::Tensor;
use forward::{Layer, Saved};
use std::sync::{Arc, Mutex};

/// Most bytes of a buffer: an eighth of what wgpu allows, and large enough to keep a card busy.
pub const SLICE_BYTES: usize = 256 << 20;

/// [B, N, 3] -> [B, C] in training, with the gradients of all parameters; `None` where a parameter is not on the backend
/// `B`. Moves the running statistics.
pub fn train<B>(layers: &[LinearBn], points: &Tensor<3>, slice_bytes: usize) -> Option<Tensor<2>>
where
    B: Backend,
    DispatchTensor: DispatchKindConversion<B> + DispatchKindConversion<Autodiff<B, NoCheckpointing>>,
{
    if layers.len() > MOST_LAYERS {
        return None;
    }
    let [samples, n, _] = points.dims();
    let mut guards = Vec::with_capacity(PARAMETERS * layers.len());
    let mut parameters = Vec::with_capacity(layers.len());
    for (linear, bn) in layers {
        let weight = linear.weight.val().try_into_primitive::<Autodiff<B, NoCheckpointing>>().ok()?.into_parts();
        let [bias, gamma, beta] = [linear.bias.as_ref()?, &bn.gamma, &bn.beta].map(|p| {
            p.val().try_into_primitive::<Autodiff<B, NoCheckpointing>>().ok().map(|tensor| tensor.into_parts())
        });
        let (bias, gamma, beta) = (bias?, gamma?, beta?);
        guards.extend([weight.1, bias.1, gamma.1, beta.1]);
        let row = |vector| Tensor::<1>::from_primitive::<B>(vector).unsqueeze::<2>(); // [1, C]
        let weight = Tensor::from_primitive::<B>(weight.0);
        parameters.push(Layer { weight, gamma: row(gamma.0), beta: row(beta.0), epsilon: bn.epsilon });
    }
    let saved = forward::train(&parameters, points, in_slice(layers, n, slice_bytes), precision::current());
    for ((linear, bn), norm) in layers.iter().zip(&saved.norms) {
        let vector = |row: &Tensor<2>| row.clone().squeeze_dim::<1>(0);
        // The bias was left out of the products: it shifts the mean and nothing else.
        let mean = vector(&norm.mean) + linear.bias.as_ref()?.val().without_autodiff();
        blocks::update_statistics(bn, mean, vector(&norm.variance), samples * n);
    }
    let out = saved.out.clone().try_into_primitive::<B>().ok()?;
    let state = State(Arc::new(Mutex::new(Some((parameters, saved)))));
    // The number of parents is part of the operation's type.
    match layers.len() {
        1 => record::<B, { PARAMETERS }>(guards, state, out),
        2 => record::<B, { 2 * PARAMETERS }>(guards, state, out),
        3 => record::<B, { 3 * PARAMETERS }>(guards, state, out),
        4 => record::<B, { 4 * PARAMETERS }>(guards, state, out),
        5 => record::<B, { 5 * PARAMETERS }>(guards, state, out),
        6 => record::<B, { 6 * PARAMETERS }>(guards, state, out),
        _ => None,
    }
}

/// [B, N, 3] -> [B, C] by plain layers in evaluation, where samples do not depend on each other.
pub fn infer(layers: &[LinearBn], points: Tensor<3>, slice_bytes: usize) -> Tensor<2> {
    let [_, n, _] = points.dims();
    let slices = points.split(in_slice(layers, n, slice_bytes), 0);
    Tensor::cat(slices.into_iter().map(|slice| blocks::shared_mlp_max(layers, slice)).collect(), 0)
}

/// Samples of which the widest layer has this many bytes, at least one.
fn in_slice(layers: &[LinearBn], n: usize, bytes: usize) -> usize {
    let widest = layers.iter().map(|(linear, _)| linear.weight.dims()[1]).max().unwrap_or(1);
    (bytes / (n * widest * size_of::<f32>())).max(1)
}

fn record<B, const N: usize>(guards: Vec<NodeGuard>, state: State, out: B::FloatTensorPrimitive) -> Option<Tensor<2>>
where
    B: Backend,
    DispatchTensor: DispatchKindConversion<B> + DispatchKindConversion<Autodiff<B, NoCheckpointing>>,
{
    let guards: [NodeGuard; N] = guards.try_into().ok()?;
    let prepared = <SharedMlpMax as Backward<B, N>>::prepare::<NoCheckpointing>(SharedMlpMax, guards);
    let out = match prepared.compute_bound().stateful() {
        OpsKind::Tracked(prepared) => prepared.finish(state, out),
        OpsKind::UnTracked(prepared) => prepared.finish(out),
    };
    Some(Tensor::from_primitive::<Autodiff<B, NoCheckpointing>>(out))
}

#[derive(Debug)]
struct SharedMlpMax;

/// What the backward pass needs of the forward one.
type Kept = (Vec<Layer>, Saved);

/// Taken by the one backward pass, so that buffers are freed as they are used up.
#[derive(Clone)]
struct State(Arc<Mutex<Option<Kept>>>);

impl std::fmt::Debug for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("State")
    }
}

impl<B, const N: usize> Backward<B, N> for SharedMlpMax
where
    B: Backend,
    DispatchTensor: DispatchKindConversion<B>,
{
    type State = State;

    fn backward(self, ops: Ops<State, N>, grads: &mut Gradients, _: &mut Checkpointer) {
        let gradient = Tensor::<2>::from_primitive::<B>(grads.consume::<B>(&ops.node)); // [B, C]
        let taken = ops.state.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        let Some((layers, saved)) = taken else {
            panic!("the graph of a shared MLP was walked twice; run the forward pass again")
        };
        let all = backward::backward(&layers, saved, gradient);
        let mut nodes = ops.parents.into_iter();
        for of_layer in all {
            let [width] = of_layer.gamma.dims();
            let bias = Tensor::<1>::zeros([width], &of_layer.gamma.device());
            let vectors = [bias, of_layer.gamma, of_layer.beta].map(|v| v.try_into_primitive::<B>());
            let weight = of_layer.weight.try_into_primitive::<B>();
            for (gradient, node) in std::iter::once(weight).chain(vectors).zip(nodes.by_ref()) {
                let (Ok(gradient), Some(node)) = (gradient, node) else { continue };
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

#[cfg(test)]
mod rounded_steps;
#[cfg(test)]
mod tests;
