//! What is data to train on: sets of `datagen`, alone and joined, and the authors' files; and what is refused.
#![allow(missing_docs)]

mod common;

use common::{one_at_a_time, plain_set, run, sample, tiny_config, write_set};
use formats::Split;
use formats::frame_history::{Frame, write_frame_history};
use geometry::View;
use nalgebra::Point3;
use std::path::Path;
use train::Dataset;

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
