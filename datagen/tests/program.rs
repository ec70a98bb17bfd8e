//! The program as its user runs it: same bytes whatever the threads, parts, kills and full disks.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Small enough for a test, large enough to be stopped in the middle.
const SMALL: [&str; 8] =
    ["--objects", "5", "--scans", "2", "--set", "surface_samples=3000", "--set", "candidates.num_targets=6"];

fn datagen(directory: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_datagen"));
    command.current_dir(directory);
    for name in ["SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "JOB_COMPLETION_INDEX", "RUST_LOG"] {
        command.env_remove(name);
    }
    command
}

fn run(command: &mut Command) -> (Option<i32>, String) {
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    (status.code(), String::from_utf8_lossy(&stdout).into_owned() + &String::from_utf8_lossy(&stderr))
}

fn succeed(command: &mut Command) -> String {
    let (code, text) = run(command);
    assert_eq!(code, Some(0), "{text}");
    text
}

/// Every file of a set with its bytes, but for provenance and the lock.
fn bytes(directory: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn visit(root: &Path, directory: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                visit(root, &path, files);
            } else if !(name.starts_with(".lock") || name.starts_with("run") && name.ends_with(".toml")) {
                files.insert(path.strip_prefix(root).unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    let mut files = BTreeMap::new();
    visit(directory, directory, &mut files);
    files
}

fn same(a: &Path, b: &Path, what: &str) {
    let (a, b) = (bytes(a), bytes(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{what}: files");
    for (path, content) in &a {
        assert!(content == &b[path], "{what}: {path:?} differs");
    }
    assert!(a.keys().filter(|p| p.starts_with("shards")).count() >= 4, "{what}: {:?}", a.keys());
}

fn shards(directory: &Path) -> usize {
    let visit = std::fs::read_dir(directory.join("shards/procedural"));
    visit.into_iter().flatten().flatten().filter(|e| e.path().extension().is_some_and(|x| x == "safetensors")).count()
}

#[test]
fn same_bytes_whatever_threads_parts_kills_and_full_disks() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let whole = home.join("whole");
    let text = succeed(datagen(home).args(SMALL).args(["--jobs", "1", "--out", "whole"]));
    assert!(text.contains("5 objects") && text.contains("5/5 objects"), "{text}");
    // The same mean for people and for programs.
    let json = succeed(datagen(home).args(SMALL).args(["--json", "--out", "whole"]));
    let summary: serde_json::Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    let mean = summary["final_coverage"].as_f64().unwrap();
    let told = format!("final coverage {:.1} % on average", 100.0 * mean);
    assert!(summary["kept"] == 5 && mean <= 1.0 && text.contains(&told), "{json} {text}");

    succeed(datagen(home).args(SMALL).args(["--jobs", "2", "--out", "threads"]));
    same(&whole, &home.join("threads"), "two threads");

    // Parts as processes at the same time.
    let children: Vec<_> = ["0/3", "1/3", "2/3"]
        .map(|part| {
            let mut command = datagen(home);
            command.args(SMALL).args(["--jobs", "1", "--out", "parts", "--part", part]);
            command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
        })
        .into();
    for mut child in children {
        assert!(child.wait().unwrap().success());
    }
    same(&whole, &home.join("parts"), "three parts");
    assert!(succeed(datagen(home).args(["verify", "parts"])).contains("5 intact shards"));

    // Twice the same part at the same time: one of them must wait for another day.
    let mut command = datagen(home);
    command.args(SMALL).args(["--jobs", "1", "--out", "busy"]).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let end = Instant::now() + Duration::from_secs(60);
    while !home.join("busy/run.toml").exists() && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(3));
    }
    let (code, text) = run(datagen(home).args(SMALL).args(["--out", "busy"]));
    assert!(code == Some(1) && text.contains("another process"), "{text}");
    assert!(child.wait().unwrap().success());
    same(&whole, &home.join("busy"), "a second process");

    // Killed at several moments; then the same command.
    let killed = home.join("killed");
    for shards_before in [0, 2, 4] {
        let mut command = datagen(home);
        command.args(SMALL).args(["--jobs", "2", "--out", "killed"]).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let end = Instant::now() + Duration::from_secs(60);
        while shards(&killed) < shards_before && Instant::now() < end && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(3));
        }
        std::thread::sleep(Duration::from_millis(40));
        let _ = child.kill(); // SIGKILL
        child.wait().unwrap();
    }
    succeed(datagen(home).args(SMALL).args(["--out", "killed"]));
    same(&whole, &killed, "killed");

    // A shard that was damaged is found, named and made anew.
    let victim = home.join("threads/shards/procedural/train_000002.safetensors");
    let mut content = std::fs::read(&victim).unwrap();
    let middle = content.len() / 2;
    content[middle] ^= 4;
    std::fs::write(&victim, &content).unwrap();
    let (code, text) = run(datagen(home).args(["verify", "threads"]));
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("train_000002") && text.contains("damaged"), "{text}");
    let text = succeed(datagen(home).args(SMALL).args(["--out", "threads"]));
    assert!(text.contains("damaged and made anew") && text.contains("train_000002"), "{text}");
    same(&whole, &home.join("threads"), "a damaged shard");

    // So are a surface and settings.
    let surface = std::fs::read_dir(home.join("threads/surfaces/procedural")).unwrap().next().unwrap().unwrap().path();
    for (victim, word) in [(surface, "damaged"), (home.join("threads/config.toml"), "edited or damaged")] {
        let good = std::fs::read(&victim).unwrap();
        let mut bad = good.clone();
        bad[good.len() / 2] ^= 1;
        std::fs::write(&victim, &bad).unwrap();
        let (code, text) = run(datagen(home).args(["verify", "threads"]));
        let name = victim.file_name().unwrap().to_string_lossy();
        assert!(code == Some(1) && text.contains(&*name) && text.contains(word), "{text}");
        std::fs::write(&victim, &good).unwrap();
    }
    // A shard of another seed in the place of one of this set.
    succeed(datagen(home).args(SMALL).args(["--seed", "9", "--out", "other"]));
    let (from, to) = ("other/shards/procedural/train_000001", "threads/shards/procedural/train_000001");
    let shard = |name: &str| home.join(format!("{name}.safetensors"));
    std::fs::copy(shard(from), shard(to)).unwrap();
    let (code, text) = run(datagen(home).args(["verify", "threads"]));
    assert!(code == Some(1) && text.contains("train_000001") && text.contains("another set"), "{text}");

    // Other settings must not be mixed in.
    let (code, text) = run(datagen(home).args(SMALL).args(["--out", "whole", "--seed", "1"]));
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("different settings") && text.contains("now:   seed = 1"), "{text}");

    let text = succeed(datagen(home).args(["inspect", "whole"]));
    for word in ["train", "validation", "coverage by scan", "scores:", "odd numbers: 0", "a sample: procedural/train_"]
    {
        assert!(text.contains(word), "{word:?} is missing in {text}");
    }
    let json = succeed(datagen(home).args(["inspect", "whole", "--json"]));
    assert!(serde_json::from_str::<serde_json::Value>(&json).unwrap()["oddities"] == 0, "{json}");
    full_disk(home, &whole);
}

