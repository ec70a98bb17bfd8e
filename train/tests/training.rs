//! Training as a whole, on synthetic data.
#![allow(missing_docs)]

mod common;

use common::{one_at_a_time, plain_set, run, run_until, sample, tiny_config, write_set};
use formats::Split;
use rand::RngExt;
use std::collections::BTreeMap;
use std::path::Path;
use train::augment::AugmentConfig;
use train::config::TrainConfig;
use train::{BenbvTask, Dataset, Run};

fn weights(dir: &Path) -> Vec<u8> {
    std::fs::read(dir.join("latest/model.safetensors")).expect("weights")
}

#[test]
fn eight_samples_are_learnt_by_heart() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let samples: Vec<_> = (0..8).map(|d| sample("a", d, 8)).collect();
    write_set(tmp.path(), &[("a", Split::Train, samples), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    let mut config = tiny_config();
    config.epochs = 40;
    config.batch = 32;
    config.network.dropout = 0.0;
    config.network.points = 150; // every point of the cloud, every time
    config.augment = AugmentConfig { copies: 79, ..AugmentConfig::none() }; // 80 visits an epoch, all alike
    config.optimizer.learning_rate = 5e-3;
    config.optimizer.weight_decay = 0.0;
    config.schedule.kind = train::schedule::ScheduleKind::Cosine;
    let outcome = run(&config, tmp.path(), &tmp.path().join("run")).expect("trained");
    let (first, last) = (outcome.epochs[0].train_loss, outcome.epochs[39].train_loss);
    println!("loss {first:.4} -> {last:.6}");
    assert!(first > 0.02 && last < 2e-3, "loss {first} -> {last}: eight samples must be learnt by heart");
}

#[test]
fn a_rule_is_found_on_objects_not_seen() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    plain_set(tmp.path(), 24, 6);
    let mut config = tiny_config();
    config.epochs = 30;
    config.optimizer.learning_rate = 4e-3;
    config.optimizer.average_decay = 0.9;
    let dir = tmp.path().join("run");
    let outcome = run(&config, tmp.path(), &dir).expect("trained");
    let best = outcome.epochs.iter().rfind(|e| e.best).expect("a best epoch");
    println!(
        "relative regret {:.3}, rank correlation {:.3}",
        best.valid.relative_regret(),
        best.valid.rank_correlation
    );
    assert!(best.valid.relative_regret() < 0.35 && best.valid.rank_correlation > 0.6, "{best:?}");
    for file in ["best/model.safetensors", "best/checkpoint.toml", "latest/training.toml", "log.jsonl", "index.html"] {
        assert!(dir.join(file).exists(), "{file} is missing");
    }
    assert!(std::fs::read_dir(dir.join("tensorboard")).expect("a directory").count() == 1);
    let page = std::fs::read_to_string(dir.join("index.html")).expect("a page");
    assert!(page.contains("<svg") && !page.contains("http-equiv"), "the page of an ended run has curves and rests");
}

/// Dropout, moving average, accumulation, clipping, warm-up and plateau all on; stopped in the middle of an epoch.
#[test]
fn a_resumed_run_equals_an_uninterrupted_one_bit_for_bit() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    plain_set(&data, 9, 2); // 36 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.epochs = 3;
    config.accumulation = 2;
    config.optimizer.clip_norm = 0.05;
    config.optimizer.average_decay = 0.8;
    config.schedule.warmup_steps = 3;
    config.schedule.patience = 0;
    let whole = tmp.path().join("whole");
    let all = run(&config, &data, &whole).expect("trained");
    assert_eq!((all.finished, all.state.step), (true, 15));

    let parts = tmp.path().join("parts");
    for (resume, until) in [(false, 3), (true, 7), (true, 10), (true, u64::MAX)] {
        let outcome = run_until(&config, &data, &parts, resume, until).expect("trained");
        assert_eq!(outcome.finished, until == u64::MAX);
        assert_eq!(outcome.state.step, until.min(15));
    }
    assert_eq!(weights(&whole), weights(&parts), "resumed weights must equal uninterrupted ones");
    let mut other = TrainConfig { loader: train::config::LoaderConfig { workers: 3, ready: 1 }, ..config.clone() };
    let threads = tmp.path().join("threads");
    run(&other, &data, &threads).expect("trained");
    assert_eq!(weights(&whole), weights(&threads), "loader threads must change nothing");

    other.optimizer.learning_rate = 0.5;
    let text = run_until(&other, &data, &parts, true, u64::MAX).expect_err("other settings").to_string();
    assert!(text.contains("different settings"), "{text}");
    let log = std::fs::read_to_string(parts.join("log.jsonl")).expect("a log");
    let steps = log.lines().filter(|l| l.contains("\"kind\":\"step\"")).count();
    assert_eq!(steps, 15, "each step once in the log of a resumed run");
}

