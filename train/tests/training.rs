//! Training as a whole, on synthetic data.
#![allow(missing_docs)]

mod common;

use common::{one_at_a_time, plain_set, sample, tiny_config, write_set};
use formats::Split;
use formats::frame_history::{Frame, write_frame_history};
use geometry::View;
use nalgebra::Point3;
use rand::RngExt;
use std::collections::BTreeMap;
use std::path::Path;
use train::augment::AugmentConfig;
use train::config::TrainConfig;
use train::{BenbvTask, Dataset, Outcome, Run, TrainError};

fn run_until(config: &TrainConfig, data: &Path, dir: &Path, resume: bool, last: u64) -> Result<Outcome, TrainError> {
    let data = Dataset::open(data, config.validation.fraction, config.seed)?;
    let stop = |step: u64| step >= last;
    let run = Run { dir, resume, quiet: true, stop: &stop, provenance: BTreeMap::new() };
    train::train(&BenbvTask::new(config, &data), config, &run)
}

fn run(config: &TrainConfig, data: &Path, dir: &Path) -> Result<Outcome, TrainError> {
    run_until(config, data, dir, false, u64::MAX)
}

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
fn the_authors_files_train_as_well() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    for name in ["a", "b", "c"] {
        let frames: Vec<Frame> = (0..3)
            .map(|d| {
                let s = sample(name, d, 20);
                let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.2) };
                let candidates = s.candidates.iter().map(|c| c.view).collect();
                Frame { cloud: s.cloud, current: view, next: view, candidates, scores: s.scores }
            })
            .collect();
        write_frame_history(&data.join(format!("{name}.bin")), &frames).expect("written");
    }
    let set = Dataset::open(&data, 0.34, 1).expect("opened");
    assert_eq!((set.num_train(), set.num_validation()), (6, 3), "split by object, never by frame");
    let outcome = run(&tiny_config(), &data, &tmp.path().join("run")).expect("trained");
    assert!(outcome.finished && outcome.epochs[1].valid.decisions == 3);
}

fn one_history_cannot_be_split(history: &Path) {
    let frames = formats::frame_history::read_frame_history(history).expect("a frame history");
    assert_eq!(frames.len(), 3);
    let text = Dataset::open(history, 0.2, 1).expect_err("one object cannot be split").to_string();
    assert!(text.contains("at least two usable objects"), "{text}");
}

#[test]
fn an_independently_written_frame_history_is_data() {
    let recorded = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/frame_history.bin"));
    one_history_cannot_be_split(recorded);
    let tmp = tempfile::tempdir().expect("temp dir");
    for name in ["a.bin", "b.bin"] {
        std::fs::copy(recorded, tmp.path().join(name)).expect("copied");
    }
    let set = Dataset::open(tmp.path(), 0.5, 1).expect("opened");
    assert_eq!((set.num_train(), set.num_validation()), (3, 3));
    let (mut sizes, frames) = (Vec::new(), formats::frame_history::read_frame_history(recorded).expect("read"));
    for i in 0..3 {
        let sample = set.train_sample(i).expect("read");
        sizes.push(sample.cloud.len());
        assert_eq!(sample.scores.len(), 20);
        assert_eq!(
            sample.cameras.len(),
            sample.scan_index + 1,
            "the cameras of all scans so far, as in an imported set"
        );
        let best = |scores: &[f64]| (0..20).max_by(|&a, &b| scores[a].total_cmp(&scores[b]));
        assert_eq!(best(&sample.scores), best(&frames[sample.scan_index].scores));
    }
    sizes.sort_unstable();
    assert_eq!(sizes, [61, 70, 83]);
    // Another camera is other data.
    let mut moved = frames;
    moved[0].current.position.x += 0.1;
    write_frame_history(&tmp.path().join("a.bin"), &moved).expect("written");
    let other = Dataset::open(tmp.path(), 0.5, 1).expect("opened");
    assert_ne!(other.name(), set.name());
}