/// A limit on the size of files stands for a full disk: writes fail in the middle of a shard.
#[cfg(unix)]
fn full_disk(home: &Path, whole: &Path) {
    let mut command = Command::new("bash");
    let script = "trap '' XFSZ; ulimit -f 60; exec \"$0\" \"$@\"";
    command.current_dir(home).args(["-c", script, env!("CARGO_BIN_EXE_datagen")]);
    command.args(SMALL).args(["--jobs", "1", "--out", "full"]);
    let (code, text) = run(&mut command);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("cannot write") && text.contains("safetensors"), "{text}");
    succeed(datagen(home).args(SMALL).args(["--out", "full"]));
    same(whole, &home.join("full"), "a full disk");
}

#[cfg(not(unix))]
fn full_disk(_: &Path, _: &Path) {}

#[test]
fn modelnet40_runs_with_no_further_flag_and_explains_itself() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let (code, text) = run(datagen(home).args(["--dataset", "modelnet40"]));
    assert_eq!(code, Some(1), "{text}");
    for word in ["data/modelnet40", "<category>/{train,test}/*.off", "modelnet.cs.princeton.edu", "--root"] {
        assert!(text.contains(word), "{word:?} is missing in {text}");
    }

    // A block with a glued header as in ModelNet40, one with a plain header, and files that cannot be used.
    let block = "8 6 0\n-1 -1 -1\n1 -1 -1\n1 2 -1\n-1 2 -1\n-1 -1 1\n1 -1 1\n1 2 1\n-1 2 1\n\
                 4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
    let put = |name: &str, text: String| {
        let path = home.join("data/modelnet40").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    put("box/train/box_0001.off", format!("OFF{block}"));
    put("box/train/box_0002.off", format!("OFF\n{block}"));
    put("box/train/box_0003.off", "OFF\n2 1 0\n-1 -1 -1\n1 -1 x\n3 0 1 1\n".to_owned());
    put("box/train/box_0004.off", "OFF 3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n".to_owned());
    put("box/test/box_0005.off", format!("OFF{block}"));
    let text = succeed(datagen(home).args(["--dataset", "modelnet40"]));
    assert!(text.contains("2 objects, ") && text.contains("2 objects skipped"), "{text}");
    assert!(text.contains("box/box_0003") && text.contains("line 4") && text.contains("\"x\""), "{text}");
    let manifest = std::fs::read_to_string(home.join("runs/data/modelnet40/manifest.json")).unwrap();
    assert!(manifest.contains("without area"), "{manifest}");
    assert!(succeed(datagen(home).args(["verify", "runs/data/modelnet40"])).contains("2 intact shards"));
    let text = succeed(datagen(home).args(["--dataset", "modelnet40", "--split", "test", "--list-objects"]));
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with("box/box_0005\tbox\tTest"), "{text}");
}

