//! The program on the bundled sample.

use std::path::{Path, PathBuf};
use std::process::Command;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples").join(name)
}

fn answer(arguments: &[&str], scans: &[&str]) -> serde_json::Value {
    let output = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(arguments)
        .arg("--json")
        .arg("--scan")
        .args(scans.iter().map(|name| sample(name)))
        .output()
        .expect("infer runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("an answer")
}

#[test]
fn clouds_alone_are_carved_from_estimated_cameras_unless_the_network_is_asked_for() {
    let carved = answer(&[], &["scan1.ply", "scan2.ply"]);
    assert_eq!((&carved["planner"], &carved["evidence"]), (&"volumetric".into(), &"clouds".into()), "{carved}");
    assert!(carved["planner_reason"].as_str().is_some_and(|why| why.contains("estimated")), "{carved}");
    assert!(!carved["warnings"].to_string().contains("off the scans before it"), "they fit: {carved}");
    let answer = answer(&["--planner", "benbv-net"], &["scan1.ply", "scan2.ply"]);
    assert_eq!(answer["planner"], "benbv-net", "{answer}");
    assert!(answer["next"].is_object(), "a view: {answer}");
    let scores: Vec<f64> =
        answer["candidates"].as_array().expect("a list").iter().filter_map(|c| c["planner_score"].as_f64()).collect();
    assert!(scores.len() > 1 && scores.iter().any(|s| (s - scores[0]).abs() > 1e-6), "scores differ: {scores:?}");
}

#[test]
fn the_network_runs_on_the_device_that_is_named() {
    let network = ["--planner", "benbv-net"];
    let named = answer(&[&network[..], &["--device", "cpu"]].concat(), &["scan1.ply"]);
    assert_eq!(named, answer(&network, &["scan1.ply"]), "what runs without the flag");
    let refused = |arguments: &[&str]| {
        let output =
            Command::new(env!("CARGO_BIN_EXE_infer")).args(arguments).arg("--scan").arg(sample("scan1.ply")).output();
        let output = output.expect("infer runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, error) = refused(&["--device", "abacus"]);
    assert!(code == Some(1) && error.contains("--device: unknown device `abacus`; this program has: cpu"), "{error}");
    let (code, error) = refused(&["--pose-error", "0.002,0.3"]);
    assert!(code == Some(2) && error.contains("--register check"), "without registration it does nothing: {error}");
    let (code, error) = refused(&["--misses", "free"]);
    assert!(code == Some(2) && error.contains("--misses has no effect without --depth"), "{error}");
    let (code, error) = refused(&["--device", "cpu", "--planner", "farthest"]);
    assert!(code == Some(2) && error.contains("--device selects the network's"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_closed_loop_that_is_asked_to_stop_leaves_its_report() {
    use std::io::{BufRead, BufReader, Read};
    let folder = tempfile::tempdir().expect("a folder");
    let report = folder.path().join("loop.html");
    let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--object", "procedural:3", "--views", "500", "--set", "stop_below=0", "--report"])
        .arg(&report)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("infer starts");
    let mut output = BufReader::new(process.stdout.take().expect("piped"));
    let mut text = String::new();
    output.read_line(&mut text).expect("the first view");
    assert!(text.starts_with("view  1"), "{text}");
    let asked = Command::new("kill").args(["-TERM", &process.id().to_string()]).status();
    assert!(asked.is_ok_and(|status| status.success()), "kill runs");
    output.read_to_string(&mut text).expect("the rest");
    assert_eq!(process.wait().expect("ends").code(), Some(130), "{text}");
    assert!(text.contains("ended: stopped as asked"), "{text}");
    assert!(std::fs::read_to_string(&report).is_ok_and(|page| page.len() > 10_000));
}

#[test]
fn a_session_goes_on_from_command_to_command() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("part").display().to_string();
    let from = ["--from", "0.0762,-0.5734,1.0514"];
    let first = answer(&["--session", &session, from[0], from[1]], &["scan1.ply"]);
    assert_eq!(first, answer(&from, &["scan1.ply"]), "as without");
    let second = answer(&["--session", &session, "--from", "0.5046,-0.6854,-0.8223"], &["scan2.ply"]);
    assert_eq!(second["cloud"]["scans"], 2, "{second}");
    let both = answer(&["--from", "0.0762,-0.5734,1.0514", "0.5046,-0.6854,-0.8223"], &["scan1.ply", "scan2.ply"]);
    assert_eq!(second["candidates"], both["candidates"], "as if both were given at once");
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_infer")).args(["--session", &session]).args(arguments).output().expect("runs")
    };
    let again = run(&["--json", "--distance", "0.9"]);
    let again: serde_json::Value = serde_json::from_slice(&again.stdout).expect("an answer");
    assert_eq!((&again["cloud"]["scans"], &again["candidates"][0]["working_distance_m"]), (&2.into(), &0.9.into()));
    let third = sample("scan1.ply").display().to_string();
    let missing = run(&["--scan", &third, "nowhere.ply"]);
    let error = String::from_utf8_lossy(&missing.stderr);
    assert!(!missing.status.success() && error.contains("nowhere.ply"), "{error}");
    let after = run(&["--json"]);
    let after: serde_json::Value = serde_json::from_slice(&after.stdout).expect("an answer");
    assert_eq!(after["cloud"]["scans"], 2, "none is added where one cannot be read");
}

#[test]
fn a_command_that_cannot_plan_adds_no_scan_to_its_session() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (session, cell, poses, plan) = (at("part"), at("cell.toml"), at("poses.txt"), at("plan.csv"));
    answer(&["--session", &session, "--from", "0.0762,-0.5734,1.0514"], &["scan1.ply"]);
    let pose = "[[0.0, 0.5, -0.866, 0.78], [1.0, 0.0, 0.0, 0.0], [0.0, -0.866, -0.5, 0.45], [0.0, 0.0, 0.0, 1.0]]";
    let table = format!("[turntable]\nrange_deg = [0.0, 360.0]\nstep_deg = 45.0\ncell_from_camera = {pose}\n");
    std::fs::write(&cell, table).expect("written");
    std::fs::write(&poses, "1 0 0 0\n0 1 0 0\n0 0 1 -1\n0 0 0 1\n").expect("written");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
        command.args(["--session", &session]).args(arguments).output().expect("runs")
    };
    let scan = sample("scan2.ply").display().to_string();
    let (missing, blocked) = (at("missing.txt"), at("poses.txt/report.html"));
    for (arguments, said) in [
        (vec!["--views-from", &missing], "missing.txt"),
        (vec!["--views-from", &poses, "--config", &cell], "the camera is fixed"),
        (vec!["--views-from", &poses, "--planner", "benbv-net"], "--planner volumetric or farthest"),
        (vec!["--plan", &plan, "--planner", "farthest"], "--planner auto or volumetric"),
        (vec!["--report", &blocked], "poses.txt"),
    ] {
        let output = run(&[&["--scan", &scan, "--from", "0.5046,-0.6854,-0.8223"][..], &arguments].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && error.contains(said), "{arguments:?}: {error}");
        let after: serde_json::Value = serde_json::from_slice(&run(&["--json"]).stdout).expect("an answer");
        assert_eq!(after["cloud"]["scans"], 1, "{arguments:?}");
    }
}

#[test]
fn a_session_takes_a_pose_in_metres_beside_a_cloud_that_names_its_unit() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (session, cloud) = (at("part"), at("millimetres.xyz"));
    let points = formats::cloud::read_cloud(&sample("scan1.ply")).expect("a cloud").cloud.points;
    let rows = points.iter().map(|p| format!("{} {} {}\n", 1000.0 * p.x, 1000.0 * p.y, 1000.0 * p.z));
    std::fs::write(&cloud, "x[mm] y[mm] z[mm]\n".to_owned() + &rows.collect::<String>()).expect("written");
    let position = nalgebra::Point3::new(0.0762, -0.5734, 1.0514);
    let view = geometry::View { target: nalgebra::Point3::origin(), position }.world_from_camera();
    let q = view.rotation.coords;
    let pose = format!("0.0762,-0.5734,1.0514,{},{},{},{}", q.x, q.y, q.z, q.w);
    let once = answer(&["--pose", &pose], &[&cloud]);
    assert_eq!(once["evidence"], "camera_positions", "{once}");
    let kept = answer(&["--session", &session, "--pose", &pose], &[&cloud]);
    assert_eq!((&kept["evidence"], &kept["candidates"]), (&once["evidence"], &once["candidates"]));
}

/// A PCD of a shallow bowl, seen by a pinhole camera from where its numbers begin; around it there is nothing.
fn organised(viewpoint: &str) -> String {
    let row = |i: u32| {
        let (x, y) = ((f64::from(i % 64) - 31.5) / 55.0, (f64::from(i / 64) - 23.5) / 55.0);
        let z = 0.6 + 0.1 * (x * x + y * y);
        if x.hypot(y) < 0.3 { format!("{} {} {z}\n", x * z, y * z) } else { "nan nan nan\n".to_owned() }
    };
    let head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 64\nHEIGHT 48\n";
    let rows: String = (0..64 * 48).map(row).collect();
    format!("{head}VIEWPOINT {viewpoint}\nPOINTS 3072\nDATA ascii\n{rows}")
}

#[test]
fn a_session_keeps_the_pose_of_an_organised_cloud_in_its_cameras_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (session, cloud) = (at("part"), at("organised.pcd"));
    // The file tells another pose, from which its points lie behind.
    std::fs::write(&cloud, organised("0 0 5 1 0 0 0")).expect("written");
    let pose = ["--pose", "0.1,0.2,0.3,0,0.6,0,0.8"];
    let once = answer(&pose, &[&cloud]);
    assert_eq!(once["evidence"], "depth", "{once}");
    assert_ne!(once["candidates"], answer(&[], &[&cloud])["candidates"], "the pose counts");
    assert!(once["warnings"].to_string().contains("the pose given was used instead"), "{}", once["warnings"]);
    let kept = answer(&[&pose[..], &["--session", &session]].concat(), &[&cloud]);
    let again = Command::new(env!("CARGO_BIN_EXE_infer")).args(["--session", &session, "--json"]).output();
    let again: serde_json::Value = serde_json::from_slice(&again.expect("infer runs").stdout).expect("an answer");
    for (answer, when) in [(kept, "as it is added"), (again, "read again")] {
        for key in ["evidence", "candidates", "warnings"] {
            assert_eq!(answer[key], once[key], "{key}, {when}");
        }
    }
}

