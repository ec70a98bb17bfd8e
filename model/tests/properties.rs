//! What the network must do whatever its weights: invariances, masks, checkpoints, and the fused operation's agreement
//! with plain layers.

mod common;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use model::encode::{EncodeConfig, Encoded, to_input};
use model::{BenbvNet, BenbvNetConfig, NetInput, checkpoint, position_weighted_loss};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The backend has one generator for the whole process: tests that draw weights or dropout take turns.
fn alone() -> MutexGuard<'static, ()> {
    static GENERATOR: Mutex<()> = Mutex::new(());
    GENERATOR.lock().unwrap_or_else(PoisonError::into_inner)
}

fn net(config: &BenbvNetConfig, seed: u64) -> BenbvNet {
    let device = Device::flex();
    device.seed(seed);
    config.init(&device).materialize()
}

fn sample(points: usize, candidates: usize, rng: &mut impl Rng) -> Encoded {
    let mut numbers = |count: usize| (0..count).map(|_| rng.random_range(-0.1f32..0.1)).collect::<Vec<_>>();
    let (points, normals) = (numbers(3 * points), numbers(3 * points));
    let (targets, directions) = (numbers(3 * candidates), numbers(3 * candidates));
    let density = numbers(candidates).iter().map(|x| 5.0 * (x + 0.1)).collect();
    // One camera to eight, or none.
    let cameras = rng.random_range(0..9);
    let past = (0..3 * candidates * cameras).map(|_| rng.random_range(-1.0f32..1.0)).collect();
    Encoded { points, normals, targets, directions, density, view_order: 3.0, past }
}

/// The tiny network that is told of past cameras.
fn told() -> BenbvNetConfig {
    BenbvNetConfig { past_widths: vec![8, 6], ..BenbvNetConfig::tiny() }
}

fn scores(net: &BenbvNet, batch: &[Encoded], width: usize) -> Vec<f32> {
    let input = to_input(batch, width, &Device::flex()).expect("a valid batch");
    net.forward(input).into_data().try_to_vec().expect("f32")
}

fn close(a: &[f32], b: &[f32], tolerance: f32) {
    assert_eq!(a.len(), b.len());
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        assert!((a - b).abs() < tolerance, "entry {i}: {a} for {b}");
    }
}

fn rows3(values: &[f32], order: &[usize]) -> Vec<f32> {
    order.iter().flat_map(|&i| values[3 * i..3 * i + 3].to_vec()).collect()
}

#[test]
fn order_of_points_does_not_matter() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(1, "properties");
    let net = net(&BenbvNetConfig::tiny(), 1);
    let still = sample(300, 7, &mut rng);
    let mut order: Vec<usize> = (0..300).collect();
    order.shuffle(&mut rng);
    let moved =
        Encoded { points: rows3(&still.points, &order), normals: rows3(&still.normals, &order), ..still.clone() };
    close(&scores(&net, &[moved], 7), &scores(&net, &[still], 7), 1e-6);
}

#[test]
fn candidates_permute_with_their_scores() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(2, "properties");
    let net = net(&BenbvNetConfig::tiny(), 2);
    let still = sample(100, 7, &mut rng);
    let order = [3, 6, 0, 1, 5, 2, 4];
    let moved = Encoded {
        targets: rows3(&still.targets, &order),
        directions: rows3(&still.directions, &order),
        density: order.iter().map(|&i| still.density[i]).collect(),
        ..still.clone()
    };
    let (still, moved) = (scores(&net, &[still], 7), scores(&net, &[moved], 7));
    close(&moved, &order.map(|i| still[i]), 1e-6);
}

#[test]
fn past_cameras_are_a_set_that_may_be_unknown() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(8, "properties");
    let net = net(&told(), 8);
    let unknown = Encoded { past: Vec::new(), ..sample(50, 4, &mut rng) };
    let offset = |candidate: usize, camera: usize, axis: usize| (0.3 * (candidate + 2 * camera + axis) as f32).sin();
    let from = |cameras: &[usize]| {
        let of = |k| cameras.iter().flat_map(move |&v| (0..3).map(move |axis| offset(k, v, axis)));
        Encoded { past: (0..4).flat_map(of).collect(), ..unknown.clone() }
    };
    let alone = |e: &Encoded| scores(&net, std::slice::from_ref(e), 4);
    let three = alone(&from(&[0, 1, 2]));
    close(&alone(&from(&[2, 0, 1, 0])), &three, 1e-6);
    let moved = |other: &[f32]| other.iter().zip(&three).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(moved(&alone(&from(&[0, 1]))) > 1e-4, "a camera fewer is seen");
    assert!(moved(&alone(&unknown)) > 1e-4, "and so is none");
    // Beside others in a batch, and where nobody in the batch knows, the scores are the same.
    let batch = scores(&net, &[unknown.clone(), from(&[0, 1, 2]), from(&[5])], 4);
    close(&batch, &[alone(&unknown), three, alone(&from(&[5]))].concat(), 1e-6);
}

