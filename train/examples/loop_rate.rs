//! How much of the bare training step's rate the whole loop keeps, and how fast the loader is alone.
//!
//! `cargo run --release -p train --example loop_rate -- [batch] [points] [steps] [paper|compact]`
//!
//! Prints samples per second by wall time and CPU seconds per sample (all threads) of the loader alone (one thread),
//! of the bare step (forward, loss, backward, AdamW on the same batch again and again), and of `train::train`
//! (loader, resampling, augmentation, checks, gradient norm, log, page). Clouds have 5,000 points, decisions 20
//! candidates. `tests/reference/train_loop.py` does the same in PyTorch.

mod random_set;

use burn::module::Module;
use burn::optim::{AdamWConfig, GradientsParams};
use cpu_time::ProcessTime;
use std::collections::BTreeMap;
use std::time::Instant;
use train::{BenbvTask, Dataset, Run, Task, TrainConfig};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| arguments.get(i).and_then(|a| a.parse().ok()).unwrap_or(default);
    let (batch, points, steps) = (number(0, 32), number(1, 1024), number(2, 12));
    let preset = arguments.get(3).map_or("paper", String::as_str);

    let folder = tempfile::tempdir()?;
    let tmp = folder.path();
    random_set::write(&tmp.join("data"), batch * steps)?;
    let mut config = TrainConfig { batch, epochs: 1, ..Default::default() };
    config.network = model::BenbvNetConfig::preset(preset).ok_or("expected paper or compact")?;
    config.network.points = points;
    config.episodes.every_epochs = 0;
    config.checkpoint.every_steps = 0;
    config.augment.turn = train::augment::Turn::Any;
    let data = Dataset::open(&tmp.join("data"), 0.2, 0)?;
    let task = BenbvTask::new(&config, &data);

    let visits: Vec<usize> = (0..batch * steps).collect();
    let mut batches = Vec::new();
    let loader =
        measure(batch * steps, || batches.extend(visits.chunks(batch).map(|v| task.batch(0, v).expect("a batch"))));
    print("loader alone, one thread", loader);

    let device = model::device::open("cpu")?;
    let mut net = config.network.init(&device).train();
    let mut optimizer = AdamWConfig::new().with_weight_decay(0.01).with_epsilon(1e-8).init();
    let mut step = |batch: _| {
        let loss = task.loss(&net, &batch, &device);
        let _value: f32 = loss.clone().into_scalar();
        let gradients = GradientsParams::from_grads(loss.backward(), &net);
        net = optimizer.step(1e-3, net.clone(), gradients);
    };
    step(task.batch(0, &visits[..batch]).expect("a batch"));
    let bare = measure(batch * steps, || batches.drain(..).for_each(&mut step));
    print("bare step", bare);

    let dir = tmp.join("run");
    let run = Run { dir: &dir, resume: false, quiet: true, stop: &|_| false, provenance: BTreeMap::new() };
    let whole = measure(batch * steps, || {
        if let Err(e) = train::train(&task, &config, &run) {
            eprintln!("error: {e}");
        }
    });
    // The log times the steps alone: start, validation and saving happen once an epoch, here after a few steps.
    let log = std::fs::read_to_string(dir.join("log.jsonl"))?;
    let records = log.lines().filter_map(|l| serde_json::from_str::<train::watch::Record>(l).ok());
    let (mut seconds, mut waited) = (0.0, 0.0);
    for record in records {
        if let train::watch::Record::Step(s) = record {
            seconds += s.seconds;
            waited += s.wait_seconds;
        }
    }
    print("whole loop with start, validation and saving", whole);
    let rate = (batch * steps) as f64 / seconds;
    println!("whole loop, steps: {rate:.1} samples/s, {:.2} % of it waiting for the loader", 100.0 * waited / seconds);
    println!("whole loop / bare step: {:.3}; loader / bare step, CPU: {:.1}", rate / bare.0, bare.1 / loader.1);
    Ok(())
}

/// Samples per second of wall time, and CPU seconds per sample.
fn measure(samples: usize, work: impl FnOnce()) -> (f64, f64) {
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    work();
    (samples as f64 / wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64() / samples as f64)
}

fn print(what: &str, (rate, cpu): (f64, f64)) {
    println!("{what}: {rate:.1} samples/s, {:.3} ms CPU a sample", 1e3 * cpu);
}
