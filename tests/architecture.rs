//! The invariants of ARCHITECTURE.md that a program can check.
#![allow(missing_docs)]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

const CRATES: [&str; 11] =
    ["built", "geometry", "planning", "formats", "datagen", "model", "train", "infer", "evaluate", "python", "ros2"];

/// What each crate may use of ours, and whether it may name burn.
const RULES: [(&str, &[&str], bool); 11] = [
    ("built", &[], false),
    ("geometry", &[], false),
    ("planning", &["geometry"], false),
    ("formats", &["geometry", "planning"], false),
    ("datagen", &["built", "geometry", "planning", "formats"], false),
    ("model", &["geometry", "planning"], true),
    ("train", &["built", "geometry", "planning", "formats", "datagen", "model"], true),
    ("ros2", &["geometry", "planning", "formats"], false),
    ("infer", &["built", "geometry", "planning", "formats", "datagen", "model", "ros2"], false),
    ("evaluate", &["built", "geometry", "planning", "formats", "datagen", "model"], false),
    ("python", &["geometry", "planning", "formats", "datagen", "model", "train", "infer", "evaluate"], false),
];

fn manifest(name: &str) -> toml::Table {
    let path = tests::root().join(name).join("Cargo.toml");
    fs::read_to_string(&path).expect("a manifest per crate").parse().expect("valid TOML")
}