#[test]
fn what_an_organised_cloud_leaves_out_is_unknown_on_every_way_in() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (session, cloud) = (at("part"), at("organised.pcd"));
    std::fs::write(&cloud, organised("0 0 0 1 0 0 0")).expect("written");
    let once = answer(&["--set", "misses=free"], &[&cloud]);
    assert_eq!(once["evidence"], "depth", "{once}");
    let kept = answer(&["--session", &session, "--set", "misses=free"], &[&cloud]);
    assert_eq!((&kept["evidence"], &kept["candidates"]), (&once["evidence"], &once["candidates"]));
}

#[test]
fn no_input_is_overwritten_and_no_output_by_another() {
    let folder = tempfile::tempdir().expect("a folder");
    let scan = folder.path().join("mine.ply");
    std::fs::copy(sample("scan1.ply"), &scan).expect("copied");
    let measured = std::fs::read(&scan).expect("read");
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
        let output = command.current_dir(folder.path()).args(["--scan", "mine.ply", "--from", "0.0762,-0.5734,1.0514"]);
        let output = output.args(arguments).output().expect("runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    for (arguments, other) in [
        (vec!["--mesh", "mine.ply"], "--scan"),
        (vec!["--cloud", "./mine.ply"], "--scan"),
        (vec!["--mesh", "same.ply", "--ply", "same.ply"], "--mesh"),
        (vec!["--report", "."], "a directory"),
    ] {
        let (code, error) = run(&arguments);
        assert!(code == Some(1) && error.contains(other), "{arguments:?}: {code:?} {error}");
    }
    assert_eq!(std::fs::read(&scan).expect("read"), measured);
    assert!(!folder.path().join("same.ply").exists());
}

