//! Asks git for the commit, in release builds. Works without git.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let release = std::env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let commit = if release { commit() } else { "development".to_owned() };
    println!("cargo:rustc-env=BUILT_COMMIT={commit}");
}

fn commit() -> String {
    let root = Path::new("..");
    let git = |arguments: &[&str]| {
        let out = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
        out.status.success().then(|| String::from_utf8_lossy(&out.stdout).trim().to_owned())
    };
    // Sources unpacked inside of somebody else's clone are not that clone's.
    let own = git(&["rev-parse", "--show-toplevel"])
        .is_some_and(|top| Path::new(&top).canonicalize().ok() == root.canonicalize().ok());
    let Some(head) = git(&["rev-parse", "--short=12", "HEAD"]).filter(|_| own) else {
        return "unknown".to_owned();
    };
    // Again after every commit and checkout, and after every change of a tracked file, which may make the tree dirty or clean.
    let place = |name| git(&["rev-parse", "--path-format=absolute", "--git-path", name]);
    let moves = ["logs/HEAD", "index"].into_iter().filter_map(place).find(|path| Path::new(path).exists());
    if let Some(path) = moves {
        println!("cargo:rerun-if-changed={path}");
    }
    for path in git(&["ls-files"]).unwrap_or_default().lines().filter(|p| p.ends_with(".rs") || p.ends_with(".toml")) {
        println!("cargo:rerun-if-changed=../{path}");
    }
    let changed =
        git(&["--no-optional-locks", "status", "--porcelain", "--untracked-files=no"]).is_some_and(|s| !s.is_empty());
    if changed { format!("{head}-dirty") } else { head }
}
