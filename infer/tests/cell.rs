//! The program in a cell: a turntable, an arm, a calibrated lens, a table.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn sample(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples").join(name).display().to_string()
}

fn infer(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_infer")).args(arguments).output().expect("infer runs")
}

fn answer(arguments: &[&str]) -> Value {
    let output = infer(&[arguments, &["--json"]].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("an answer")
}

fn error(arguments: &[&str]) -> String {
    let output = infer(arguments);
    assert!(!output.status.success());
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_fixed_camera_and_a_turntable_close_the_loop() {
    let folder = tempfile::tempdir().expect("a folder");
    let cell = folder.path().join("cell.toml");
    // 0.9 m away, 30 degrees above the table: right along y, down and forward in x and z.
    let pose = "[[0.0, 0.5, -0.866, 0.78], [1.0, 0.0, 0.0, 0.0], [0.0, -0.866, -0.5, 0.45], [0.0, 0.0, 0.0, 1.0]]";
    let text = format!(
        "working_distance_m = 0.9\n[turntable]\nrange_deg = [0.0, 360.0]\nstep_deg = 45.0\ncell_from_camera = {pose}\n"
    );
    std::fs::write(&cell, text).expect("a file");
    let cell = cell.display().to_string();
    let output = infer(&["--object", "procedural:3", "--views", "4", "--config", &cell, "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let steps: Vec<Value> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).expect("a step"))
        .collect();
    assert_eq!(steps.len(), 6, "five views, and what was within reach");
    assert!(steps[5]["coverage"].as_f64().is_some_and(|covered| covered > 0.9), "{}", steps[5]);
    let mut stops = Vec::new();
    for step in &steps[1..5] {
        let stop = step["table_stop_deg"].as_f64().expect("a stop");
        assert!(stop % 45.0 == 0.0 && !stops.contains(&stop), "{stop} after {stops:?}");
        stops.push(stop);
        // The camera, turned back with the table, stands where it is.
        let at = |k: usize| step["world_from_camera"]["translation_m"][k].as_f64().expect("metres");
        let (sin, cos) = stop.to_radians().sin_cos();
        let in_cell = [cos * at(0) - sin * at(1), sin * at(0) + cos * at(1), at(2)];
        let off = in_cell.iter().zip([0.78, 0.0, 0.45]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{in_cell:?}");
    }
    let coverage = |i: usize| steps[i]["coverage"].as_f64().expect("a share");
    assert!(coverage(4) > coverage(0) + 0.2, "{} to {}", coverage(0), coverage(4));
    let wrong = error(&["--scan", &sample("scan1.ply"), "--from", "0.0762,-0.5734,1.0514", "--table-angle-deg", "30"]);
    assert!(wrong.contains("table angle of 30 degrees, but no turntable"), "{wrong}");
    let count = error(&["--config", &cell, "--scan", &sample("scan1.ply"), "--table-angle-deg", "30", "60"]);
    assert!(count.contains("2 --table-angle-deg for 1 scans"), "{count}");
    let given = [
        "--config",
        &cell,
        "--scan",
        &sample("scan1.ply"),
        "--from",
        "0.0762,-0.5734,1.0514",
        "--table-angle-deg",
        "-30",
    ];
    let next = answer(&given)["next"].clone();
    assert!(next["table"]["stop_deg"].is_number() && next["table"]["cell_from_camera"]["matrix"].is_array(), "{next}");
    let session = folder.path().join("kept").display().to_string();
    assert_eq!(answer(&[&given[..], &["--session", &session]].concat())["next"], next, "kept with its angle");
    assert_eq!(answer(&["--config", &cell, "--session", &session])["next"], next, "and read again");
}

#[test]
fn the_loop_tells_poses_as_the_camera_is_mounted() {
    // How steeply one of the camera's axes points upwards at each view, as a sine.
    let heights = |axis: usize, arguments: &[&str]| -> Vec<f64> {
        let output = infer(&[&["--object", "procedural:3", "--views", "2", "--json"][..], arguments].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let steps = text.lines().map(|line| serde_json::from_str::<Value>(line).expect("a step"));
        steps.filter_map(|step| step["world_from_camera"]["matrix"][2][axis].as_f64()).collect()
    };
    // On its side: what is down in the image is level.
    let on_its_side = heights(1, &["--set", "pose.extra_roll_deg=90"]);
    assert!(on_its_side.len() == 3 && on_its_side.iter().all(|z| z.abs() < 1e-9), "{on_its_side:?}");
    let folder = tempfile::tempdir().expect("a folder");
    let cell = folder.path().join("cell.toml");
    let pose = "[[0.5, 0.0, -0.866, 0.78], [0.0, -1.0, 0.0, 0.0], [-0.866, 0.0, -0.5, 0.45], [0.0, 0.0, 0.0, 1.0]]";
    let table = format!("[turntable]\nrange_deg = [0.0, 360.0]\nstep_deg = 45.0\ncell_from_camera = {pose}\n");
    std::fs::write(&cell, format!("working_distance_m = 0.9\n{table}")).expect("written");
    let fixed = heights(0, &["--config", &cell.display().to_string()]);
    assert!(fixed.len() == 3 && fixed.iter().all(|z| (z + 0.866).abs() < 1e-4), "{fixed:?}");
}

#[test]
fn an_arm_answers_with_joint_values_or_the_reason() {
    let urdf = sample("robots/ur5e.urdf");
    let base = "robot.cell_from_base=[[1,0,0,0.55],[0,1,0,0],[0,0,1,-0.2],[0,0,0,1]]";
    let scan = sample("scan1.ply");
    let free = ["--scan", &scan, "--from", "0.0762,-0.5734,1.0514", "--distance", "0.5"];
    let arm = ["--robot", &urdf, "--tool", "tool0", "--flange-from-camera", "0,0.05,0.03,0,0,0,1", "--set", base];
    let with = answer(&[&free[..], &arm].concat());
    let candidates = with["candidates"].as_array().expect("a list");
    let next = &with["next"];
    assert_eq!(next["reached"]["joints"].as_array().map(Vec::len), Some(6), "{next}");
    let constraints: Vec<&str> = candidates
        .iter()
        .flat_map(|c| c["objections"].as_array().expect("a list"))
        .filter_map(|o| o["constraint"].as_str())
        .collect();
    assert!(constraints.contains(&"reach") || constraints.contains(&"collision"), "{constraints:?}");
    for candidate in candidates {
        let allowed = candidate["objections"].as_array().is_some_and(Vec::is_empty);
        assert_eq!(candidate["reached"].is_object(), allowed, "{candidate}");
    }
    let text = infer(&[&free[..], &arm].concat());
    assert!(String::from_utf8_lossy(&text.stdout).contains("joints shoulder_pan_joint"));
    let wrong =
        error(&["--scan", &scan, "--robot", &urdf, "--tool", "gripper", "--flange-from-camera", "0,0,0,0,0,0,1"]);
    assert!(wrong.contains("no link \"gripper\"") && wrong.contains("tool0"), "{wrong}");
    let nowhere = error(&[&free[..4], &arm].concat());
    assert!(nowhere.contains("at which distance from the object") && nowhere.contains("--distance"), "{nowhere}");
    let set = ["--set", "working_distance_m=1.2"];
    let far = answer(&[&free[..4], &arm, &set].concat());
    assert!(far["warnings"].to_string().contains("the arm does not reach"), "{}", far["warnings"]);
    let bare = error(&["--scan", &scan, "--robot", &urdf, "--tool", "tool0"]);
    assert!(bare.contains("robot.flange_from_camera") && bare.contains("hand-eye"), "{bare}");
}

#[test]
fn a_session_keeps_images_as_they_came_and_undistorts_them_alike() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    let scans = at("scans").display().to_string();
    let made = infer(&["--object", "procedural:3", "--views", "2", "--export-scans", &scans]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let (image, pose) = (format!("{scans}/depth3.png"), format!("{scans}/depth3.json"));
    let told: Value = serde_json::from_slice(&std::fs::read(&pose).expect("a pose")).expect("JSON");
    let [fx, fy, cx, cy] = [0, 1, 2, 3].map(|k| told["intrinsics"][k].as_f64().expect("pixels"));
    let file = at("camera.yaml");
    let text = format!(
        "image_width: 1280\nimage_height: 720\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [{fx}, 0, {cx}, 0, {fy}, {cy}, 0, 0, 1]\n\
         distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.2, -0.1, 0.002, 0.001, 0]\n"
    );
    std::fs::write(&file, text).expect("a file");
    let file = file.display().to_string();
    let given = ["--depth", &image, "--pose", &pose, "--camera", &file];
    let once = answer(&given);
    let plain = answer(&given[..4]);
    assert_ne!(once["cloud"]["bounding_box_m"], plain["cloud"]["bounding_box_m"], "the lens counts");
    let session = at("kept").display().to_string();
    let kept = answer(&[&given[..], &["--session", &session]].concat());
    let again = answer(&["--session", &session, "--camera", &file]);
    for kept in [kept, again] {
        let same = kept["cloud"] == once["cloud"] && kept["candidates"] == once["candidates"];
        assert!(same, "to the last digit, whenever it is read: {kept}");
    }
    // What contradicts the file of the pose is warned of in a session, too, whenever it is read.
    let other = format!("{},{fy},{cx},{cy}", fx + 5.0);
    let contradicting = ["--depth", &image, "--pose", &pose, "--intrinsics", &other];
    let session = at("warned").display().to_string();
    let kept = [&contradicting[..], &["--session", &session]].concat();
    for arguments in [&contradicting[..], &kept[..], &["--session", &session]] {
        let warnings = answer(arguments)["warnings"].to_string();
        let told = warnings.contains("depth3.png") && warnings.contains("were used as --intrinsics says");
        assert!(told, "{arguments:?}: {warnings}");
    }
    let far = answer(
        &[&given[..], &["--set", "sensor.max_range_m=0.5", "--distance", "0.4", "--set", "min_points=0"]].concat(),
    );
    assert!(far["warnings"].to_string().contains("points outside the sensor's range"), "{far}");
}

#[cfg(unix)]
#[test]
fn scans_of_the_loop_show_the_table_that_it_saw_and_are_planned_on_alike() {
    let folder = tempfile::tempdir().expect("a folder");
    let written = |name: &str, more: &[&str]| {
        let scans = folder.path().join(name).display().to_string();
        let made = infer(&[&["--object", "procedural:3", "--views", "2", "--export-scans", &scans][..], more].concat());
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let cloud = formats::cloud::read_cloud(&Path::new(&scans).join("scan1.ply")).expect("a cloud").cloud;
        let width = |k: usize| {
            let along = || cloud.points.iter().map(move |p| p[k]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        };
        (width(0).max(width(1)), String::from_utf8_lossy(&made.stdout).into_owned(), scans)
    };
    let (alone, commands, scans) = written("floating", &[]);
    assert!(alone < 0.21, "an object of 0.2 m is {alone} m wide");
    assert!(commands.contains(&format!("--pose {scans}/depth3.json --misses free\n")), "{commands}");
    let (on_table, commands, scans) = written("on a table", &["--support", "auto", "--distance", "0.9"]);
    assert!(on_table > 0.25, "a table of 0.3 m is {on_table} m wide");
    assert!(commands.contains(&format!("--scan '{scans}/scan1.ply' '{scans}/scan2.ply' --from ")), "{commands}");
    let json = written("json", &["--json"]).1;
    let last: Value = serde_json::from_str(json.lines().last().expect("a line")).expect("JSON, every line");
    assert_eq!(last["commands"].as_array().map(Vec::len), Some(2), "{last}");
    let alike = format!("--pose '{scans}/depth3.json' --misses free --distance 0.9 --support auto\n");
    assert!(commands.contains(&alike), "{commands}");
}
