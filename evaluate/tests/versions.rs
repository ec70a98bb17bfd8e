//! A run that another version of the program goes on with.

use std::path::Path;
use std::process::Command;

/// What the program says while it runs so many episodes, or what is missing of them.
fn evaluate(home: &Path, episodes: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_evaluate"));
    command.current_dir(home).env_remove("RUST_LOG").args(["--episodes", episodes, "--out", "out"]);
    command.args(["--dataset", "procedural", "--objects", "1", "--policies", "random-33", "--baseline", "random-33"]);
    command.args(["--set", "episode.num_views=1", "--set", "surface_samples=3000", "--set", "resamples=50"]);
    let output = command.output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    text
}

#[test]
fn episodes_of_another_version_are_said_before_more_are_run() {
    let home = tempfile::tempdir().expect("a folder");
    evaluate(home.path(), "1");
    let note = home.path().join("out/run.toml");
    let text = std::fs::read_to_string(&note).expect("a note");
    let commit = text.lines().find(|line| line.starts_with("commit = ")).expect("a commit");
    std::fs::write(&note, text.replace(commit, "commit = \"0123456789ab\"")).expect("written");
    let text = evaluate(home.path(), "1");
    assert!(!text.contains("0123456789ab"), "nothing was left to run: {text}");
    let text = evaluate(home.path(), "2");
    for part in ["episodes were made here by evaluate", "(0123456789ab), and this is evaluate", "give another --out"] {
        assert!(text.contains(part), "{part:?} not in: {text}");
    }
    let note = std::fs::read_to_string(&note).expect("a note");
    assert!(note.contains("earlier = [") && note.contains("(0123456789ab)"), "it stays noted: {note}");
}