#[test]
fn a_batch_that_knows_no_camera_trains() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(9, "properties");
    let config = BenbvNetConfig { dropout: 0.0, ..told() };
    let batch = [0, 1].map(|_| Encoded { past: Vec::new(), ..sample(50, 4, &mut rng) });
    let (scores, gradients, _) = step(&config, to_input(&batch, 4, &Device::flex()).expect("valid"), 9);
    assert!(scores.iter().all(|s| s.is_finite()));
    let of_past = |name: &&String| name.starts_with("past_feat.");
    assert!(gradients.keys().filter(of_past).all(|name| gradients[name].iter().all(|g| *g == 0.0)));
    assert!(gradients["main_branch.0.0.weight"].iter().any(|g| *g != 0.0));
}

#[test]
fn masking_equals_absence() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(3, "properties");
    let net = net(&told(), 3);
    let batch = [sample(80, 5, &mut rng), sample(80, 8, &mut rng), sample(80, 1, &mut rng)];
    let padded = scores(&net, &batch, 8);
    for (i, one) in batch.iter().enumerate() {
        let k = one.candidates();
        close(&padded[8 * i..8 * i + k], &scores(&net, std::slice::from_ref(one), k), 1e-6);
        assert!(padded[8 * i + k..8 * (i + 1)].iter().all(|s| *s == 0.0), "padding scores nothing");
    }
}

#[test]
fn padding_changes_no_gradient_and_no_statistic() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(4, "properties");
    let config = BenbvNetConfig { dropout: 0.0, ..told() };
    let batch = [sample(60, 4, &mut rng), sample(60, 6, &mut rng)];
    let run = |width: usize| {
        let net = net(&config, 4).train();
        let input = to_input(&batch, width, &Device::flex()).expect("valid");
        let counts = input.counts.clone();
        let target = Tensor::<2>::ones([2, width], &Device::flex()) * 0.3;
        let loss = position_weighted_loss(net.forward(input), target, &counts);
        let grads = loss.backward();
        (common::gradients(&net, &grads), common::parameters(&net))
    };
    let (narrow, wide) = (run(6), run(11));
    for (name, values) in &narrow.0 {
        close(&wide.0[name], values, 1e-5);
    }
    for (name, values) in narrow.1.iter().filter(|(name, _)| name.contains("running_")) {
        close(&wide.1[name], values, 1e-6);
    }
}

/// Gradients and statistics of one training step; the fused operation is bypassed by points that want a gradient.
fn step(config: &BenbvNetConfig, input: NetInput, seed: u64) -> (Vec<f32>, Gradients, Gradients) {
    let net = net(config, seed).train();
    let counts = input.counts.clone();
    let [b, _, k] = input.dims();
    let target = Tensor::<2>::ones([b, k], &Device::flex()) * 0.7;
    let out = net.forward(input);
    let scores = out.clone().without_autodiff().into_data().try_to_vec().expect("f32");
    let grads = position_weighted_loss(out, target, &counts).backward();
    (scores, common::gradients(&net, &grads), common::parameters(&net))
}
type Gradients = std::collections::BTreeMap<String, Vec<f32>>;

#[test]
fn fused_training_agrees_with_plain_layers() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(5, "properties");
    // Odd sizes, several chunks, more samples than pieces, one layer, six layers.
    for (case, (samples, points, widths)) in [
        (3, 77, vec![8, 16, 24]),
        (2, 1500, vec![8, 16, 24]),
        (40, 33, vec![5]),
        (1, 2100, vec![4, 7, 9, 11, 6, 13]),
        (5, 1, vec![8, 16]),
    ]
    .into_iter()
    .enumerate()
    {
        let config = BenbvNetConfig {
            dropout: 0.0,
            position_widths: widths.clone(),
            normal_widths: widths.clone(),
            past_widths: widths,
            ..BenbvNetConfig::tiny()
        };
        let batch: Vec<_> = (0..samples).map(|_| sample(points, 4, &mut rng)).collect();
        let input = to_input(&batch, 4, &Device::flex()).expect("valid");
        let mut plain = input.clone();
        let autodiff = Device::flex().autodiff();
        plain.points = Tensor::from_data(plain.points.into_data(), &autodiff).require_grad();
        plain.normals = Tensor::from_data(plain.normals.into_data(), &autodiff).require_grad();
        if let Some(past) = &mut plain.past {
            past.offsets = Tensor::from_data(past.offsets.clone().into_data(), &autodiff).require_grad();
        }
        let (fused, plain) = (step(&config, input, 9), step(&config, plain, 9));
        close(&fused.0, &plain.0, 1e-5);
        for (name, want) in &plain.1 {
            let norm = want.iter().map(|x| x * x).sum::<f32>().sqrt();
            let error = common::relative_l2(&fused.1[name], want);
            // In front of a batch norm, a bias changes nothing: its gradient is rounding noise.
            let noise = norm < 1e-5 || (name.contains("_feat.") && name.ends_with(".0.bias") && norm < 1e-4);
            assert!(noise || error < 1e-3, "case {case}: gradient {name} off by {error:e} of {norm:e}");
        }
        for (name, want) in plain.2.iter().filter(|(name, _)| name.contains("running_")) {
            close(&fused.2[name], want, 1e-5);
        }
    }
}