#[cfg(unix)]
#[test]
fn a_session_takes_a_file_whose_name_is_no_text() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().expect("a folder");
    let scan = folder.path().join(std::ffi::OsStr::from_bytes(b"t\xe4.ply"));
    std::fs::copy(sample("scan1.ply"), &scan).expect("copied");
    let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
    let output = command
        .current_dir(folder.path())
        .args(["--session", "kept", "--from", "0.0762,-0.5734,1.0514", "--scan"])
        .arg(&scan);
    let output = output.output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn weights_of_ones_own_replace_the_bundled_ones() {
    let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/benbv-net");
    let same = answer(&["--weights", &bundled.display().to_string()], &["scan1.ply"]);
    assert_eq!(same["candidates"], answer(&[], &["scan1.ply"])["candidates"]);
    let missing = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--weights", "no/such/place", "--scan"])
        .arg(sample("scan1.ply"))
        .output()
        .expect("infer runs");
    let error = String::from_utf8_lossy(&missing.stderr);
    assert!(!missing.status.success() && error.contains("no/such/place"), "{error}");
}

#[test]
fn a_cloud_takes_its_camera_from_a_pose_or_a_position() {
    // The camera of scan1 (samples): at (0.0762, -0.5734, 1.0514), looking at the origin; rows are right, down and forward as columns.
    let position = nalgebra::Point3::new(0.0762, -0.5734, 1.0514);
    let m = geometry::View { target: nalgebra::Point3::origin(), position }.world_from_camera().to_homogeneous();
    let rows: Vec<String> =
        (0..4).map(|r| format!("{} {} {} {}\r\n", m[(r, 0)], m[(r, 1)], m[(r, 2)], m[(r, 3)])).collect();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("pose.txt").display().to_string();
    std::fs::write(&file, format!("# by hand\r\n{}", rows.concat())).expect("written");
    let posed = answer(&["--pose", &file], &["scan1.ply"]);
    assert_eq!(posed["evidence"], "camera_positions");
    assert_eq!(posed["candidates"], answer(&["--from", "0.0762,-0.5734,1.0514"], &["scan1.ply"])["candidates"]);
    let refused = |arguments: &[&str], expected: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_infer"))
            .arg("--scan")
            .arg(sample("scan1.ply"))
            .args(arguments)
            .output()
            .expect("infer runs");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && error.contains(expected), "{arguments:?}: {error}");
    };
    refused(&["--pose", &file, "--from", "0.0762,-0.5734,1.0514"], "pose and --from both");
    refused(&["--pose", &file, &file], "2 --pose for 1 --scan");
    std::fs::write(&file, "1 0 0 1\n0 1 0\n").expect("written");
    refused(&["--pose", &file], "line 2: found 3 numbers");
    refused(&["--views-from", &file], "line 2: found 3 numbers");
}

