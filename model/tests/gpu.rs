//! CPU and GPU agree. `.ci/gpu`, or
//!
//!     cargo test --workspace --features train/wgpu-untuned --test gpu -- --nocapture
//!
//! Mesa's software driver (lavapipe) serves. Without any driver the tests skip, saying so; with BENBV_NEEDS_GPU set they fail.
#![cfg(feature = "wgpu")]

mod common;

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{AdamWConfig, GradientsParams};
use burn::tensor::{Device, Tensor};
use model::encode::{EncodeConfig, Encoded, to_input};
use model::{BenbvNet, BenbvNetConfig, checkpoint, device, position_weighted_loss};
use rand::{Rng, RngExt};

fn gpu() -> Option<Device> {
    match device::open("wgpu") {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var_os("BENBV_NEEDS_GPU").is_none(), "{error}");
            println!("skipped: {error}");
            None
        }
    }
}

fn sample(points: usize, candidates: usize, rng: &mut impl Rng) -> Encoded {
    let mut numbers = |count: usize| (0..count).map(|_| rng.random_range(-0.1f32..0.1)).collect::<Vec<_>>();
    let (points, normals) = (numbers(3 * points), numbers(3 * points));
    let (targets, directions) = (numbers(3 * candidates), numbers(3 * candidates));
    let density = numbers(candidates).iter().map(|x| 5.0 * (x + 0.1)).collect();
    let past = numbers(3 * candidates * 4);
    Encoded { points, normals, targets, directions, density, view_order: 3.0, past }
}

struct Found {
    /// In evaluation.
    scores: Vec<f32>,
    /// Of training steps.
    losses: Vec<f32>,
    /// Of the first step, per parameter.
    gradients: Vec<Vec<f32>>,
}

/// Scores in evaluation, then ten training steps.
fn run(directory: &std::path::Path, batch: &[Encoded], device: &Device) -> Found {
    let (net, _) = checkpoint::load::<BenbvNet>(directory, device).expect("a checkpoint");
    let input = || to_input(batch, 8, device).expect("a valid batch");
    let scores = net.forward(input()).into_data().convert::<f32>().try_to_vec().expect("f32");
    let mut net = net.train();
    let mut optimizer = AdamWConfig::new().with_weight_decay(0.01).with_epsilon(1e-8).init();
    let (mut losses, mut first) = (Vec::new(), None);
    for _ in 0..10 {
        let input = input();
        let counts = input.counts.clone();
        let target = Tensor::<2>::ones([batch.len(), 8], device) * 0.7;
        let loss = position_weighted_loss(net.forward(input), target, &counts);
        losses.push(loss.clone().without_autodiff().into_scalar::<f32>());
        let gradients = GradientsParams::from_grads(loss.backward(), &net);
        first.get_or_insert_with(|| of_parameters(&net, &gradients));
        net = optimizer.step(1e-3, net, gradients);
    }
    Found { scores, losses, gradients: first.unwrap_or_default() }
}

fn of_parameters(net: &BenbvNet, gradients: &GradientsParams) -> Vec<Vec<f32>> {
    struct Collect<'a>(&'a GradientsParams, Vec<Vec<f32>>);
    impl ModuleVisitor for Collect<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if let Some(gradient) = self.0.get::<D>(param.id) {
                self.1.push(gradient.into_data().iter::<f32>().collect());
            }
        }
    }
    let mut collect = Collect(gradients, Vec::new());
    net.visit(&mut collect);
    collect.1
}

#[test]
fn forward_every_gradient_and_ten_training_steps_agree_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().expect("temp");
    let directory = folder.path().join("net");
    let config = BenbvNetConfig { dropout: 0.0, ..BenbvNetConfig::tiny() };
    let cpu = Device::flex();
    cpu.seed(11);
    let net = config.init(&cpu).materialize();
    checkpoint::save(&directory, &net, &checkpoint::Checkpoint::new::<BenbvNet>(config, EncodeConfig::paper()))
        .expect("written");
    let mut rng = geometry::rng::stream(12, "gpu");
    let batch: Vec<_> = (0..4).map(|_| sample(300, 8, &mut rng)).collect();
    let (a, b) = (run(&directory, &batch, &cpu), run(&directory, &batch, &gpu));
    let worst = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    let forward = worst(&a.scores, &b.scores);
    let losses: Vec<f32> = a.losses.iter().zip(&b.losses).map(|(x, y)| (x - y).abs() / x).collect();
    println!("forward {forward:e}, losses of ten steps {losses:?}");
    assert!(forward < 1e-5, "forward: {forward:e}");
    // Batch statistics amplify rounding: train mode is less exact than evaluation, and Adam divides noise by itself.
    assert!(losses[0] < 1e-5 && losses.iter().all(|apart| *apart < 5e-3), "{:?} {:?}", a.losses, b.losses);
    assert!(a.losses[9] < a.losses[0], "the steps must lower the loss");
    let whole = a.gradients.iter().flatten().map(|x| x * x).sum::<f32>().sqrt();
    assert_eq!(a.gradients.len(), b.gradients.len());
    let apart: Vec<f32> = a.gradients.iter().zip(&b.gradients).map(|(a, b)| worst(a, b) / whole).collect();
    println!("{} gradients, {:e} of the whole apart", apart.len(), apart.iter().copied().fold(0.0, f32::max));
    assert!(apart.len() > 50 && apart.iter().all(|apart| *apart < 1e-4), "{apart:?}");
}

#[test]
fn bundled_weights_answer_alike() {
    let Some(gpu) = gpu() else { return };
    for name in ["benbv-net", "benbv-net-paper-scale"] {
        let directory = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights").join(name);
        let mut rng = geometry::rng::stream(13, "gpu/bundled");
        let batch: Vec<_> = (0..4).map(|_| sample(256, 20, &mut rng)).collect();
        let scores = |device: &Device| {
            let (net, _) = checkpoint::load::<BenbvNet>(&directory, device).expect("shipped weights");
            let input = to_input(&batch, 20, device).expect("a valid batch");
            net.forward(input).into_data().convert::<f32>().try_to_vec::<f32>().expect("f32")
        };
        let (a, b) = (scores(&Device::flex()), scores(&gpu));
        let worst = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        println!("weights/{name} {worst:e}");
        assert!(worst < 1e-5, "{name} {worst:e}");
        let first = |row: &[f32]| (0..row.len()).max_by(|&i, &j| row[i].total_cmp(&row[j]));
        for (a, b) in a.chunks(20).zip(b.chunks(20)) {
            assert_eq!(first(a), first(b), "{a:?} {b:?}");
        }
    }
}