#[test]
fn fused_inference_agrees_with_plain_layers() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(6, "properties");
    let mut net = net(&BenbvNetConfig::tiny(), 6).train();
    let batch: Vec<_> = (0..3).map(|_| sample(700, 8, &mut rng)).collect();
    // Statistics other than 0 and 1 first.
    for _ in 0..10 {
        net.forward(to_input(&batch, 8, &Device::flex()).expect("valid"));
    }
    let fused = scores(&net.valid(), &batch, 8);
    // Frozen batch norm on the training device takes the plain layers with running statistics.
    net = net.freeze();
    let plain: Vec<f32> = {
        let input = to_input(&batch, 8, &Device::flex()).expect("valid");
        net.forward(input).without_autodiff().into_data().try_to_vec().expect("f32")
    };
    close(&fused, &plain, 1e-5);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let _alone = alone();
    let mut rng = geometry::rng::stream(7, "properties");
    let config = BenbvNetConfig { dropout: 0.0, ..BenbvNetConfig::tiny() };
    let batch: Vec<_> = (0..4).map(|_| sample(600, 8, &mut rng)).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| step(&config, to_input(&batch, 8, &Device::flex()).expect("valid"), 8))
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.0, three.0);
    assert_eq!(one.1, three.1);
    assert_eq!(one.2, three.2);
}

#[test]
fn checkpoints_come_back_and_replace_each_other() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("temp");
    let directory = folder.path().join("best");
    let config = BenbvNetConfig::tiny();
    let mut info = checkpoint::Checkpoint::new::<BenbvNet>(config.clone(), EncodeConfig::paper());
    info.provenance.insert("data".into(), "spheres".into());
    let mut rng = geometry::rng::stream(9, "properties");
    let batch = [sample(50, 8, &mut rng)];
    for step in [10, 20] {
        info.step = step;
        let net = net(&config, step);
        checkpoint::save_with(&directory, &net, &info, &[("optimizer.bin", &[1, 2])]).expect("saved");
        let (back, read) = checkpoint::load::<BenbvNet>(&directory, &Device::flex()).expect("loaded");
        assert_eq!(read, info);
        assert_eq!(scores(&back, &batch, 8), scores(&net, &batch, 8), "the same bits");
        assert!(directory.join("optimizer.bin").exists());
    }
    let left: Vec<_> =
        std::fs::read_dir(folder.path()).expect("folder").map(|e| e.expect("entry").file_name()).collect();
    assert_eq!(left, ["best"], "nothing else is left behind");
    assert_eq!(checkpoint::kind(&directory).expect("kind"), "benbv-net");
}