#[test]
fn a_plan_of_several_views_is_a_list() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let from = ["--from", "0.0762,-0.5734,1.0514", "--plan-views", "4"];
    let made = |name: &str, more: &[&str]| {
        let path = at(name).display().to_string();
        let output = Command::new(env!("CARGO_BIN_EXE_infer"))
            .args(["--scan", &sample("scan1.ply").display().to_string()])
            .args(from)
            .args(["--plan", &path])
            .args(more)
            .output()
            .expect("infer runs");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        std::fs::read_to_string(&path).map_err(|_| error)
    };
    let json: serde_json::Value = serde_json::from_str(&made("a.json", &[]).expect("a plan")).expect("JSON");
    let views = json["views"].as_array().expect("a list");
    assert!((2..=4).contains(&views.len()), "{json}");
    let travel: f64 = views.iter().filter_map(|v| v["travel_m"].as_f64()).sum();
    assert!((travel - json["travel_m"].as_f64().expect("metres")).abs() < 1e-9, "{json}");
    let csv = made("a.csv", &[]).expect("a plan");
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), views.len() + 1);
    for (row, view) in rows[1..].iter().zip(views) {
        for (name, cell) in rows[0].iter().zip(row) {
            let told = view.get(*name).and_then(serde_json::Value::as_f64);
            let off = cell.parse::<f64>().ok().zip(told).map_or(0.0, |(a, b)| (a - b).abs());
            assert!(cell.is_empty() == told.is_none() && off < 1e-12, "{name}: {cell} {told:?}");
        }
    }
    let yaml = made("a.yaml", &[]).expect("a plan");
    assert_eq!(yaml.lines().filter(|line| line.starts_with("- x_m: ")).count(), views.len(), "{yaml}");
    let refused = made("a.txt", &[]).expect_err("no format");
    assert!(refused.contains("a.txt") && refused.contains(".json, .yaml or .csv"), "{refused}");
    let blind = made("b.csv", &["--planner", "farthest"]).expect_err("it forecasts nothing");
    assert!(blind.contains("--plan") && blind.contains("volumetric"), "{blind}");
}