#[test]
fn bad_samples_are_left_out_and_said() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    let mut samples: Vec<_> = (0..12).map(|d| sample("a", d, 8)).collect();
    samples[0].cloud.points[3].x = f64::NAN;
    samples[1].scores[2] = f64::NAN;
    samples[2].candidates.clear();
    samples[2].scores.clear();
    samples[2].coverage.clear();
    samples[2].overlap.clear();
    samples[3].scores = vec![0.5; 8]; // constant: no order, but a target like any other
    samples[4].candidates[0].density = f64::INFINITY;
    let mut poisoned = sample("b", 1, 8);
    poisoned.scores[2] = f64::NAN;
    let bad_only = vec![samples[0].clone(), samples[1].clone()];
    write_set(
        &data,
        &[("a", Split::Train, samples.clone()), ("b", Split::Validation, vec![sample("b", 0, 8), poisoned])],
    );
    let mut config = tiny_config();
    config.epochs = 1;
    config.batch = 6;
    let dir = tmp.path().join("run");
    let outcome = run(&config, &data, &dir).expect("trained in spite of them");
    assert_eq!(outcome.epochs[0].valid.decisions, 1, "a validation sample without truth is left out");
    assert!(outcome.epochs[0].train_loss.is_finite());
    let log = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
    for reason in [
        "a decision 0: point 3 is not finite",
        "a decision 1: score 2 is NaN",
        "no candidate view",
        "a decision 4: candidate 0",
    ] {
        assert!(log.contains(reason), "{reason:?} must be said in\n{log}");
    }
    assert!(!String::from_utf8_lossy(&weights(&dir)).is_empty());

    // Nothing but bad samples: refused before training starts.
    let hopeless = tmp.path().join("hopeless");
    write_set(&hopeless, &[("a", Split::Train, bad_only), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    config.epochs = 30;
    let text = run(&config, &hopeless, &tmp.path().join("run2")).expect_err("nothing to learn from").to_string();
    assert!(text.contains("not one of 2 training samples can be used: a decision 0: point 3"), "{text}");
    assert!(!tmp.path().join("run2").exists(), "nothing is made by a start that fails");
}

#[test]
fn a_loss_that_overflows_changes_nothing() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    let mut samples: Vec<_> = (0..8).map(|d| sample("a", d, 8)).collect();
    // Finite, so the encoder lets it pass under `as_is`; its square is not, in the network's f32.
    samples[5].cloud.points[0].x = 1e30;
    write_set(&data, &[("a", Split::Train, samples), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    let mut config = tiny_config();
    config.epochs = 4;
    config.batch = 2;
    config.augment = AugmentConfig::none();
    config.input.normalisation = model::encode::Normalisation::AsIs;
    config.network.points = 150; // every point of the cloud, so that the bad one is always seen
    let dir = tmp.path().join("run");
    let outcome = run(&config, &data, &dir).expect("survived");
    let log = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
    let skipped = log.matches("did not change the weights").count();
    assert_eq!(skipped, 4, "one step an epoch holds the sample:\n{log}");
    assert!(
        outcome.epochs.iter().all(|e| e.train_loss.is_finite() && e.valid_loss.is_finite()),
        "{:?}",
        outcome.epochs
    );
}

#[test]
fn every_flipped_bit_of_a_run_is_noticed() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let (data, dir) = (tmp.path().join("data"), tmp.path().join("run"));
    plain_set(&data, 2, 1);
    let mut config = tiny_config();
    config.optimizer.average_decay = 0.9;
    run_until(&config, &data, &dir, false, 1).expect("begun");
    let set = Dataset::open(&data, 0.2, config.seed).expect("opened");
    let task = BenbvTask::new(&config, &set);
    let resume = || {
        let stop = |_| true;
        let run = Run { dir: &dir, resume: true, quiet: true, stop: &stop, provenance: BTreeMap::new() };
        train::train(&task, &config, &run)
    };
    let mut rng = geometry::rng::stream(4, "test/flips");
    for name in ["training.bpk", "optimizer.bpk", "average.bpk", "training.toml", "SHA256SUMS"] {
        let file = dir.join("latest").join(name);
        for _ in 0..200 {
            let good = std::fs::read(&file).expect("bytes");
            let (byte, bit) = (rng.random_range(0..good.len()), rng.random_range(0..8));
            let mut bad = good.clone();
            bad[byte] ^= 1 << bit;
            std::fs::write(&file, &bad).expect("written");
            match resume() {
                Err(error) => {
                    assert!(error.to_string().contains("latest"), "{error}");
                    std::fs::write(&file, &good).expect("written");
                }
                // On the lines of the weights for others, which a resumption does not read, but writes anew.
                Ok(_) => assert_eq!(name, "SHA256SUMS", "bit {bit} of byte {byte} was not noticed"),
            }
        }
    }
    resume().expect("sound again");
}
