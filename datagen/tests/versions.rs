//! A set that another version of the program goes on with.

use std::path::Path;
use std::process::Command;

/// What the program says while it makes a small set, or what is missing of it.
fn datagen(home: &Path) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_datagen"));
    command.current_dir(home).args(["--objects", "2", "--scans", "2", "--out", "set"]);
    command.args(["--set", "surface_samples=3000", "--set", "candidates.num_targets=6"]);
    for name in ["SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "JOB_COMPLETION_INDEX", "RUST_LOG"] {
        command.env_remove(name);
    }
    let output = command.output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn shards_of_another_version_are_said_before_more_are_made() {
    let home = tempfile::tempdir().expect("a folder");
    datagen(home.path());
    let note = home.path().join("set/run.toml");
    let text = std::fs::read_to_string(&note).expect("a note");
    let commit = text.lines().find(|line| line.starts_with("commit = ")).expect("a commit");
    std::fs::write(&note, text.replace(commit, "commit = \"0123456789ab\"")).expect("written");
    let text = datagen(home.path());
    assert!(!text.contains("0123456789ab"), "nothing was left to make: {text}");
    std::fs::remove_file(home.path().join("set/shards/procedural/train_000001.safetensors")).expect("a shard");
    let text = datagen(home.path());
    for part in ["shards were made here by datagen", "(0123456789ab), and this is datagen", "give another --out"] {
        assert!(text.contains(part), "{part:?} not in: {text}");
    }
}