#[test]
fn an_answer_is_told_and_its_scan_kept_once_where_there_is_no_plan() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    // A blade, seen on its edge: what one look shows of it does not close.
    let edge = geometry::DepthImage { origin: [639, 321], size: [2, 78], depth: vec![1.2; 2 * 78] };
    let (image, plan, session) = (at("edge.png"), at("plan.csv"), at("part"));
    formats::depth::write_depth(Path::new(&image), &edge, 1280, 720, 0.001).expect("written");
    let camera = "514.1332824271612,514.1332824271612,640,360";
    let scan = ["--depth", &image, "--pose", "0,0,0,0,0,0,1", "--intrinsics", camera, "--misses", "free"];
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
        command.args(["--session", &session, "--planner", "volumetric"]).args(more).output().expect("runs")
    };
    let failed = run(&[&scan[..], &["--plan", &plan]].concat());
    let (told, error) = (String::from_utf8_lossy(&failed.stdout), String::from_utf8_lossy(&failed.stderr));
    assert_eq!(failed.status.code(), Some(1), "{error}");
    assert!(told.contains("next view: score"), "{told}");
    let said = "gains are not predicted from this scan alone; take another";
    assert!(error.contains(said) && !error.contains("use --planner"), "{error}");
    assert!(error.contains("the scans were added, so repeat the command without them"), "{error}");
    assert!(!Path::new(&plan).exists());
    let after: serde_json::Value = serde_json::from_slice(&run(&["--json"]).stdout).expect("an answer");
    assert_eq!(after["cloud"]["scans"], 1);
}

#[test]
fn a_command_says_which_of_its_scans_were_added() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("part").display().to_string();
    let few = folder.path().join("few.xyz");
    std::fs::write(&few, "0 0 0\n0 0 1\n").expect("written");
    let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
    let output = command.args(["--session", &session, "--scan"]).arg(sample("scan1.ply")).arg(&few).output();
    let output = output.expect("runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && error.contains("too few points"), "{error}");
    assert!(error.contains("few.xyz\" (the scans before it were added"), "{error}");
}

#[test]
fn a_file_name_with_a_line_feed_stays_within_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let named = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).expect("written");
        path.display().to_string()
    };
    let (cloud, odd) = (sample("scan1.ply").display().to_string(), named("a\nb.xyz", "0 0 zero\n"));
    let (poses, depth) = (named("p\n\u{1b}[31m.conf", "bmesh a.ply 0 0 0 0 0 0 1\n"), named("d\n.npy", "no array"));
    for arguments in [
        &["--scan", &odd][..],
        &["--scan", &cloud, "--pose", &poses],
        &["--scan", &cloud, "--pose", &odd],
        &["--scan", &cloud, "--views-from", &poses],
        &["--scan", &cloud, "--plan", &odd],
        &["--scan", &cloud, "--weights", &odd],
        &["--scan", &cloud, "--session", &odd],
        &["--depth", &depth, "--pose", &odd],
        &["--scan", &cloud, "--config", &format!("{odd}.missing")],
        &["--object", &odd],
        &["--serve", "--state", &odd],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_infer")).args(arguments).output().expect("infer runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.lines().count() == 1, "{arguments:?}: {text}");
        assert!(text.contains("\\n") && !text.contains('\u{1b}'), "{arguments:?}: {text}");
    }
}