#[test]
fn bonus_the_published_frame_history_is_data() {
    let golden =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/golden/h_frame_history_teapot_3scans.bin"));
    if golden.exists() {
        one_history_cannot_be_split(golden);
    } else {
        println!("bonus test skipped: the published frame history is not beside this checkout");
    }
}

#[test]
fn several_sets_are_joined() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let (first, second) = (tmp.path().join("first"), tmp.path().join("second"));
    plain_set(&first, 3, 1);
    let samples = (0..5).map(|i| sample("other", i, 8)).collect();
    write_set(&second, &[("other", Split::Train, samples), ("held", Split::Validation, vec![sample("held", 0, 8)])]);
    let alone = Dataset::open(&first, 0.2, 1).expect("opened");
    let both = Dataset::open_all(&[first, second.clone()], 0.2, 1).expect("opened");
    assert_eq!(both.num_train(), alone.num_train() + 5);
    assert_eq!(both.num_validation(), alone.num_validation() + 1);
    for i in 0..alone.num_train() {
        assert_eq!(both.train_sample(i).expect("read"), alone.train_sample(i).expect("read"));
    }
    let added = |i| both.train_sample(alone.num_train() + i).expect("read");
    assert!((0..5).all(|i| added(i).object == "other" && added(i).scan_index == i));
    assert_eq!(both.validation_sample(alone.num_validation()).expect("read").object, "held");
    assert!(both.name().starts_with(&format!("{} + ", alone.name())), "{}", both.name());
    let text =
        Dataset::open_all(&[second, tmp.path().join("none")], 0.2, 1).expect_err("the second is none").to_string();
    assert!(text.contains("none"), "{text}");
}

#[test]
fn shards_of_another_set_and_held_out_objects_are_refused() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let (first, second) = (tmp.path().join("first"), tmp.path().join("second"));
    let held = vec![sample("held", 0, 8)];
    write_set(&first, &[("a", Split::Train, vec![sample("a", 0, 8)]), ("held", Split::Validation, held.clone())]);
    let renamed = |name: &str| vec![sample(name, 0, 8)];
    write_set(&second, &[("held", Split::Train, renamed("held")), ("b", Split::Validation, renamed("b"))]);
    let text = Dataset::open_all(&[first.clone(), second.clone()], 0.2, 1).expect_err("held out").to_string();
    assert!(text.contains("\"held\" of synthetic is for validation here and for training in"), "{text}");
    let text = Dataset::open_all(&[first.clone(), first.join(".")], 0.2, 1).expect_err("twice").to_string();
    assert!(text.contains("the same set as"), "{text}");

    // The shard of another seed, of other settings, or with other samples.
    let good = std::fs::read(first.join("a.safetensors")).expect("bytes");
    let shard = |edit: &dyn Fn(&mut formats::ShardMetadata)| {
        let reader = formats::ShardReader::open(&first.join("a.safetensors")).expect("opened");
        let mut metadata = reader.metadata().clone();
        edit(&mut metadata);
        let mut writer = formats::ShardWriter::new(metadata, formats::CloudPrecision::F32);
        writer.push(&reader.sample(0).expect("read")).expect("pushed");
        writer.write(&first.join("a.safetensors")).expect("written");
        let text = Dataset::open(&first, 0.2, 1).expect_err("another set's").to_string();
        assert!(text.contains("a.safetensors") && text.contains("another set"), "{text}");
        std::fs::write(first.join("a.safetensors"), &good).expect("written");
    };
    shard(&|m| m.seed = 8);
    shard(&|m| m.config_hash = "other".into());
    shard(&|m| m.objects[0].split = Split::Validation);
    Dataset::open(&first, 0.2, 1).expect("as it was");
    let mut bad = good.clone();
    bad[good.len() / 2] ^= 1;
    std::fs::write(first.join("a.safetensors"), &bad).expect("written");
    let text = Dataset::open(&first, 0.2, 1).expect_err("damaged").to_string();
    assert!(text.contains("damaged") && text.contains("a.safetensors"), "{text}");
}

