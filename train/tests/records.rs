//! What a run records of its weights: the figures of a validation beside those that were validated, and no figures of an epoch in
//! which nothing was learnt, nor a success where nothing finite came of it.
#![allow(missing_docs)]

mod common;

use common::{one_at_a_time, plain_set, run_until, sample, tiny_config, write_set};
use formats::Split;
use model::BenbvNetConfig;
use model::checkpoint::description;
use std::collections::BTreeMap;
use std::path::Path;
use train::augment::AugmentConfig;
use train::{BenbvTask, Dataset, Outcome, Run};

/// The validation loss that a checkpoint names, and its step.
fn figures(checkpoint: &Path) -> (u64, Option<String>) {
    let info = description::<BenbvNetConfig>(checkpoint).expect("a description");
    assert_eq!(info.provenance["data"], "a set", "the rest stays");
    (info.step, info.provenance.get("validation_loss").cloned())
}

#[test]
fn a_checkpoint_carries_the_figures_of_its_own_weights_or_none() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let (data, dir) = (tmp.path().join("data"), tmp.path().join("run"));
    plain_set(&data, 9, 2); // 36 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.epochs = 3;
    config.checkpoint.keep_every_epochs = 1;
    let latest = dir.join("latest");
    let loss = |outcome: &Outcome, epoch: usize| Some(format!("{:.4}", outcome.epochs[epoch].valid_loss));
    let first = run_until(&config, &data, &dir, false, 5).expect("trained");
    assert_eq!(figures(&latest), (5, loss(&first, 0)), "stopped after a validation, before a further step");
    run_until(&config, &data, &dir, true, 5).expect("trained");
    assert_eq!(figures(&latest), (5, loss(&first, 0)), "saved again without a further step");
    run_until(&config, &data, &dir, true, 7).expect("trained");
    assert_eq!(figures(&latest), (7, None), "in the middle of an epoch");
    let all = run_until(&config, &data, &dir, true, u64::MAX).expect("trained");
    assert_eq!(figures(&latest), (15, loss(&all, 2)), "the last epoch, whether it is the best or not");
    for epoch in 0..3 {
        let kept = dir.join(format!("epoch-{:04}", epoch + 1));
        assert_eq!(figures(&kept), (5 * (epoch as u64 + 1), loss(&all, epoch)));
    }
    let best = all.epochs.iter().rfind(|e| e.best).expect("a best epoch");
    assert_eq!(figures(&dir.join("best")), (best.step, Some(format!("{:.4}", best.valid_loss))));
}

/// A run that is killed after its last step's save and an epoch's record, before the save of the epoch.
#[test]
fn an_epoch_is_recorded_once_wherever_a_run_was_killed() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let (data, dir) = (tmp.path().join("data"), tmp.path().join("run"));
    plain_set(&data, 9, 2); // 36 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.epochs = 3;
    run_until(&config, &data, &dir, false, 10).expect("trained");
    let latest = dir.join("latest");
    let mut state = train::checkpoint::load_state(&latest).expect("a state");
    assert_eq!((state.step, state.epoch, state.step_in_epoch), (10, 2, 0));
    (state.epoch, state.step_in_epoch, state.loss_sum, state.loss_samples) = (1, 5, 3.6, 36);
    std::fs::write(latest.join("training.toml"), toml::to_string(&state).expect("TOML")).expect("written");
    std::fs::remove_file(latest.join("SHA256SUMS")).expect("removed");
    let all = run_until(&config, &data, &dir, true, u64::MAX).expect("trained");
    assert_eq!(all.epochs.iter().map(|e| (e.epoch, e.step)).collect::<Vec<_>>(), [(0, 5), (1, 10), (2, 15)]);
    let log = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
    assert_eq!(log.matches("\"kind\":\"epoch\"").count(), 3, "{log}");
}

#[test]
fn an_epoch_in_which_nothing_was_learnt_ends_the_run() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let epochs = |dir: &Path| {
        let log = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
        log.lines().filter(|line| line.contains("\"kind\":\"epoch\"")).count()
    };
    // Every sample overflows in f32.
    let data = tmp.path().join("overflowing");
    let mut samples: Vec<_> = (0..8).map(|d| sample("a", d, 8)).collect();
    samples.iter_mut().for_each(|s| s.cloud.points[0].x = 1e30);
    write_set(&data, &[("a", Split::Train, samples), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    let mut config = tiny_config();
    config.batch = 4;
    config.augment = AugmentConfig::none();
    config.input.normalisation = model::encode::Normalisation::AsIs;
    config.network.points = 150; // every point of the cloud, so that the bad one is always seen
    let dir = tmp.path().join("run");
    let text = run_until(&config, &data, &dir, false, u64::MAX).expect_err("nothing learnt").to_string();
    for part in ["not one of the 2 steps of epoch 1", "a lower --lr", "nothing was saved before"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(epochs(&dir), 0, "no zeros are recorded as losses");

    // A rate at which the first step leaves weights that nothing finite comes of.
    let data = tmp.path().join("data");
    plain_set(&data, 9, 2); // 36 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.epochs = 4;
    config.optimizer.learning_rate = 1e30;
    let dir = tmp.path().join("fast");
    let text = run_until(&config, &data, &dir, false, u64::MAX).expect_err("nothing learnt").to_string();
    for part in ["not one of the 5 steps of epoch 2", "kept in", "(now 1e30)"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(epochs(&dir), 1, "only that in which a step was done");

    // The same where that epoch is all there is, and when the run is resumed.
    config.epochs = 1;
    let dir = tmp.path().join("once");
    for resume in [false, true] {
        let text = run_until(&config, &data, &dir, resume, u64::MAX).expect_err("no use").to_string();
        for part in ["not finite in any of 1 epochs", "kept in", "(now 1e30)"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}

/// A run that is killed at any moment has in its log the steps that its checkpoint holds.
#[test]
fn the_log_has_every_step_of_a_checkpoint() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let (data, dir) = (tmp.path().join("data"), tmp.path().join("run"));
    plain_set(&data, 9, 2); // 36 samples, 5 steps an epoch
    let mut config = tiny_config();
    config.epochs = 1;
    config.checkpoint.every_steps = 2;
    let set = Dataset::open(&data, config.validation.fraction, config.seed).expect("a set");
    let saved = std::cell::Cell::new(0);
    let stop = |_: u64| {
        if let Ok(state) = train::checkpoint::load_state(&dir.join("latest")) {
            let log = std::fs::read_to_string(dir.join("log.jsonl")).expect("a log");
            assert!(log.matches("\"kind\":\"step\"").count() as u64 >= state.step, "{} steps: {log}", state.step);
            saved.set(saved.get().max(state.step));
        }
        false
    };
    let run = Run { dir: &dir, resume: false, quiet: true, stop: &stop, provenance: BTreeMap::new() };
    train::train(&BenbvTask::new(&config, &set), &config, &run).expect("trained");
    assert!(saved.get() >= 2, "no save was seen");
}
