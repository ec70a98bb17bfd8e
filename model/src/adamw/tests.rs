use super::*;
use crate::BenbvNetConfig;
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::TensorData;
use rand::RngExt;

fn tensor(rng: &mut impl rand::Rng, shape: [usize; 2], device: &Device) -> Tensor<2> {
    let values: Vec<f32> = (0..shape[0] * shape[1]).map(|_| rng.random_range(-1.0..1.0)).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn bits(tensor: &Tensor<2>) -> Vec<u32> {
    tensor.to_data().iter::<f32>().map(f32::to_bits).collect()
}

#[test]
fn weights_and_moments_are_burns_to_the_bit() {
    let device = Device::flex();
    let mut rng = geometry::rng::stream(0, "adamw");
    // Less than a chunk, a few of them and a part.
    for (shape, decay) in [([7, 5], 0.01), ([300, 173], 0.01), ([64, 3], 0.0)] {
        let ours = AdamW::new([0.9, 0.999], 1e-8, decay);
        let mut weights = [tensor(&mut rng, shape, &device), tensor(&mut rng, [1, 1], &device)];
        weights[1] = weights[0].clone();
        assert!(on_cpu(&weights[0]).is_some(), "not burn's twice");
        let mut states = [None, None];
        for step in 0..20 {
            let gradient = tensor(&mut rng, shape, &device) * 10f64.powi(step % 5 - 3);
            let rate = 1e-3 * 0.9f64.powi(step);
            let (ours, burns) = (&ours, &ours.burns);
            let [a, b] = weights;
            let (a, state_a) = ours.step(rate, a, gradient.clone(), states[0].take());
            let (b, state_b) = burns.step(rate, b, gradient, states[1].take());
            assert_eq!(bits(&a), bits(&b), "step {step}");
            (weights, states) = ([a, b], [state_a, state_b]);
        }
        let [a, b] = states.map(|state| state.expect("steps were made").momentum);
        assert_eq!((a.time, b.time), (20, 20));
        assert_eq!([bits(&a.moment_1), bits(&a.moment_2)], [bits(&b.moment_1), bits(&b.moment_2)]);
    }
}

#[test]
fn what_others_hold_stays_as_it_was() {
    let device = Device::flex();
    let mut rng = geometry::rng::stream(0, "adamw held");
    let ours = AdamW::new([0.9, 0.999], 1e-8, 0.01);
    let (weights, gradient) = (tensor(&mut rng, [9, 4], &device), tensor(&mut rng, [9, 4], &device));
    let (weights, state) = ours.step(1e-2, weights, gradient.clone(), None);
    let held = (weights.clone(), state.clone().expect("a step"));
    let before = [bits(&held.0), bits(&held.1.momentum.moment_1), bits(&held.1.momentum.moment_2), bits(&gradient)];
    // Also of a gradient that lies in memory in another order.
    let turned = gradient.clone().transpose().reshape([4, 9]).transpose();
    let (after, _) = ours.step(1e-2, weights.clone(), turned.clone(), state.clone());
    let (burns, _) = ours.burns.step(1e-2, weights, turned, state);
    assert_eq!(bits(&after), bits(&burns));
    assert_ne!(bits(&after), before[0]);
    assert_eq!(
        before,
        [bits(&held.0), bits(&held.1.momentum.moment_1), bits(&held.1.momentum.moment_2), bits(&gradient)]
    );
}

#[test]
fn a_network_learns_as_with_burns_and_its_state_can_be_saved() {
    struct Weights(Vec<u32>);
    impl ModuleVisitor for Weights {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.0.extend(param.val().to_data().iter::<f32>().map(f32::to_bits));
        }
    }
    let device = Device::flex();
    let config = BenbvNetConfig::compact();
    let mut optimizers = [
        AdamW::new([0.9, 0.999], 1e-8, 0.01).init(),
        AdamWConfig::new().with_epsilon(1e-8).with_weight_decay(0.01).init(),
    ];
    let net = config.init(&device).materialize();
    let learned = optimizers.each_mut().map(|optimizer| {
        let mut net = net.clone().train();
        for step in 0..4 {
            let mut squares = Squares(Vec::new());
            net.visit(&mut squares);
            let loss = Tensor::cat(squares.0, 0).sum();
            let gradients = GradientsParams::from_grads(loss.backward(), &net);
            net = optimizer.step(1e-2 / f64::from(step + 1), net, gradients);
        }
        let mut weights = Weights(Vec::new());
        net.visit(&mut weights);
        weights.0
    });
    assert!(learned[0].len() > 10_000 && learned[0] == learned[1]);
}

/// The sum of the fourth powers of each weight that is trained.
struct Squares(Vec<Tensor<1>>);

impl ModuleVisitor for Squares {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let value = param.val();
        if value.is_require_grad() {
            self.0.push((value.clone() * value.clone() * value.clone() * value).sum());
        }
    }
}