#[test]
fn bad_checkpoints_are_explained() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("temp");
    let directory = folder.path().join("run");
    let config = BenbvNetConfig::tiny();
    let info = checkpoint::Checkpoint::new::<BenbvNet>(config.clone(), EncodeConfig::default());
    checkpoint::save(&directory, &net(&config, 1), &info).expect("saved");
    let load = || checkpoint::load::<BenbvNet>(&directory, &Device::flex()).expect_err("bad").to_string();
    // As an older program left it, so that what is edited below is read at all.
    std::fs::remove_file(directory.join(model::sums::SUMS)).expect("removed");
    checkpoint::load::<BenbvNet>(&directory, &Device::flex()).expect("a warning alone");
    let description = directory.join(checkpoint::DESCRIPTION);
    let text = std::fs::read_to_string(&description).expect("text");
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{text}");
        std::fs::write(&description, text.replacen(from, to, 1)).expect("written");
        load()
    };
    assert!(with("schema_version = 1", "schema_version = 9").contains("schema_version = 9: this program reads 1"));
    assert!(with("heads = 4", "heads = 5").contains("heads = 5 must divide attention_width = 16"));
    assert!(with("heads = 4", "hands = 4").contains("unknown field `hands`"));
    let huge = with("trunk_widths = [16, 16, 8]", "trunk_widths = [1000000, 1000000, 8]");
    assert!(huge.contains("[network] asks for more than 1000") && huge.contains("model.safetensors\" holds"), "{huge}");
    assert!(with("[encode]\npoints = ", "[encode]\npoints = 9999999").contains("[encode] points = 9999999"));
    assert!(with("kind = \"benbv-net\"", "kind = \"pc-nbv\"").contains("expected a checkpoint of \"benbv-net\""));
    let misshaped = with("head_width = 8", "head_width = 9");
    assert!(misshaped.contains("misshaped: `score_head.0.weight` is [8, 16], expected [9, 16]"), "{misshaped}");
    let missing = with("position_widths = [8, 16, 24]", "position_widths = [8, 16, 24, 24]");
    assert!(
        missing.contains("missing: `pos_feat.3.0.weight`") && missing.contains("pos_feat.3.1.running_var"),
        "{missing}"
    );
    let unknown = with("position_widths = [8, 16, 24]", "position_widths = [8, 16]");
    assert!(unknown.contains("unknown: `pos_feat.2.0.weight`"), "{unknown}");

    std::fs::write(&description, &text).expect("written");
    let weights = directory.join(checkpoint::WEIGHTS);
    let bytes = std::fs::read(&weights).expect("bytes");
    std::fs::write(&weights, &bytes[..bytes.len() - 9]).expect("written");
    assert!(load().contains("model.safetensors\": not a readable safetensors file"));
    std::fs::remove_file(&weights).expect("removed");
    assert!(load().contains("model.safetensors\": No such file"));
}

#[test]
fn every_flipped_bit_of_a_checkpoint_is_noticed() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("temp");
    let directory = folder.path().join("run");
    let config = BenbvNetConfig::tiny();
    let info = checkpoint::Checkpoint::new::<BenbvNet>(config.clone(), EncodeConfig::default());
    checkpoint::save(&directory, &net(&config, 1), &info).expect("saved");
    let mut rng = geometry::rng::stream(3, "properties");
    for name in [checkpoint::WEIGHTS, checkpoint::DESCRIPTION, model::sums::SUMS] {
        let file = directory.join(name);
        let good = std::fs::read(&file).expect("bytes");
        for _ in 0..200 {
            let (byte, bit) = (rng.random_range(0..good.len()), rng.random_range(0..8));
            let mut bad = good.clone();
            bad[byte] ^= 1 << bit;
            std::fs::write(&file, &bad).expect("written");
            let loaded = checkpoint::load::<BenbvNet>(&directory, &Device::flex());
            let text = loaded.err().unwrap_or_else(|| panic!("{name}: bit {bit} of byte {byte}")).to_string();
            assert!(text.contains(&*directory.to_string_lossy()), "{text}");
        }
        std::fs::write(&file, &good).expect("written");
    }
    checkpoint::load::<BenbvNet>(&directory, &Device::flex()).expect("sound again");
}

#[test]
fn weights_that_are_not_numbers_are_refused() {
    let _alone = alone();
    let net = net(&BenbvNetConfig::tiny(), 1);
    let mut tensors = common::tensors(&net);
    tensors.get_mut("norm1.weight").expect("named").1[2] = f32::NAN;
    let stored = model::published::read_safetensors(&common::to_bytes(&tensors), "w.safetensors").expect("readable");
    let error = model::published::apply(BenbvNetConfig::tiny().init(&Device::flex()), stored, "w.safetensors");
    assert!(error.expect_err("NaN").to_string().contains("not finite: `norm1.weight`"));
}

#[test]
fn half_precision_is_close_and_comes_back() {
    let _alone = alone();
    use model::published::Precision;
    let net = net(&BenbvNetConfig::tiny(), 5);
    let bytes = model::published::to_safetensors(&net, Precision::F16).expect("export");
    let stored = model::published::read_safetensors(&bytes, "half").expect("readable");
    let back = model::published::apply(BenbvNetConfig::tiny().init(&Device::flex()), stored, "half").expect("fits");
    let mut rng = geometry::rng::stream(10, "properties");
    let batch = [sample(64, 8, &mut rng)];
    close(&scores(&back, &batch, 8), &scores(&net, &batch, 8), 1e-2);
    let full = model::published::to_safetensors(&net, Precision::F32).expect("export");
    assert!(bytes.len() < full.len() * 7 / 10, "{} against {}", bytes.len(), full.len());
}
