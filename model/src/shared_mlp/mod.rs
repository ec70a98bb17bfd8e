//! The shared MLP over points with batch norm, ReLU and the maximum over points, as one operation with a backward
//! pass of its own: in plain f32 on burn's CPU backend, in tensor operations on a GPU ([`tensors`]). Plain layers everywhere else
//! (gradient checkpointing, points that want a gradient).
//!
//! Why: plain layers write and read [B*N, C] several times per layer, 0.5 GB for the widest at B = 32, N = 4096.
//! Here the widest layer is never stored, batch norm is folded into its neighbours, and the last layer's backward
//! costs two products of its input's width ([`backward`]).

mod backward;
mod buffers;
mod columns;
mod forward;
mod product;
mod rows;
mod statistics;
#[cfg(any(feature = "wgpu", feature = "cuda", test))]
mod tensors;

use crate::blocks::{self, LinearBn};
pub use buffers::free_buffers;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::NoCheckpointing};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, NodeGuard, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::{Autodiff, Flex};
use burn::tensor::{Tensor, TensorData};
use forward::{Folded, Layer, Saved};
use std::sync::{Arc, Mutex};

type Ad = Autodiff<Flex, NoCheckpointing>;

/// [B, N, 3] -> [B, C]: the maximum over points of the shared MLP.
pub fn shared_mlp_max(layers: &[LinearBn], points: Tensor<3>) -> Tensor<2> {
    let [samples, n, columns] = points.dims();
    let fits = columns == forward::COORDINATES
        && samples > 0
        && n > 0
        && (1..=MOST_LAYERS).contains(&layers.len())
        && samples * n < 1 << 32;
    let plain = |points| blocks::shared_mlp_max(layers, points);
    let training = layers.iter().all(|(_, bn)| bn.gamma.device().is_autodiff() && bn.training.is_enabled());
    let frozen =
        layers.iter().all(|(linear, bn)| !linear.weight.device().is_autodiff() && !bn.gamma.device().is_autodiff());
    let Some(input) = points.clone().try_into_primitive::<Flex>().ok().filter(|_| fits) else {
        let out = if fits { on_a_gpu(layers, &points, training, frozen) } else { None };
        return out.unwrap_or_else(|| plain(points));
    };
    // In another precision the operation for GPUs serves, on the CPU's tensors: it rounds in the same places.
    #[cfg(any(feature = "wgpu", feature = "cuda", test))]
    if training
        && crate::precision::current() != crate::Precision::F32
        && let Some(out) = tensors::train::<Flex>(layers, &points, tensors::SLICE_BYTES)
    {
        return out;
    }
    let out = if training {
        train(layers, input.to_contiguous(), samples, n)
    } else if frozen {
        infer(layers, &input.to_contiguous(), samples, n)
    } else {
        None // Batch norm frozen in training: rare, and the plain layers know how.
    };
    out.unwrap_or_else(|| plain(points))
}

#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn on_a_gpu(layers: &[LinearBn], points: &Tensor<3>, training: bool, frozen: bool) -> Option<Tensor<2>> {
    if frozen {
        return Some(tensors::infer(layers, points.clone(), tensors::SLICE_BYTES));
    }
    // The points get no gradient; `Cube` is every GPU backend of burn's.
    let trains = training && !points.device().is_autodiff();
    if trains { tensors::train::<burn::backend::Cube>(layers, points, tensors::SLICE_BYTES) } else { None }
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
fn on_a_gpu(_: &[LinearBn], _: &Tensor<3>, _: bool, _: bool) -> Option<Tensor<2>> {
    None
}

/// One layer's parameters on the CPU.
#[derive(Clone, Debug)]
struct Parameters {
    weight: FlexTensor,
    gamma: FlexTensor,
    beta: FlexTensor,
    inputs: usize,
    outputs: usize,
    epsilon: f64,
}

impl Parameters {
    fn layer(&self) -> Option<Layer<'_>> {
        Some(Layer {
            inputs: self.inputs,
            outputs: self.outputs,
            weight: self.weight.as_slice()?,
            gamma: self.gamma.as_slice()?,
            beta: self.beta.as_slice()?,
            epsilon: self.epsilon,
        })
    }
}

fn infer(layers: &[LinearBn], points: &FlexTensor, samples: usize, n: usize) -> Option<Tensor<2>> {
    let plain = |tensor: Tensor<1>| tensor.try_into_primitive::<Flex>().ok().map(|t| t.to_contiguous());
    let mut folded = Vec::with_capacity(layers.len());
    for (linear, bn) in layers {
        let [inputs, outputs] = linear.weight.dims();
        let parameters = Parameters {
            weight: linear.weight.val().try_into_primitive::<Flex>().ok()?.to_contiguous(),
            gamma: plain(bn.gamma.val())?,
            beta: plain(bn.beta.val())?,
            inputs,
            outputs,
            epsilon: bn.epsilon,
        };
        let bias = plain(linear.bias.as_ref()?.val())?;
        let (mean, variance) = (plain(bn.running_mean.value())?, plain(bn.running_var.value())?);
        folded.push(Folded::new(&parameters.layer()?, bias.as_slice()?, mean.as_slice()?, variance.as_slice()?));
    }
    let out = forward::infer(&folded, points.as_slice::<f32>()?, samples, n);
    let width = out.len() / samples;
    Some(Tensor::from_primitive::<Flex>(FlexTensor::from_data(TensorData::new(out, [samples, width]))))
}

