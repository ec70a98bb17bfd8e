//! A run that is killed again and again ends as one that is left alone.
#![allow(missing_docs)]

mod common;

use std::process::Command;

#[test]
fn kill_9_at_any_moment_loses_no_checkpoint() {
    let kills = common::kill::again_and_again("cpu", usize::MAX, 0.0);
    assert!(kills >= 3, "only {kills} kills: the test did not test");
}

#[test]
fn wrong_use_is_explained() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let say = |arguments: &[&str]| {
        let out = Command::new(env!("CARGO_BIN_EXE_train")).current_dir(tmp.path()).args(arguments).output();
        let out = out.expect("it starts");
        assert!(!out.status.success(), "{arguments:?} must fail");
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    assert!(say(&[]).contains("no data set in \"runs/data\"; make a data set with `datagen`"));
    assert!(say(&["--resume"]).contains("no run to resume"));
    assert!(say(&["--set", "optimizer.rat=1"]).contains("unknown field `rat`"));
    assert!(say(&["--batch", "0"]).contains("setting batch = 0: expected at least 1"));
    assert!(say(&["--device", "abacus", "--data", "."]).contains("abacus"));
    assert!(say(&["--data", "."]).contains("no data in it"));
    std::fs::create_dir_all(tmp.path().join("begun/shards")).expect("made");
    let text = say(&["--data", "begun"]);
    assert!(text.contains("no manifest.json") && text.contains("run the same `datagen` command again"), "{text}");
    assert!(say(&["--network", "pc-nbv", "--data", "."]).contains("generates its own data"));
    let text = say(&["--network", "pc-nbv", "--set", "pc_nbv.points=16"]);
    assert!(
        text.contains("setting pc_nbv.points = 16: expected at least 17") && !text.contains("simulating"),
        "{text}"
    );
    assert!(say(&["--lr", "-1"]).contains("optimizer.learning_rate = -1"));
    assert!(say(&["--resume", "--config", "a.toml"]).contains("cannot be used with"));
    common::plain_set(&tmp.path().join("data"), 2, 1);
    let held = formats::lock::try_lock(&tmp.path().join("held"), formats::lock::LOCK, "another run").expect("free");
    let text = say(&["--data", "data", "--out", "held"]);
    assert!(text.contains("\"held\" is in use") && text.contains("another run"), "{text}");
    drop(held);
    assert!(!tmp.path().join("runs").exists(), "nothing is made by a start that fails");
    let text = say(&["convert", "nothing.pth", "out"]);
    assert!(text.contains("nothing.pth\": there is no such file or directory"), "{text}");
    // The output of another program is left as it is, lock and all.
    let entries = |name: &str| std::fs::read_dir(tmp.path().join(name)).expect("a directory").count();
    let before = entries("data");
    let text = say(&["--data", "data", "--out", "data"]);
    assert!(text.contains("\"data\" contains a data set of `datagen` (manifest.json)"), "{text}");
    std::fs::create_dir(tmp.path().join("study")).expect("made");
    std::fs::write(tmp.path().join("study/journal.jsonl"), "").expect("written");
    let text = say(&["--data", "data", "--out", "study"]);
    assert!(text.contains("a run of `evaluate` (journal.jsonl)") && text.contains("give another --out"), "{text}");
    assert_eq!((entries("data"), entries("study")), (before, 1));
    // Flags without effect: exit code 2.
    std::fs::create_dir(tmp.path().join("weights")).expect("made");
    let text = say(&["convert", "weights", "out", "--set", "network.points=8"]);
    assert!(text.contains("--set has no effect: \"weights\" is read as a checkpoint"), "{text}");
}
