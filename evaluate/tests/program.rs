//! The program as its user runs it.

use std::path::Path;
use std::process::{Command, Stdio};

fn evaluate(directory: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_evaluate"));
    command.current_dir(directory).args(arguments).env_remove("RUST_LOG");
    command
}

/// Exit code, stdout and stderr.
fn run(directory: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = evaluate(directory, arguments).output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let directory = tempfile::tempdir().expect("dir");
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut command = evaluate(directory.path(), &["--list-policies"]);
    let output = command.stdout(writer).stderr(Stdio::piped()).output().expect("the program starts");
    assert_eq!((output.status.code(), String::from_utf8_lossy(&output.stderr).as_ref()), (Some(0), ""));
}

#[test]
fn wrong_use_is_found_before_any_work() {
    let directory = tempfile::tempdir().expect("dir");
    let refused = |arguments: &[&str], expected: &str, code: i32| {
        let (found, _, message) = run(directory.path(), arguments);
        assert!(found == Some(code) && message.contains(expected), "{arguments:?}: {found:?} {message}");
        assert!(!directory.path().join("runs").exists(), "{arguments:?}");
    };
    refused(&["--policies", "bnbv"], "did you mean \"benbv\"?", 1);
    refused(&["--set", "policies=[\"see:fast\"]"], "r010", 1);
    refused(&["--policies", "see", "--baseline", "bnbv"], "baseline", 1);
    refused(&["--policies", "see,farthest", "--baseline", "benbv"], "expected one of see, farthest, or add", 1);
    refused(&["--policies", "oracle:60:30"], "overlap from 0 to 1, e.g. 60:0.3", 1);
    refused(&["--policies", "benbv:3000000000"], "up to 10,000,000", 1);
    refused(&["--set", "episode.num_views=40", "--set", "views_if_unreached=17"], "17 with episode.num_views = 40", 1);
    refused(&["--policies", "recorded-order"], "only runs on recorded sequences", 1);
    refused(&["--policies", "benbv-net:no/such"], "needs weights", 1);
    refused(&["--policies", "volumetric:learned"], "learn_forecasts", 1);
    refused(&["--seed", "18446744073709551615"], "9223372036854775807", 2);
    refused(&["--jobs", "1000000"], "per core", 2);
    refused(&["--distance", "-1"], "length above 0", 2);
    refused(&["--set", "surface_samples=1000000000000"], "surface_samples = 1000000000000", 1);
    refused(&["--compare", "a", "b", "--episodes", "3"], "cannot be used with", 2);
    refused(&["--device", "abacus"], "weights.device: unknown device `abacus`", 1);
    refused(&["--set", "weights.benbv_net=no/such", "--policies", "benbv-net"], "no/such", 1);
    let (_, _, message) = run(directory.path(), &["--config", "none.toml"]);
    assert_eq!(message.matches("No such file").count(), 1, "every cause once: {message}");
}

