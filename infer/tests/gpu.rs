//! The network on a GPU chooses what it chooses on the CPU: `.ci/gpu`.
#![cfg(feature = "wgpu-untuned")]

use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn infer(device: &str) -> Result<Value, String> {
    let scan = Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples/scan1.ply");
    let network = ["--json", "--planner", "benbv-net", "--device", device, "--scan"];
    let output = Command::new(env!("CARGO_BIN_EXE_infer")).args(network).arg(scan).output().expect("infer runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() { Ok(serde_json::from_slice(&output.stdout).expect("an answer")) } else { Err(said) }
}

#[test]
fn the_next_view_does_not_depend_on_the_device() {
    let gpu = match infer("wgpu") {
        Ok(answer) => answer,
        Err(said) => {
            assert!(std::env::var_os("BENBV_NEEDS_GPU").is_none(), "{said}");
            return println!("skipped: {said}");
        }
    };
    let cpu = infer("cpu").expect("an answer");
    let scores = |answer: &Value| -> Vec<f64> {
        let candidates = answer["candidates"].as_array().expect("a list");
        candidates.iter().filter_map(|c| c["planner_score"].as_f64()).collect()
    };
    let (a, b) = (scores(&gpu), scores(&cpu));
    let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("scores {worst:e} apart");
    assert!(a.len() == b.len() && a.len() > 1 && worst < 1e-5, "{a:?} {b:?}");
    assert_eq!(gpu["next"]["world_from_camera"], cpu["next"]["world_from_camera"]);
}