fn dependencies(name: &str) -> BTreeSet<String> {
    let manifest = manifest(name);
    manifest.get("dependencies").and_then(toml::Value::as_table).into_iter().flat_map(|t| t.keys().cloned()).collect()
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

/// A source file without what is compiled for tests alone.
fn shipped(path: &Path) -> String {
    without_tests(&fs::read_to_string(path).expect("a readable source"))
}

/// As formatted: an item ends with the first line that is indented as far as it and closes it.
fn without_tests(text: &str) -> String {
    let indent = |line: &str| line.len() - line.trim_start().len();
    let (mut kept, mut lines) = (String::new(), text.lines());
    while let Some(line) = lines.next() {
        if line.trim_start().starts_with("#[cfg(test)]") {
            lines.find(|l| indent(l) == indent(line) && l.ends_with([';', '}', ',']));
        } else {
            kept += line;
            kept.push('\n');
        }
    }
    kept
}

#[test]
fn what_stands_below_tests_is_looked_at() {
    let text =
        "mod a;\n#[cfg(test)]\nmod golden;\nmod b;\n    #[cfg(test)]\n    fn c() {\n        d();\n    }\nfn e() {}\n";
    assert_eq!(without_tests(text), "mod a;\nmod b;\nfn e() {}\n");
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
fn geometry_and_planning_touch_no_files_no_clock_and_no_global_randomness() {
    let pure = ["geometry/src", "planning/src"];
    for path in pure.iter().flat_map(|folder| sources(&tests::root().join(folder))) {
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

/// Files that contain one of `words` in their shipped part, as `crate/src/...`.
fn files_with(words: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    for name in CRATES {
        for path in sources(&tests::root().join(name).join("src")) {
            let text = shipped(&path);
            if words.iter().any(|word| text.contains(word)) && !path.ends_with("tests.rs") {
                let path = path.strip_prefix(tests::root()).expect("inside");
                found.push(path.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    found
}

/// Each of these files is in an allowed place, and no place is allowed for nothing.
fn assert_only_in(found: &[String], allowed: &[&str], otherwise: &str) {
    for file in found {
        assert!(allowed.iter().any(|place| file.starts_with(place)), "{file} {otherwise}");
    }
    for place in allowed {
        assert!(
            found.iter().any(|file| file.starts_with(place)),
            "{place} is no exception any more: take it off the list"
        );
    }
}

#[test]
fn there_is_one_loop_one_session_and_one_accumulation() {
    // The loop takes shots with the simulated camera and adds them to a session.
    assert_eq!(
        files_with(&["world.shoot("]),
        ["datagen/src/episode/first_scan.rs", "datagen/src/episode.rs"],
        "the one loop"
    );
    assert_eq!(files_with(&["camera.take("]), ["datagen/src/world.rs"], "which alone asks the camera");
    assert_eq!(files_with(&["pub struct Session {"]), ["planning/src/session.rs"], "the one session");
    assert_eq!(files_with(&["impl Planner for Farthest"]), ["planning/src/planners/farthest.rs"], "the one `farthest`");
    let merges = files_with(&["merged.merge(", "voxel_downsample("]);
    assert_eq!(merges, ["geometry/src/cloud.rs", "planning/src/accumulate.rs"], "the one way of merging scans");
    // Only those who simulate or score true scans render: the world, the search, and programs that make data from fixed views.
    let simulate = files_with(&["scene.render(", ".depth_image("]);
    let allowed = [
        "datagen/src/search.rs",
        "datagen/src/visibility.rs",
        "datagen/src/world/camera.rs",
        "evaluate/src/report/replay.rs",
        "infer/src/simulate.rs",
        // Scans that a user asks for from a pose of his own.
        "python/src/scene.rs",
        "train/src/pc_nbv_data.rs",
    ];
    assert_only_in(&simulate, &allowed, "renders scans by itself; drive datagen::run_session");
}

#[test]
fn only_the_loop_decides() {
    // Whoever asks a planner for views outside of the loop, the session and planners that wrap planners builds a second
    // loop.
    let allowed = ["datagen/src/episode.rs", "planning/src/", "evaluate/src/policies/", "model/src/net_planner.rs"];
    assert_only_in(&files_with(&[".rank_views("]), &allowed, "asks a planner by itself");
}

#[test]
fn files_are_opened_where_it_is_known() {
    // File formats are in `formats`, weights in `model`; elsewhere a program keeps its own records. A new
    // place has to argue for itself here.
    let places = [
        "formats/src/",
        "model/src/checkpoint.rs",
        "model/src/published/import.rs",
        "model/src/sums.rs",
        // Golden values, in tests alone.
        "geometry/src/golden.rs",
        // The tree of a data set, shards and their manifest.
        "datagen/src/dataset.rs",
        "datagen/src/generate/",
        "datagen/src/history.rs",
        "datagen/src/verify.rs",
        // The journal, learned forecasts, which weights there are.
        "evaluate/src/journal.rs",
        "evaluate/src/learned.rs",
        "evaluate/src/networks.rs",
        "evaluate/src/policies/build.rs",
        // Pose files, exported scans; sessions of the service, which nobody else reads.
        "infer/src/load.rs",
        "infer/src/service/store.rs",
        "infer/src/simulate.rs",
        // Checkpoints of a run and what is watched of it.
        "train/src/checkpoint.rs",
        "train/src/data.rs",
        "train/src/watch/",
    ];
    let open = files_with(&["fs::", "File::open", "File::create"]);
    assert_only_in(&open, &places, "opens files; let `formats` do it, or argue here");
    // Nobody else parses a format that others write too.
    let parse = files_with(&["PlyParser", "png::Decoder", "SafeTensors::deserialize", "csv::ReaderBuilder"]);
    let known = ["formats/src/", "model/src/published/import.rs", "geometry/src/golden.rs"];
    assert_only_in(&parse, &known, "parses a foreign format");
}

#[test]
fn randomness_comes_from_named_streams() {
    for name in CRATES {
        for path in sources(&tests::root().join(name).join("src")) {
            if path.ends_with("geometry/src/rng.rs") {
                continue;
            }
            let text = shipped(&path);
            for forbidden in
                ["thread_rng", "ThreadRng", "rand::rng()", "SysRng", "from_entropy", "from_os_rng", "rand::random"]
            {
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
            assert!(lines <= 400, "{} has {lines} lines; split it", path.display());
        }
    }
}

/// What errors tell users to type is `cargo build -p PROGRAM --features DEVICE`.
#[test]
fn every_program_with_a_network_can_be_built_for_every_device() {
    for program in ["train", "infer", "evaluate"] {
        let manifest = manifest(program);
        for device in model::device::NAMES.into_iter().filter(|name| *name != "cpu") {
            let feature = manifest["features"].get(device).and_then(toml::Value::as_array);
            let of_model = toml::Value::from(format!("model/{device}"));
            assert!(feature.is_some_and(|f| f.contains(&of_model)), "{program} has no feature `{device}` for model's");
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