/// An OFF file.
fn block(height: f64) -> String {
    format!(
        "OFF\n8 6 0\n-1 -1 -1\n1 -1 -1\n1 2 -1\n-1 2 -1\n-1 -1 {height}\n1 -1 {height}\n1 2 {height}\n-1 2 {height}\n\
         4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
    )
}

#[test]
fn shards_of_other_meshes_are_not_taken_for_those_of_these() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    for (root, height) in [("a", 1.0), ("b", 1.3), ("a-again", 1.0)] {
        std::fs::create_dir(home.join(root)).unwrap();
        std::fs::write(home.join(root).join("part.off"), block(height)).unwrap();
    }
    let small = ["--scans", "1", "--set", "candidates.num_targets=4", "--set", "surface_samples=3000"];
    let from =
        |root: &str| run(datagen(home).args(["--dataset", "folder", "--root", root, "--out", "out"]).args(small));
    let good = |root: &str, expected: &str| {
        let (code, text) = from(root);
        assert!(code == Some(0) && text.contains(expected), "{root}: {text}");
    };
    good("a", "1 made");
    good("a-again", "1 there before");
    let before = bytes(&home.join("out"));
    let (code, text) = from("b");
    assert!(code == Some(1) && text.contains("other meshes of these names: part; give another --out"), "{text}");
    assert!(bytes(&home.join("out")) == before, "it is left as it was");

    // A shard of an older program does not say what it was made from.
    let shard = home.join("out/shards/part.safetensors");
    let reader = formats::ShardReader::open(&shard).unwrap();
    let metadata = formats::ShardMetadata { mesh: String::new(), ..reader.metadata().clone() };
    let mut older = formats::ShardWriter::new(metadata, formats::CloudPrecision::F32);
    (0..reader.len()).for_each(|i| older.push(&reader.sample(i).unwrap()).unwrap());
    older.write(&shard).unwrap();
    good("b", "1 there before");
    std::fs::remove_file(&shard).unwrap();
    good("b", "1 made");
    assert!(from("a").1.contains("other meshes"), "the new one says it again");
}

#[test]
fn a_shard_that_is_no_longer_listed_is_noted_and_one_that_was_not_noted_is_a_problem() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::create_dir(home.join("in")).unwrap();
    for (name, height) in [("a.off", 1.0), ("b.off", 1.3)] {
        std::fs::write(home.join("in").join(name), block(height)).unwrap();
    }
    let small = ["--scans", "1", "--set", "candidates.num_targets=4", "--set", "surface_samples=3000"];
    let again = || succeed(datagen(home).args(["--dataset", "folder", "--root", "in", "--out", "out"]).args(small));
    let verify = || run(datagen(home).args(["verify", "out"]));
    again();
    std::fs::remove_file(home.join("in/b.off")).unwrap();
    again();
    let (code, text) = verify();
    assert!(code == Some(0) && text.contains("1 intact shards"), "{text}");
    assert!(text.contains("note: ") && text.contains("b.safetensors") && text.contains("delete the file"), "{text}");
    let json = succeed(datagen(home).args(["verify", "out", "--json"]));
    let verdict: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((verdict["notes"].as_array().unwrap().len(), &verdict["problems"]), (1, &serde_json::json!([])));
    std::fs::remove_file(home.join("out/shards/b.safetensors")).unwrap();
    let (code, text) = verify();
    assert!(code == Some(0) && !text.contains("note"), "{text}");

    // What a run leaves that was killed after its shards and before its manifest.
    let mut manifest = formats::Manifest::read(&home.join("out")).unwrap();
    let whole = std::mem::replace(&mut manifest.objects[0].status, formats::ObjectStatus::Missing);
    manifest.write(&home.join("out")).unwrap();
    let (code, text) = verify();
    assert!(
        code == Some(1) && text.contains("a.safetensors") && text.contains("run the same datagen command"),
        "{text}"
    );
    again();
    assert_eq!(
        (verify().0, formats::Manifest::read(&home.join("out")).unwrap().objects[0].status.clone()),
        (Some(0), whole)
    );
}