fn train(layers: &[LinearBn], points: FlexTensor, samples: usize, n: usize) -> Option<Tensor<2>> {
    let mut guards = Vec::with_capacity(PARAMETERS * layers.len());
    let mut parameters = Vec::with_capacity(layers.len());
    for (linear, bn) in layers {
        let [inputs, outputs] = linear.weight.dims();
        let weight = linear.weight.val().try_into_primitive::<Ad>().ok()?.into_parts();
        let [bias, gamma, beta] = [linear.bias.as_ref()?, &bn.gamma, &bn.beta]
            .map(|p| p.val().try_into_primitive::<Ad>().ok().map(|t| t.into_parts()));
        let (bias, gamma, beta) = (bias?, gamma?, beta?);
        guards.extend([weight.1, bias.1, gamma.1, beta.1]);
        let [weight, gamma, beta] = [weight.0, gamma.0, beta.0].map(|t| t.to_contiguous());
        parameters.push(Parameters { weight, gamma, beta, inputs, outputs, epsilon: bn.epsilon });
    }
    let values = points.as_slice::<f32>()?;
    let refs: Vec<_> = parameters.iter().map(Parameters::layer).collect::<Option<_>>()?;
    let saved = forward::train(&refs, values, samples, n);
    for ((linear, bn), norm) in layers.iter().zip(&saved.norms) {
        let device = bn.running_mean.value().device();
        let vector = |v: &[f32]| Tensor::<1>::from_data(TensorData::new(v.to_vec(), [v.len()]), &device);
        // The bias was left out of the products: it shifts the mean and nothing else.
        let mean = vector(&norm.mean) + linear.bias.as_ref()?.val().without_autodiff().to_device(&device);
        blocks::update_statistics(bn, mean, vector(&norm.variance), samples * n);
    }
    let width = parameters[parameters.len() - 1].outputs;
    let out = FlexTensor::from_data(TensorData::new(saved.out.clone(), [samples, width]));
    let state = State(Arc::new(Mutex::new(Some((points, parameters, saved)))));
    // The number of parents is part of the operation's type.
    match layers.len() {
        1 => record::<{ PARAMETERS }>(guards, state, out),
        2 => record::<{ 2 * PARAMETERS }>(guards, state, out),
        3 => record::<{ 3 * PARAMETERS }>(guards, state, out),
        4 => record::<{ 4 * PARAMETERS }>(guards, state, out),
        5 => record::<{ 5 * PARAMETERS }>(guards, state, out),
        6 => record::<{ 6 * PARAMETERS }>(guards, state, out),
        _ => None,
    }
}

/// Weight, bias, gamma, beta.
const PARAMETERS: usize = 4;
/// Layers that [`train`] has a type for; deeper MLPs take the plain layers.
const MOST_LAYERS: usize = 6;

fn record<const N: usize>(guards: Vec<NodeGuard>, state: State, out: FlexTensor) -> Option<Tensor<2>> {
    let guards: [NodeGuard; N] = guards.try_into().ok()?;
    let out = match SharedMlpMax.prepare::<NoCheckpointing>(guards).compute_bound().stateful() {
        OpsKind::Tracked(prepared) => prepared.finish(state, out),
        OpsKind::UnTracked(prepared) => prepared.finish(out),
    };
    Some(Tensor::from_primitive::<Ad>(out))
}

#[derive(Debug)]
struct SharedMlpMax;

/// Taken by the one backward pass, so that buffers are freed as they are used up.
#[derive(Clone)]
struct State(Arc<Mutex<Option<Kept>>>);

/// Points, parameters, and what the forward pass saved.
type Kept = (FlexTensor, Vec<Parameters>, Saved);

impl std::fmt::Debug for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("State")
    }
}

impl<const N: usize> Backward<Flex, N> for SharedMlpMax {
    type State = State;

    fn backward(self, ops: Ops<State, N>, grads: &mut Gradients, _: &mut Checkpointer) {
        let gradient = grads.consume::<Flex>(&ops.node).to_contiguous();
        let taken = ops.state.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        let Some((points, parameters, saved)) = taken else {
            panic!("the graph of a shared MLP was walked twice; run the forward pass again")
        };
        let layers: Option<Vec<_>> = parameters.iter().map(Parameters::layer).collect();
        let (Some(layers), Some(points), Some(gradient)) = (layers, points.as_slice(), gradient.as_slice()) else {
            unreachable!("contiguous f32 tensors, checked in the forward pass")
        };
        let all = backward::backward(&layers, points, saved, gradient);
        let mut nodes = ops.parents.into_iter();
        for (layer, gradients) in layers.iter().zip(all) {
            let (k, c) = (layer.inputs, layer.outputs);
            let vector = |v: Vec<f32>| TensorData::new(v, [c]);
            let of_layer = [
                TensorData::new(gradients.weight, [k, c]),
                vector(vec![0.0; c]),
                vector(gradients.gamma),
                vector(gradients.beta),
            ];
            for (data, node) in of_layer.into_iter().zip(nodes.by_ref()) {
                if let Some(node) = node {
                    grads.register::<Flex>(node.id, FlexTensor::from_data(data));
                }
            }
        }
    }
}