#[test]
fn a_run_without_usable_objects_fails_and_a_run_prints_typed_rows() {
    let directory = tempfile::tempdir().expect("dir");
    let meshes = directory.path().join("meshes");
    std::fs::create_dir(&meshes).expect("made");
    std::fs::write(meshes.join("broken.off"), "OFF\n3 1 0\n0 0\n").expect("written");
    let few = ["--episodes", "2", "--policies", "random-33,random-sphere", "--baseline", "random-33", "--out", "out"];
    let small = ["--set", "episode.num_views=1", "--set", "surface_samples=3000", "--set", "resamples=50"];
    let all = |more: &[&'static str]| [more, &few[..], &small[..]].concat();
    let (code, _, message) = run(directory.path(), &all(&["--dataset", "folder", "--root", "meshes"]));
    assert!(code == Some(1) && message.contains("none of 1 objects") && message.contains("broken: "), "{message}");

    std::fs::remove_dir_all(directory.path().join("out")).expect("removed");
    let out = directory.path().join("out");
    let held = formats::lock::try_lock(&out, formats::lock::LOCK, "another run").expect("free");
    let (code, _, message) = run(directory.path(), &all(&["--dataset", "procedural", "--objects", "1"]));
    assert!(code == Some(1) && message.contains("\"out\" is in use") && message.contains("another run"), "{message}");
    assert!(!out.join("journal.jsonl").exists(), "the other run's files are left alone");
    drop(held);
    let (code, json, message) = run(directory.path(), &all(&["--json", "--dataset", "procedural", "--objects", "1"]));
    assert_eq!(code, Some(0), "{message}");
    let rows: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let number = |key: &str| rows["policies"][0][key].as_f64().unwrap_or_else(|| panic!("{key}: {rows}"));
    let (low, value) = (number("coverage_percent_ci_episodes_low"), number("coverage_percent"));
    assert!(low <= value && number("efficiency_ci_episodes_high") > 0.0);
    let policies = std::fs::read_to_string(directory.path().join("out/policies.csv")).expect("policies");
    let cell = |key: &str| {
        let lines: Vec<Vec<&str>> = policies.lines().map(|line| line.split(',').collect()).collect();
        let place = lines[0].iter().position(|name| *name == key).expect("a column");
        lines[1][place].to_owned()
    };
    assert!(
        !cell("efficiency_ci_episodes_low").is_empty() && cell("efficiency_ci_objects_low").is_empty(),
        "{policies}"
    );
    assert!(rows["policies"][0]["efficiency_ci_objects_high"].is_null(), "a single object has no interval");
    assert!(rows["paired"][0]["ratio_ci_episodes_low"].is_number(), "{rows}");
    let summary = std::fs::read_to_string(directory.path().join("out/summary.csv")).expect("summary");
    assert!(
        summary.starts_with("object,policy,episodes,coverage_percent,coverage_percent_se,efficiency,"),
        "{summary}"
    );
}

#[test]
fn a_report_holds_the_objects_of_its_command_alone() {
    let directory = tempfile::tempdir().expect("dir");
    let set = ["--dataset", "procedural", "--objects", "2", "--episodes", "1", "--set", "episode.num_views=1"];
    let policies = ["--policies", "random-33", "--baseline", "random-33", "--set", "surface_samples=3000"];
    let reported = |only: &[&'static str]| {
        let arguments = [&set[..], &policies, &["--json", "--out", "out"], only].concat();
        let (code, json, message) = run(directory.path(), &arguments);
        assert_eq!(code, Some(0), "{message}");
        let rows: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        let rows = rows["objects"].as_array().expect("a list");
        rows.iter().map(|row| row["object"].as_str().expect("a name").to_owned()).collect::<Vec<String>>()
    };
    let [first, second] = ["procedural/train_000000", "procedural/train_000001"];
    assert_eq!(reported(&["--only", first]), [first]);
    assert_eq!(reported(&["--only", second]), [second], "the journal holds both");
    let report = std::fs::read_to_string(directory.path().join("out/report.md")).expect("a report");
    assert!(report.contains(second) && !report.contains(first), "{report}");
    assert_eq!(reported(&[]), [first, second]);
}

#[test]
fn the_papers_values_are_printed_beside_ours() {
    let directory = tempfile::tempdir().expect("dir");
    let set = ["--dataset", "procedural", "--objects", "1", "--episodes", "1", "--set", "episode.num_views=1"];
    let policies = ["--preset", "paper", "--policies", "random-boundary", "--baseline", "random-boundary"];
    let (code, table, message) = run(directory.path(), &[&set[..], &policies].concat());
    assert_eq!(code, Some(0), "{message}");
    assert!(table.contains("| random-boundary | here | "), "{table}");
    assert!(table.contains("| random-boundary | paper | 94.28 | 23.55 | 0.11 | 5.91 | 9.50 | 9.93 |"), "{table}");
}

#[test]
fn an_arm_adds_its_joint_travel_and_what_it_cannot_take() {
    let directory = tempfile::tempdir().expect("dir");
    let urdf = format!("{}/../samples/robots/ur5e.urdf", env!("CARGO_MANIFEST_DIR"));
    let set = ["--dataset", "procedural", "--objects", "1", "--episodes", "1", "--set", "episode.num_views=5"];
    let base = "robot.cell_from_base=[[1,0,0,-0.65],[0,1,0,0],[0,0,1,-0.25],[0,0,0,1]]";
    let policies =
        ["--policies", "random-33", "--baseline", "random-33", "--distance", "0.45", "--json", "--out", "out"];
    let eye = "robot.flange_from_camera=[[1,0,0,0],[0,1,0,0.05],[0,0,1,0.03],[0,0,0,1]]";
    let arm = ["--robot", &urdf, "--tool", "tool0", "--set", base, "--set", eye];
    let (code, json, message) = run(directory.path(), &[&set[..], &policies, &arm].concat());
    assert_eq!(code, Some(0), "{message}");
    let rows: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let number = |key: &str| rows["arm"][0][key].as_f64().unwrap_or_else(|| panic!("{key}: {rows}"));
    let out_of_reach = number("views_out_of_reach");
    assert!(number("views") == 6.0 && (1.0..5.0).contains(&out_of_reach), "half of the sphere is: {rows}");
    let taken = 6.0 - out_of_reach;
    assert!(number("joint_travel_rad") > 0.5 && number("joint_travel_rad") < 12.0 * taken, "{rows}");
    let csv = std::fs::read_to_string(directory.path().join("out/arm.csv")).expect("a table");
    assert!(csv.starts_with("policy,episodes,views,views_out_of_reach,joint_travel_rad\nrandom-33,1,6"), "{csv}");
    let wrong = ["--robot", &urdf, "--tool", "hand"];
    let (code, _, message) = run(directory.path(), &[&set[..], &wrong].concat());
    assert!(code == Some(1) && message.contains("ur5e.urdf") && message.contains("hand"), "{message}");
}

#[test]
fn a_scan_that_fails_to_register_is_shown_as_it_happens() {
    let directory = tempfile::tempdir().expect("dir");
    let set = ["--dataset", "procedural", "--objects", "1", "--episodes", "1", "--set", "episode.num_views=3"];
    let policies = ["--policies", "random-sphere,farthest:60", "--baseline", "random-sphere", "--out", "out"];
    let registration = "episode.registration={sigma_t_m=0.03,sigma_theta_deg=8.0,prior=false,gate=false}";
    let (code, _, message) = run(directory.path(), &[&set[..], &policies, &["--set", registration]].concat());
    assert_eq!(code, Some(0), "{message}");
    let read = |file: &str| std::fs::read_to_string(directory.path().join("out").join(file)).expect("written");
    let (page, figure) = (read("report.html"), read("failures.svg"));
    assert!(page.contains("scans that failed are red") && page.contains("; failed, "), "the failure and how far off");
    assert!(page.contains("failed:[false,"), "the first scan defines the frame");
    assert!(page.contains(&figure) && figure.starts_with("<svg") && figure.contains("overlap with like normals"));
    assert!(read("coverage.svg").starts_with("<svg") && read("overlaps.svg").starts_with("<svg"));
}

/// Writes a block of this height as a mesh.
fn block(path: &Path, height: f64) {
    let mut text = "OFF\n8 12 0\n".to_owned();
    for i in 0..8u32 {
        text += &format!("{} {} {}\n", i & 1, i >> 1 & 1, height * f64::from(i >> 2));
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in quads {
        text += &format!("3 {a} {b} {c}\n3 {a} {c} {d}\n");
    }
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    std::fs::write(path, text).expect("written");
}

/// A run in a folder of meshes.
const ON_MESHES: [&str; 10] = [
    "--dataset",
    "folder",
    "--policies",
    "random-33",
    "--baseline",
    "random-33",
    "--set",
    "episode.num_views=1",
    "--set",
    "surface_samples=20000",
];

#[test]
fn a_directory_goes_on_with_the_same_objects_and_settings_alone() {
    let directory = tempfile::tempdir().expect("dir");
    let mesh = directory.path().join("meshes/a.off");
    block(&mesh, 1.0);
    block(&directory.path().join("meshes/b.off"), 2.0);
    let on = |root: &'static str, more: &[&'static str]| {
        run(directory.path(), &[&ON_MESHES[..], &["--root", root], more].concat())
    };
    let kept = || {
        ["journal.jsonl", "config.toml", "run.toml", "episodes.jsonl"]
            .map(|file| std::fs::read_to_string(directory.path().join("out").join(file)).expect(file))
    };
    let (code, _, message) = on("meshes", &["--episodes", "1", "--out", "out"]);
    assert_eq!(code, Some(0), "{message}");
    let (code, _, message) = on("./meshes", &["--episodes", "2", "--out", "out"]);
    assert_eq!(code, Some(0), "the same files by another name of their folder: {message}");
    let before = kept();
    assert_eq!(before[3].lines().count(), 4, "two episodes of each: {}", before[3]);
    let (code, _, message) = on("meshes", &["--episodes", "2", "--seed", "1", "--out", "out"]);
    assert!(code == Some(1) && message.contains("  there: seed = 0\n  now:   seed = 1\n"), "{message}");
    assert!(!message.contains("dataset.root"), "that may differ: {message}");
    block(&mesh, 3.0);
    let (code, _, message) = on("meshes", &["--episodes", "3", "--out", "out"]);
    assert!(code == Some(1) && message.contains("of these names: a; give another --out"), "{message}");
    assert!(kept() == before, "the directory is left as it was");
    let (code, _, message) = on("meshes", &["--episodes", "2", "--only", "b", "--out", "out"]);
    assert_eq!(code, Some(0), "b is still itself: {message}");
    let (code, _, message) = on("meshes", &["--episodes", "2", "--out", "other"]);
    assert_eq!(code, Some(0), "{message}");
    let (code, _, message) = run(directory.path(), &["--compare", "out", "other"]);
    assert!(code == Some(1) && message.contains("a of out and a of other are other meshes"), "{message}");
}

#[test]
fn objects_that_cannot_be_used_are_part_of_the_results() {
    let directory = tempfile::tempdir().expect("dir");
    block(&directory.path().join("meshes/a.off"), 1.0);
    std::fs::write(directory.path().join("meshes/broken.off"), "OFF\n3 1 0\n0 0\n").expect("written");
    let on = |more: &[&'static str]| {
        let arguments = [&ON_MESHES[..], &["--root", "meshes", "--episodes", "1", "--out", "out"], more].concat();
        let (code, text, message) = run(directory.path(), &arguments);
        assert!(code == Some(0) && message.contains("skipped broken: "), "{message}");
        text
    };
    let rows: serde_json::Value = serde_json::from_str(&on(&["--json"])).expect("JSON");
    let row = &rows["skipped"][0];
    assert!(row["object"] == "broken" && row["policy"].is_null() && row["reason"].is_string(), "{rows}");
    let read = |file: &str| std::fs::read_to_string(directory.path().join("out").join(file)).expect(file);
    assert!(read("report.md").contains(" 0 episodes not run. 1 of 2 objects could not be used. "), "the headline");
    assert!(read("report.md").contains("| broken | all | all | "), "the table of what was not run");
    assert!(read("run.toml").contains("finished; 1 of 2 objects could not be used"), "{}", read("run.toml"));
    assert!(on(&[]).contains("1 episodes, 0 skipped, 1 objects could not be used; see"));
}

#[test]
fn a_comparison_is_written_where_out_says() {
    let directory = tempfile::tempdir().expect("dir");
    block(&directory.path().join("meshes/a.off"), 1.0);
    let of = |out: &str| {
        let arguments = [&ON_MESHES[..], &["--root", "meshes", "--episodes", "1", "--out", out]].concat();
        let (code, _, message) = run(directory.path(), &arguments);
        assert_eq!(code, Some(0), "{message}");
    };
    of("x/near");
    of("y/near");
    let compare = ["--compare", "x/near", "y/near", "--baseline", "random-33"];
    let (code, text, message) = run(directory.path(), &compare);
    assert!(code == Some(0) && text.contains("| policy | x/near | y/near |"), "{text} {message}");
    assert!(!directory.path().join("runs").exists(), "nothing is written unasked");
    let (code, _, message) = run(directory.path(), &[&compare[..], &["--out", "runs/evaluate"]].concat());
    assert_eq!(code, Some(0), "{message}");
    assert!(directory.path().join("runs/evaluate/compare.md").exists(), "also where runs go by default");
}

#[cfg(target_os = "linux")]
#[test]
fn an_argument_need_not_be_unicode() {
    use std::os::unix::ffi::OsStrExt;
    let directory = tempfile::tempdir().expect("dir");
    block(&directory.path().join("meshes/a.off"), 1.0);
    let out = std::ffi::OsStr::from_bytes(b"o\xfft");
    let arguments = [&ON_MESHES[..], &["--root", "meshes", "--episodes", "1", "--out"]].concat();
    let output = evaluate(directory.path(), &arguments).arg(out).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let said = std::fs::read_to_string(directory.path().join(out).join("run.toml")).expect("run.toml");
    assert!(said.contains("o\u{fffd}t"), "{said}");
}