#[test]
fn names_that_meet_are_objects_of_their_own() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::create_dir(home.join("in")).unwrap();
    let long = format!("{}.off", "n".repeat(240));
    for (name, height) in [("a.off", 1.0), ("a.OFF", 1.2), (long.as_str(), 1.4)] {
        std::fs::write(home.join("in").join(name), block(height)).unwrap();
    }
    let small = ["--scans", "1", "--set", "candidates.num_targets=4"];
    let command = |jobs: &'static str, out: &'static str| {
        let mut command = datagen(home);
        command.args(["--dataset", "folder", "--root", "in", "--jobs", jobs, "--out", out]).args(small);
        succeed(&mut command)
    };
    let text = command("1", "one");
    assert!(text.contains("3 objects") && text.contains("3 made"), "{text}");
    command("2", "two");
    let (one, two) = (bytes(&home.join("one")), bytes(&home.join("two")));
    assert!(one == two, "the same bytes whatever the threads");
    let shards: Vec<_> = one.iter().filter(|(path, _)| path.starts_with("shards")).collect();
    assert!(shards.len() == 3 && shards[0].1 != shards[1].1, "{:?}", one.keys());
    assert!(succeed(datagen(home).args(["verify", "one"])).contains("3 intact shards"));
}

#[test]
fn wrong_settings_name_their_origin() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::write(home.join("a.toml"), "seed = 1\n[episode]\nnum_view = 3\n").unwrap();
    for (arguments, words) in [
        (vec!["--config", "a.toml"], vec!["a.toml", "line 3", "num_view"]),
        (vec!["--set", "episode.image.widht=640"], vec!["--set", "unknown field `widht`", "`width`"]),
        (vec!["--set", "seed=true"], vec!["--set", "seed=true", "invalid type"]),
        (vec!["--dataset", "modelnet10"], vec!["--dataset", "unknown variant `modelnet10`", "modelnet40"]),
        (vec!["--set", "episode.working_distance_m=0"], vec!["episode.working_distance_m = 0", "above 0"]),
        (vec!["--set", "surface_samples=1000000000000"], vec!["surface_samples = 1000000000000", "10,000,000"]),
        (vec!["--list", "none.txt", "--dataset", "folder", "--root", "."], vec!["\".\""]),
        (vec!["--part", "3/2"], vec!["--part 3/2", "0 to 1"]),
        (vec!["verify", "nowhere"], vec!["nowhere/manifest.json", "cannot read"]),
    ] {
        let (code, text) = run(datagen(home).args(&arguments));
        assert_eq!(code, Some(1), "{arguments:?}: {text}");
        for word in words {
            assert!(text.contains(word), "{arguments:?}: {word:?} is missing in {text}");
        }
    }
    for (arguments, word) in [
        (vec!["--no-such-flag"], "unexpected argument"),
        (vec!["--distance", "-1"], "length above 0"),
        (vec!["--distance", "0"], "length above 0"),
        (vec!["--list-objects", "--out", "x"], "cannot be used with"),
    ] {
        let (code, text) = run(datagen(home).args(&arguments));
        assert!(code == Some(2) && text.contains(word), "{arguments:?}: {text}");
    }
    assert!(!home.join("runs").exists() && !home.join("x").exists(), "nothing is made by a start that fails");
}

#[test]
fn the_run_of_another_program_is_left_as_it_is() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    for (file, kind) in [("latest/training.toml", "a run of `train`"), ("journal.jsonl", "a run of `evaluate`")] {
        let out = home.join("out");
        std::fs::create_dir_all(out.join(file).parent().unwrap()).unwrap();
        std::fs::write(out.join(file), "").unwrap();
        std::fs::write(out.join("config.toml"), "[optimizer]\nlearning_rate = 1.0\n").unwrap();
        let (code, text) = run(datagen(home).args(SMALL).args(["--out", "out"]));
        assert_eq!(code, Some(1), "{text}");
        assert!(
            text.contains(&format!("\"out\" contains {kind} ({file})")) && text.contains("another --out"),
            "{text}"
        );
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2, "not even a lock is added");
        std::fs::remove_dir_all(&out).unwrap();
    }
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let directory = tempfile::tempdir().unwrap();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = datagen(directory.path()).args(["--list-objects", "--objects", "5"]).stdout(writer).output().unwrap();
    assert_eq!((output.status.code(), String::from_utf8_lossy(&output.stderr).as_ref()), (Some(0), ""));
    let (code, text) = run(datagen(directory.path()).args(["--seed", "18446744073709551615"]));
    assert!(code == Some(2) && text.contains("9223372036854775807"), "{text}");
}
