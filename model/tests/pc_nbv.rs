//! PC-NBV: size, view table, invariances.

mod common;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use model::encode::EncodeConfig;
use model::pc_nbv::{self, VIEWS};
use model::{PcNbvModel, PcNbvNet, PcNbvNetConfig, checkpoint};
use nalgebra::{Point3, Vector3};
use rand::RngExt;
use rand::seq::SliceRandom;
use std::sync::{Mutex, MutexGuard, PoisonError};

fn net() -> PcNbvNet {
    seeded(&PcNbvNetConfig::default(), 5)
}

/// The tests of this file run side by side, and whatever makes a network draws from the one generator: they take turns.
fn alone() -> MutexGuard<'static, ()> {
    static GENERATOR: Mutex<()> = Mutex::new(());
    GENERATOR.lock().unwrap_or_else(PoisonError::into_inner)
}

fn seeded(config: &PcNbvNetConfig, seed: u64) -> PcNbvNet {
    let _alone = alone();
    let device = Device::flex();
    device.seed(seed);
    config.init(&device).materialize()
}

/// With an attention scale other than 0, so that the attention counts.
fn model() -> PcNbvModel {
    let net = net();
    let mut tensors = common::tensors(&net);
    tensors.get_mut("attention.scale").expect("named").1[0] = 0.5;
    let stored = model::published::read_safetensors(&common::to_bytes(&tensors), "test").expect("readable");
    let net = model::published::apply(net, stored, "test").expect("fits");
    PcNbvModel::new(net, checkpoint::Checkpoint::new::<PcNbvNet>(PcNbvNetConfig::default(), EncodeConfig::default()))
}

fn cloud(count: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = geometry::rng::stream(seed, "cloud");
    (0..count).map(|_| Point3::from(Vector3::from_fn(|_, _| rng.random_range(-0.1..0.1)))).collect()
}

