//! The Rust side of `tests/reference/bench.py`: one forward pass or training step of the published network per line
//! of input, each answered by wall seconds, CPU seconds and peak memory in MiB.
//!
//!     cargo run --release -p model --example bench -- forward 1 4096

use burn::module::Module;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use cpu_time::ProcessTime;
use model::{AdamW, BenbvNetConfig, NetInput, position_weighted_loss};
use rand::RngExt;
use std::io::{BufRead, Write};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, batch, points] = arguments.as_slice() else {
        return Err("usage: bench forward|train BATCH POINTS".into());
    };
    let (batch, points): (usize, usize) = (batch.parse()?, points.parse()?);
    let device = Device::flex();
    device.seed(0);
    let mut net = BenbvNetConfig::paper().init(&device).materialize();
    let mut rng = geometry::rng::stream(0, "bench");
    let mut random = |shape: &[usize]| {
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| rng.random_range(-1.0..1.0)).collect();
        TensorData::new(values, shape.to_vec())
    };
    let mut cube = |rows| Tensor::<3>::from_data(random(&[batch, rows, 3]), &device);
    let (cloud, normals, targets, directions) = (cube(points), cube(points), cube(20), cube(20));
    let mut table = |columns| Tensor::<2>::from_data(random(&[batch, columns]), &device);
    let (density, view_order, target) = (table(20), table(1), table(20));
    let counts = vec![20; batch];
    let input = NetInput {
        points: cloud,
        normals,
        targets,
        directions,
        density,
        view_order,
        past: None,
        counts: counts.clone(),
    };

    let training = mode == "train";
    let mut optimizer = AdamW::new([0.9, 0.999], 1e-8, 0.01).init();
    if training {
        net = net.train();
    }
    let mut once = move || -> f32 {
        let scores = net.forward(input.clone());
        if !training {
            return scores.sum().into_scalar();
        }
        let loss = position_weighted_loss(scores, target.clone(), &counts);
        let value = loss.clone().into_scalar();
        let grads = GradientsParams::from_grads(loss.backward(), &net);
        net = optimizer.step(1e-3, net.clone(), grads);
        value
    };
    for line in std::io::stdin().lock().lines() {
        line?;
        let (wall, cpu) = (Instant::now(), ProcessTime::now());
        let value = once();
        let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64());
        if !value.is_finite() {
            return Err(format!("diverged: {value}").into());
        }
        println!("{wall} {cpu} {}", peak_memory()?);
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn peak_memory() -> Result<f64, Box<dyn std::error::Error>> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).ok_or("no VmHWM")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse::<f64>()? / 1024.0)
}
