//! Runs of the program that are killed.

use super::{all_numbers, plain_set};
use geometry::rng::stream;
use rand::RngExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use train::checkpoint::load_state;

/// By `--resume`, or by the same command again.
fn start(device: &str, data: &Path, out: &Path, resume: bool) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_train"));
    command.arg("--out").arg(out).stdout(Stdio::null()).stderr(Stdio::null());
    if resume {
        command.arg("--resume");
    } else {
        let network = "network={points=32, candidates=8, position_widths=[8], normal_widths=[8], boundary_widths=[8, 8], \
                       context_widths=[4, 4], trunk_widths=[8, 8, 8], attention_width=8, heads=2, head_width=4, dropout=0.1}";
        command.args(["--epochs", "12", "--batch", "4", "--seed", "3", "--set", network]).arg("--data").arg(data);
        command.args(["--set", "checkpoint.every_steps=1", "--set", "episodes.every_epochs=0"]);
        command.args(["--set", "optimizer.average_decay=0.9", "--device", device]);
    }
    command.spawn().expect("the program starts")
}

/// Kills a run at random moments, `most` times or until it has ended, and holds its weights against those of a run that is left
/// alone: none may be further off than `apart`, and none at all where that is 0. Returns how often it was killed.
pub fn again_and_again(device: &str, most: usize, apart: f32) -> usize {
    let tmp = tempfile::tempdir().expect("temp dir");
    let data = tmp.path().join("data");
    plain_set(&data, 4, 1); // 16 samples, 4 steps an epoch, 48 in all, each saved
    let whole = tmp.path().join("whole");
    assert!(start(device, &data, &whole, false).wait().expect("it ends").success());

    let out = tmp.path().join("killed");
    let latest = out.join("latest");
    let mut rng = stream(1, "test/kill");
    let (mut kills, mut last) = (0, 0);
    loop {
        let mut child = start(device, &data, &out, kills % 2 == 1);
        if kills == most {
            assert!(child.wait().expect("it ends").success(), "a run that was not killed must succeed");
            break;
        }
        let patience = Instant::now();
        // Let it get at least one step further, then strike at a random moment of the next saves.
        let ended = loop {
            if let Some(status) = child.try_wait().expect("a status") {
                assert!(status.success(), "a run that was not killed must succeed");
                break true;
            }
            let step = load_state(&latest).map_or(0, |s| s.step);
            if step > last {
                break false;
            }
            assert!(patience.elapsed() < Duration::from_secs(240), "no step in four minutes");
            std::thread::sleep(Duration::from_millis(2));
        };
        if ended {
            break;
        }
        std::thread::sleep(Duration::from_micros(rng.random_range(0..20_000)));
        child.kill().expect("killed");
        child.wait().expect("reaped");
        kills += 1;
        let state = load_state(&latest).expect("the previous checkpoint still loads");
        assert!(state.step > last, "step {} after {last}: progress must not be lost", state.step);
        last = state.step;
        weights(&latest);
    }
    let (a, b) = (weights(&whole.join("latest")), weights(&out.join("latest")));
    let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("{kills} kills, the last at step {last}; weights {worst:e} apart");
    assert_eq!(load_state(&latest).expect("a state").step, 48);
    assert_eq!(a.len(), b.len());
    assert!(worst <= apart, "a killed and resumed run must end like one left alone: {worst:e} apart");
    let log = std::fs::read_to_string(out.join("log.jsonl")).expect("a log");
    assert_eq!(log.matches("\"kind\":\"epoch\"").count(), 12, "each epoch once:\n{log}");
    let litter = std::fs::read_dir(&out).expect("a directory").flatten().map(|e| e.file_name());
    let litter: Vec<_> = litter.filter(|n| n.to_string_lossy().ends_with(".partial")).collect();
    assert!(litter.is_empty(), "{litter:?}");
    kills
}

fn weights(checkpoint: &Path) -> Vec<f32> {
    let device = model::device::open("cpu").expect("a CPU");
    let (net, ..) = model::checkpoint::load::<model::BenbvNet>(checkpoint, &device).expect("its weights load");
    all_numbers(&net)
}