fn difference(a: &[f32; VIEWS], b: &[f32; VIEWS]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn it_has_the_published_size() {
    assert_eq!(common::parameter_count(&net()), 3_838_286 + 140 + 140 + 561, "parameters and singular vectors");
    let singular: usize =
        common::parameters(&net()).iter().filter(|(name, _)| name.ends_with("weight_u")).map(|(_, v)| v.len()).sum();
    assert_eq!(singular, 140 + 140 + 561, "buffers, not parameters");
}

#[test]
fn the_views_are_those_of_the_list() {
    let views = pc_nbv::view_directions();
    assert!(views.iter().all(|v| (v.norm() - 1.0).abs() < 1e-12));
    let close = |i: usize, v: [f64; 3]| assert!((views[i] - Vector3::from(v)).norm() < 1e-6, "{i}: {:?}", views[i]);
    close(0, [0.0, 1.0, 0.0]);
    close(1, [0.0, 0.866025, 0.5]);
    close(2, [0.353553, 0.866025, 0.353553]);
    close(12, [0.612372, 0.5, -0.612372]);
    close(19, [1.0, 0.0, 0.0]);
    close(25, [0.0, -0.5, 0.866025]);
    close(32, [-0.612372, -0.5, 0.612372]);
}

#[test]
fn order_translation_and_scale_of_the_cloud_do_not_matter() {
    let model = model();
    let mut state = [0.0; VIEWS];
    state[4] = 1.0;
    let points = cloud(64, 1);
    let gains = model.predict(&points, &state).expect("gains");
    assert!(gains.iter().all(|g| g.is_finite()));
    let mut shuffled = points.clone();
    shuffled.shuffle(&mut geometry::rng::stream(2, "shuffle"));
    let moved: Vec<_> = points.iter().map(|p| Point3::from(p.coords * 8.0 + Vector3::new(3.0, -1.0, 2.0))).collect();
    assert!(difference(&gains, &model.predict(&shuffled, &state).expect("gains")) < 1e-4);
    assert!(difference(&gains, &model.predict(&moved, &state).expect("gains")) < 1e-4);
    assert_eq!(gains, model.predict(&points, &state).expect("gains"), "a prediction changes nothing");
    let other = model.predict(&points, &[0.0; VIEWS]).expect("gains");
    assert!(difference(&gains, &other) > 1e-6, "the state must count");
}

#[test]
fn outputs_are_in_the_unit_of_the_configuration() {
    let gains = |gain_unit: f64| {
        let config = PcNbvNetConfig { gain_unit, ..PcNbvNetConfig::default() };
        let net = seeded(&config, 7);
        let info = checkpoint::Checkpoint::new::<PcNbvNet>(config, EncodeConfig::default());
        PcNbvModel::new(net, info).predict(&cloud(40, 2), &[0.0; VIEWS]).expect("gains")
    };
    let (plain, small) = (gains(1.0), gains(0.05));
    assert!(plain.iter().any(|g| g.abs() > 1e-3));
    assert!(plain.iter().zip(small).all(|(p, s)| (p * 0.05 - s).abs() < 1e-6), "{plain:?} {small:?}");
    let config = PcNbvNetConfig { gain_unit: 0.0, ..PcNbvNetConfig::default() };
    let refused = <PcNbvNet as model::published::Network>::create(&config, &Device::flex());
    assert!(refused.expect_err("no unit").to_string().contains("gain_unit = 0: expected a positive number"));
}

#[test]
fn seventeen_points_and_duplicates_are_enough() {
    let model = model();
    let state = [0.0; VIEWS];
    let points = cloud(17, 3);
    assert!(model.predict(&points, &state).expect("gains").iter().all(|g| g.is_finite()));
    let error = model.predict(&points[..16], &state).expect_err("too few").to_string();
    assert!(error.contains("16 points; PC-NBV needs at least 17"), "{error}");
    let repeated = vec![points[0]; 40];
    assert!(model.predict(&repeated, &state).expect("gains").iter().all(|g| g.is_finite()));
    let mut broken = points;
    broken[3].y = f64::INFINITY;
    assert!(model.predict(&broken, &state).expect_err("infinite").to_string().contains("point 3 is not finite"));
}

#[test]
fn one_step_lowers_the_loss_and_everything_has_a_gradient() {
    let device = Device::flex();
    let mut rng = geometry::rng::stream(4, "train");
    let values: Vec<f32> = (0..3 * 40 * 3).map(|_| rng.random_range(-1.0..1.0)).collect();
    let points = Tensor::<3>::from_data(TensorData::new(values, [3, 40, 3]), &device);
    let state = Tensor::<2>::zeros([3, VIEWS], &device);
    let target = Tensor::<2>::ones([3, VIEWS], &device) * 0.1;
    let mut net = net().train();
    let mut optimizer = burn::optim::AdamWConfig::new().init();
    let mut losses = Vec::new();
    for _ in 0..4 {
        let loss = pc_nbv::gain_loss(net.forward(points.clone(), state.clone()), target.clone());
        losses.push(loss.clone().without_autodiff().into_scalar::<f32>());
        let grads = loss.backward();
        let named = common::gradients(&net, &grads);
        for name in ["extractor.lift.weight", "extractor.blocks.3.conv2.weight", "attention.scale", "output.bias"] {
            assert!(named[name].iter().any(|g| *g != 0.0), "no gradient for {name}");
        }
        let grads = burn::optim::GradientsParams::from_grads(grads, &net);
        net = optimizer.step(1e-3, net, grads);
    }
    assert!(losses[3] < losses[0], "{losses:?}");
}

#[test]
fn checkpoints_come_back() {
    let folder = tempfile::tempdir().expect("temp");
    let directory = folder.path().join("pc-nbv");
    let info = checkpoint::Checkpoint::new::<PcNbvNet>(PcNbvNetConfig::default(), EncodeConfig::default());
    let net = net();
    checkpoint::save(&directory, &net, &info).expect("saved");
    let loaded = {
        let _alone = alone();
        PcNbvModel::load(&directory).expect("loaded")
    };
    let (model, before) = (loaded, PcNbvModel::new(net, info));
    let points = cloud(30, 6);
    let predict = |model: &PcNbvModel| model.predict(&points, &[0.0; VIEWS]).expect("gains");
    assert_eq!(predict(&model), predict(&before), "the same bits");
}
