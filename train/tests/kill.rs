//! A run that is killed again and again ends as one that is left alone.
#![allow(missing_docs)]

mod common;

use geometry::rng::stream;
use rand::RngExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// By `--resume`, or by the same command again.
fn start(data: &Path, out: &Path, resume: bool) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_train"));
    command.arg("--out").arg(out).stdout(Stdio::null()).stderr(Stdio::null());
    if resume {
        command.arg("--resume");
    } else {
        let network = "network={points=32, candidates=8, position_widths=[8], normal_widths=[8], boundary_widths=[8, 8], \
                       context_widths=[4, 4], trunk_widths=[8, 8, 8], attention_width=8, heads=2, head_width=4, dropout=0.1}";
        command.args(["--epochs", "12", "--batch", "4", "--seed", "3", "--set", network]).arg("--data").arg(data);
        command.args(["--set", "checkpoint.every_steps=1", "--set", "episodes.every_epochs=0"]);
        command.args(["--set", "optimizer.average_decay=0.9"]);
    }
    command.spawn().expect("the program starts")
}

#[test]
fn kill_9_at_any_moment_loses_no_checkpoint() {
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    common::plain_set(&data, 4, 1); // 16 samples, 4 steps an epoch, 48 in all, each saved
    let whole = tmp.path().join("whole");
    assert!(start(&data, &whole, false).wait().expect("it ends").success());

    let out = tmp.path().join("killed");
    let latest = out.join("latest");
    let mut rng = stream(1, "test/kill");
    let mut kills = 0;
    let mut last = 0;
    loop {
        let mut child = start(&data, &out, kills % 2 == 1);
        let patience = Instant::now();
        // Let it get at least one step further, then strike at a random moment of the next saves.
        let ended = loop {
            if let Some(status) = child.try_wait().expect("a status") {
                assert!(status.success(), "a run that was not killed must succeed");
                break true;
            }
            let step = train::checkpoint::load_state(&latest).map_or(0, |s| s.step);
            if step > last {
                break false;
            }
            assert!(patience.elapsed() < Duration::from_secs(120), "no step in two minutes");
            std::thread::sleep(Duration::from_millis(2));
        };
        if ended {
            break;
        }
        std::thread::sleep(Duration::from_micros(rng.random_range(0..20_000)));
        child.kill().expect("killed");
        child.wait().expect("reaped");
        kills += 1;
        let state = train::checkpoint::load_state(&latest).expect("the previous checkpoint still loads");
        assert!(state.step > last, "step {} after {last}: progress must not be lost", state.step);
        last = state.step;
        let device = model::device::open("cpu").expect("a CPU");
        model::checkpoint::load::<model::BenbvNet>(&latest, &device).expect("its weights load");
    }
    println!("{kills} kills");
    assert!(kills >= 3, "only {kills} kills: the test did not test");
    let weights = |dir: &Path| std::fs::read(dir.join("latest/model.safetensors")).expect("weights");
    assert_eq!(weights(&whole), weights(&out), "a killed and resumed run must end like one left alone");
    let litter = std::fs::read_dir(&out).expect("a directory").flatten().map(|e| e.file_name());
    let litter: Vec<_> = litter.filter(|n| n.to_string_lossy().ends_with(".partial")).collect();
    assert!(litter.is_empty(), "{litter:?}");
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
    assert!(say(&["--network", "pc-nbv", "--data", "."]).contains("generates its own data"));
    assert!(say(&["--lr", "-1"]).contains("optimizer.learning_rate = -1"));
    assert!(say(&["--resume", "--config", "a.toml"]).contains("cannot be used with"));
    common::plain_set(&tmp.path().join("data"), 2, 1);
    let held = formats::lock::try_lock(&tmp.path().join("held"), formats::lock::LOCK, "another run").expect("free");
    let text = say(&["--data", "data", "--out", "held"]);
    assert!(text.contains("\"held\" is in use") && text.contains("another run"), "{text}");
    drop(held);
    assert!(!tmp.path().join("runs").exists(), "nothing is made by a start that fails");
    let text = say(&["convert", "nothing.pth", "out"]);
    assert!(text.contains("nothing.pth"), "{text}");
}
