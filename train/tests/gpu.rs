//! Training on a GPU: `.ci/gpu`, or
//!
//!     cargo test --workspace --features train/wgpu-untuned --test gpu -- --nocapture
//!
//! Mesa's software driver (lavapipe) serves. Without any driver the tests skip, saying so; with BENBV_NEEDS_GPU set they fail.
#![cfg(feature = "wgpu-untuned")]
#![allow(missing_docs)]

mod common;

use common::{all_numbers, one_at_a_time, plain_set, sample, tiny_config, write_set};
use formats::Split;
use model::encode::Normalisation;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use train::augment::AugmentConfig;
use train::config::TrainConfig;
use train::step::{Group, Step, Work};
use train::{BenbvTask, Dataset, Outcome, Run, Task, learner};

/// The settings for a device, where it is to be had.
fn on(device: &str, config: &TrainConfig) -> Option<TrainConfig> {
    match model::device::open(device) {
        Ok(_) => Some(TrainConfig { device: device.to_owned(), ..config.clone() }),
        Err(error) => {
            assert!(std::env::var_os("BENBV_NEEDS_GPU").is_none(), "{error}");
            println!("skipped: {error}");
            None
        }
    }
}

fn run(config: &TrainConfig, data: &Path, dir: &Path, resume: bool, last: u64) -> Outcome {
    let data = Dataset::open(data, config.validation.fraction, config.seed).expect("a set");
    let stop = |step: u64| step >= last;
    let run = Run { dir, resume, quiet: true, stop: &stop, provenance: BTreeMap::new() };
    train::train(&BenbvTask::new(config, &data), config, &run).expect("trained")
}

/// Losses of the steps, and the messages.
fn log(dir: &Path) -> (Vec<f64>, String) {
    let text = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
    let records: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("a record")).collect();
    let losses = records.iter().filter(|r| r["kind"] == "step").filter_map(|r| r["loss"].as_f64()).collect();
    let messages = records.iter().filter_map(|r| r["text"].as_str()).map(|text| format!("{text}\n")).collect();
    (losses, messages)
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / b.abs()).fold(0.0, f64::max)
}

/// Ten steps and two validations on both devices; then the same on the GPU in three pieces.
#[test]
fn ten_steps_agree_with_the_cpu_and_with_those_of_a_resumed_run() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    plain_set(&data, 10, 2); // 40 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.network.dropout = 0.0;
    config.optimizer.average_decay = 0.8;
    config.optimizer.clip_norm = 0.5;
    let Some(gpu) = on("wgpu", &config) else { return };
    let (a, b, c) = (tmp.path().join("cpu"), tmp.path().join("gpu"), tmp.path().join("pieces"));
    let (cpu, whole) = (run(&config, &data, &a, false, u64::MAX), run(&gpu, &data, &b, false, u64::MAX));
    let ((cpu_losses, _), (losses, messages)) = (log(&a), log(&b));
    println!("losses of ten steps apart {:e}; {messages}", apart(&losses, &cpu_losses));
    assert_eq!(losses.len(), 10);
    assert!(messages.contains("first step on wgpu and on the CPU"), "{messages}");
    assert!(apart(&losses[..1], &cpu_losses[..1]) < 1e-5, "the same weights to begin with: {losses:?} {cpu_losses:?}");
    assert!(apart(&losses, &cpu_losses) < 0.02, "{losses:?} {cpu_losses:?}");
    assert!((whole.epochs[1].valid_loss / cpu.epochs[1].valid_loss - 1.0).abs() < 0.02, "{whole:?} {cpu:?}");

    for (resume, until) in [(false, 3), (true, 7), (true, u64::MAX)] {
        let outcome = run(&gpu, &data, &c, resume, until);
        assert_eq!(outcome.state.step, until.min(10), "a group ends where it is asked to");
    }
    let (resumed, _) = log(&c);
    println!("losses of a resumed run apart {:e}", apart(&resumed, &losses));
    assert!(apart(&resumed, &losses) < 1e-3, "{resumed:?} {losses:?}");
}

/// Weights and average after these steps, and what they came to.
fn after(config: &TrainConfig, data: &Dataset, steps: &[(u64, [usize; 2])]) -> (Vec<f32>, Vec<f32>, Vec<Step>) {
    let (task, device) = (BenbvTask::new(config, data), model::device::open(&config.device).expect("opened before"));
    let mut learner = learner::fresh(&task, config, &device).expect("a network");
    let mut group = Group::new(&learner, true);
    for (step, visits) in steps {
        let work = Work::new::<BenbvTask>(*step, 1e-3, 0.0, vec![task.batch(0, visits).expect("data")]);
        group.push(&task, config, &device, &mut learner, work);
    }
    let came_to = group.finish(&task, config, &device, &mut learner).into_iter().map(|(_, step)| step).collect();
    (all_numbers(&learner.net), learner.average.as_ref().map(all_numbers).unwrap_or_default(), came_to)
}

#[test]
fn a_bad_step_on_the_device_leaves_everything_as_it_was() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let mut samples: Vec<_> = (0..8).map(|d| sample("a", d, 8)).collect();
    samples[5].cloud.points[0].x = 1e30;
    write_set(tmp.path(), &[("a", Split::Train, samples), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    let mut config = tiny_config();
    config.augment = AugmentConfig::none();
    config.input.normalisation = Normalisation::AsIs;
    config.network.points = 150;
    config.network.dropout = 0.0;
    config.optimizer.average_decay = 0.8;
    let Some(gpu) = on("wgpu", &config) else { return };
    let data = Dataset::open(tmp.path(), 0.2, 5).expect("a set");
    let bad = after(&gpu, &data, &[(0, [0, 1]), (1, [4, 5]), (2, [2, 3])]);
    let good = after(&gpu, &data, &[(0, [0, 1]), (2, [2, 3])]);
    assert!(matches!(bad.2[1], Step::Skipped(_)), "{:?}", bad.2);
    let worst = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("after a bad step: weights {:e} apart, average {:e}", worst(&bad.0, &good.0), worst(&bad.1, &good.1));
    assert!(bad.0.iter().chain(&bad.1).all(|x| x.is_finite()));
    // Two steps of Adam at 1e-3; a third would have moved each weight by as much again.
    assert!(worst(&bad.0, &good.0) < 1e-4 && worst(&bad.1, &good.1) < 1e-4);
}

#[test]
fn kill_9_on_a_gpu_loses_no_checkpoint() {
    let _turn = one_at_a_time();
    if on("wgpu", &tiny_config()).is_some() {
        assert_eq!(common::kill::again_and_again("wgpu", 3, 1e-4), 3);
    }
}

/// What cannot be done is an error that says what can be, before anything is written.
#[test]
fn a_device_or_precision_that_cannot_be_had_is_refused_at_the_start() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    if on("wgpu", &tiny_config()).is_none() {
        return;
    }
    let say = |driver: Option<&str>, set: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_train"));
        command.current_dir(tmp.path()).args(["--device", "wgpu", "--data", ".", "--set", set]);
        driver.map(|driver| command.env("VK_DRIVER_FILES", driver).env("VK_ICD_FILENAMES", driver));
        let out = command.output().expect("it starts");
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(!out.status.success() && !text.contains("panicked"), "{text}");
        text
    };
    assert!(say(None, "precision=\"tf32\"").contains("`wgpu` cannot train in tf32"));
    // Without a Vulkan driver there is OpenGL on some machines, and nothing on others.
    let text = say(Some("/nonexistent"), "precision=\"f32\"");
    assert!(text.contains("device `wgpu` does not start") && text.contains("install a Vulkan"), "{text}");
    println!("{text}");
}