/// Says in an object's shard which mesh it was made from.
fn note_mesh(set: &Path, object: &str, mesh: &str) {
    let path = set.join(format!("{object}.safetensors"));
    let reader = formats::ShardReader::open(&path).expect("opened");
    let metadata = formats::ShardMetadata { mesh: mesh.into(), ..reader.metadata().clone() };
    let mut writer = formats::ShardWriter::new(metadata, formats::CloudPrecision::F32);
    (0..reader.len()).for_each(|i| writer.push(&reader.sample(i).expect("read")).expect("pushed"));
    writer.write(&path).expect("written");
}

#[test]
fn objects_of_joined_sets_are_told_apart_by_their_meshes_and_skipped_ones_do_not_count() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let (first, second) = (tmp.path().join("first"), tmp.path().join("second"));
    let one = |name: &str| vec![sample(name, 0, 8)];
    write_set(&first, &[("a", Split::Train, one("a")), ("held", Split::Validation, one("held"))]);
    let objects =
        [("held", Split::Train, one("held")), ("b", Split::Train, one("b")), ("c", Split::Validation, one("c"))];
    write_set(&second, &objects);
    let open = || Dataset::open_all(&[first.clone(), second.clone()], 0.2, 1).map_err(|error| error.to_string());
    let text = open().expect_err("nothing is known of the meshes");
    assert!(text.contains("make the sets with the same objects, seed and validation_share"), "{text}");
    note_mesh(&first, "held", "0123456789abcdef");
    open().expect_err("one of them is known");
    note_mesh(&second, "held", "0123456789abcdee");
    open().expect("other objects of one name");
    note_mesh(&second, "b", "0123456789abcdef");
    let text = open().expect_err("the same mesh by another name");
    assert!(text.contains("\"held\" of synthetic is for validation here and for training as \"b\" of"), "{text}");

    // What was skipped is not trained on.
    write_set(&second, &objects);
    let mut manifest = formats::Manifest::read(&second).expect("a manifest");
    manifest.objects[0].status = formats::ObjectStatus::Skipped { reason: "no area".into() };
    manifest.write(&second).expect("written");
    assert_eq!(open().expect("only skipped there").num_train(), 2);
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

#[test]
fn unusable_data_is_explained() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let text = Dataset::open(tmp.path(), 0.2, 1).expect_err("an empty directory").to_string();
    assert!(text.contains("no data in it") && text.contains("datagen"), "{text}");
    let text = train::data::newest_set(tmp.path()).expect_err("no set").to_string();
    assert!(text.contains("no data set in") && text.contains("datagen --dataset"), "{text}");
    plain_set(&tmp.path().join("old"), 2, 1);
    std::thread::sleep(std::time::Duration::from_millis(20));
    plain_set(&tmp.path().join("new"), 2, 1);
    assert_eq!(train::data::newest_set(tmp.path()).expect("two sets"), tmp.path().join("new"));
    let mut manifest = formats::Manifest::read(&tmp.path().join("new")).expect("a manifest");
    manifest.objects[0].status = formats::ObjectStatus::Missing;
    manifest.write(&tmp.path().join("new")).expect("written");
    assert_eq!(
        train::data::newest_set(tmp.path()).expect("one set"),
        tmp.path().join("old"),
        "unfinished: passed over"
    );
    let halves = tmp.path().join("halves");
    write_set(&halves.join("test"), &[("x", Split::Test, vec![sample("x", 0, 8)])]);
    let text = train::data::newest_set(&halves).expect_err("a test half").to_string();
    assert!(text.contains("without training objects") && text.contains("halves/test"), "{text}");
    plain_set(&halves.join("train"), 2, 1);
    std::thread::sleep(std::time::Duration::from_millis(20));
    write_set(&halves.join("test"), &[("x", Split::Test, vec![sample("x", 0, 8)])]);
    assert_eq!(train::data::newest_set(&halves).expect("one to train on"), halves.join("train"));
    let text = Dataset::open(&tmp.path().join("new"), 0.2, 1).expect_err("unfinished").to_string();
    assert!(text.contains("1 of 3 objects are missing"), "{text}");
}
