//! The invariants of ARCHITECTURE.md that a program can check.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const CRATES: [&str; 7] = ["geometry", "formats", "datagen", "model", "train", "infer", "evaluate"];

/// What each crate may use of ours, and whether it may name burn.
const RULES: [(&str, &[&str], bool); 7] = [
    ("geometry", &[], false),
    ("formats", &["geometry"], false),
    ("datagen", &["geometry", "formats"], false),
    ("model", &["geometry"], true),
    ("train", &["geometry", "formats", "datagen", "model"], true),
    ("infer", &["geometry", "formats", "datagen", "model"], false),
    ("evaluate", &["geometry", "formats", "datagen", "model", "infer"], false),
];

fn manifest(name: &str) -> toml::Table {
    let path = tests::root().join(name).join("Cargo.toml");
    fs::read_to_string(&path).expect("a manifest per crate").parse().expect("valid TOML")
}

fn dependencies(name: &str) -> BTreeSet<String> {
    manifest(name)["dependencies"].as_table().expect("a table").keys().cloned().collect()
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a readable folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The part of a source file before its unit tests.
fn shipped(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("a readable source");
    text.split("#[cfg(test)]").next().unwrap_or_default().to_owned()
}

#[test]
fn crates_use_only_what_their_room_allows() {
    for (name, allowed, burn) in RULES {
        for dependency in dependencies(name) {
            if CRATES.contains(&dependency.as_str()) {
                assert!(allowed.contains(&dependency.as_str()), "{name} must not depend on {dependency}");
            }
            if dependency.starts_with("burn") {
                assert!(burn, "{name} must not name {dependency}");
            }
        }
    }
}

#[test]
fn geometry_touches_no_files_no_clock_and_no_global_randomness() {
    for path in sources(&tests::root().join("geometry/src")) {
        // Compiled for tests only.
        if path.ends_with("golden.rs") || path.ends_with("tests.rs") {
            continue;
        }
        let text = shipped(&path);
        for forbidden in ["std::fs", "std::io", "std::net", "Instant::now", "SystemTime", "thread_rng", "from_entropy"]
        {
            assert!(!text.contains(forbidden), "{} uses {forbidden}", path.display());
        }
    }
}

#[test]
fn randomness_comes_from_named_streams() {
    for name in CRATES {
        for path in sources(&tests::root().join(name).join("src")) {
            if path.ends_with("geometry/src/rng.rs") {
                continue;
            }
            let text = shipped(&path);
            for forbidden in ["thread_rng", "from_entropy", "rand::random"] {
                assert!(!text.contains(forbidden), "{} uses {forbidden}", path.display());
            }
        }
    }
}

#[test]
fn no_source_file_outgrows_its_room() {
    for name in CRATES {
        for path in sources(&tests::root().join(name).join("src")) {
            let lines = fs::read_to_string(&path).expect("a readable source").lines().count();
            assert!(lines <= 500, "{} has {lines} lines; split it", path.display());
        }
    }
}

#[test]
fn every_dependency_version_stands_at_the_root() {
    for name in CRATES.into_iter().chain(["tests"]) {
        let manifest = manifest(name);
        for table in ["dependencies", "dev-dependencies"] {
            let Some(entries) = manifest.get(table).and_then(|t| t.as_table()) else { continue };
            for (dependency, value) in entries {
                let inherited = value.get("workspace").and_then(toml::Value::as_bool) == Some(true);
                assert!(inherited, "{name}: {dependency} must take its version from the root");
            }
        }
    }
}
