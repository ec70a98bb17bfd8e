//! What `--state` and `--session` keep beside the scans of sessions, and what becomes of it at a restart.

mod server;

use geometry::View;
use nalgebra::{Isometry3, Point3, Translation3};
use serde_json::{Value, json};
use server::{Server, sheet};
use std::process::Command;

/// A service that keeps its sessions in this folder.
struct Kept(tempfile::TempDir);

impl Kept {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn folder(&self) -> String {
        self.0.path().join("state").display().to_string()
    }

    fn start(&self, more: &[&str]) -> Server {
        Server::start_with(&[&["--planner", "volumetric", "--state", &self.folder()][..], more].concat())
    }

    fn restart(&self, mut server: Server, more: &[&str]) -> Server {
        server.process.kill().expect("SIGKILL");
        server.process.wait().expect("gone");
        self.start(more)
    }
}

fn with_key(server: &Server, key: &str, method: &str, path: &str) -> (u16, Value) {
    server.ask_with(&format!("Idempotency-Key: {key}\r\n"), method, path, "")
}

fn camera() -> Point3<f64> {
    Point3::new(0.7, 0.8, 0.9)
}

/// Three sides of a box, 80 mm long, as seen from [`camera`], moved.
fn sides(by: &Isometry3<f64>) -> Vec<Point3<f64>> {
    let at = |u: u32, v: u32| (0.002 * f64::from(u), 0.002 * f64::from(v));
    let faces = |(u, v)| [Point3::new(u, v, 0.08), Point3::new(u, 0.08, v), Point3::new(0.08, u, v)];
    (0..40).flat_map(|u| (0..40).map(move |v| at(u, v))).flat_map(faces).map(|p| by * p).collect()
}

/// What the camera would see at this view of another box, half a metre behind.
fn elsewhere(next: &Value) -> Vec<Point3<f64>> {
    let point = |key: &str| -> Point3<f64> { serde_json::from_value(next[key].clone()).expect("a point") };
    let own = View { target: Point3::new(0.04, 0.04, 0.04), position: camera() };
    let view = View { target: point("target_m"), position: point("position_m") };
    let behind = Translation3::new(0.0, 0.0, 0.5);
    sides(&(view.world_from_camera() * behind * own.world_from_camera().inverse()))
}

/// Why the view of `next` must not be taken, by this answer.
fn objections<'a>(answer: &'a Value, next: &Value) -> &'a Value {
    let candidates = answer["candidates"].as_array().expect("a list");
    let same = candidates.iter().find(|c| c["position_m"] == next["position_m"]);
    &same.expect("still scored")["objections"]
}

#[test]
fn views_whose_scan_was_rejected_stay_ruled_out_after_a_restart() {
    let kept = Kept::new();
    let refine = ["--register", "refine"];
    let server = kept.start(&refine);
    server.session();
    let next = |server: &Server| server.ask("POST", "/sessions/1/next", "").1;
    let scan = |points: &[Point3<f64>], from: &Value| json!({ "points": points, "from": from }).to_string();
    let first = scan(&sides(&Isometry3::identity()), &json!(camera()));
    assert_eq!(server.ask("POST", "/sessions/1/scans", &first).0, 200);
    let view = next(&server)["next"].clone();
    let (status, answer) = server.ask("POST", "/sessions/1/scans", &scan(&elsewhere(&view), &view["position_m"]));
    assert_eq!((status, &answer["error"]["code"]), (422, &json!("unregistered")), "{answer}");
    let before = next(&server);
    assert_eq!(objections(&before, &view)[0]["constraint"], "registrability");
    // A refusal for another reason changes nothing.
    assert_eq!(server.ask("POST", "/sessions/1/scans", r#"{"points": [[1, 2, 3]]}"#).0, 422);
    let server = kept.restart(server, &refine);
    assert_eq!(next(&server), before);
    assert_eq!(server.ask("POST", "/sessions/1/scans", &first).0, 200, "another scan");
    let server = kept.restart(server, &refine);
    let after = next(&server);
    assert!(!after.to_string().contains("a scan from here could not be registered"), "{after}");
}

#[test]
fn a_command_rules_out_what_an_earlier_one_could_not_register() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let run = |points: Vec<Point3<f64>>, from: &[f64]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
        command.args(["--session", &at("part"), "--register", "refine", "--json"]);
        if !points.is_empty() {
            let cloud = geometry::PointCloud { points, normals: Vec::new() };
            formats::cloud::write_ply(&folder.path().join("scan.ply"), &cloud).expect("written");
            let from = from.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            command.args(["--scan", &at("scan.ply"), &format!("--from={from}")]);
        }
        command.output().expect("runs")
    };
    let answer = |output: std::process::Output| -> Value {
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)))
    };
    let view = answer(run(sides(&Isometry3::identity()), &[0.7, 0.8, 0.9]))["next"].clone();
    let from: Vec<f64> = serde_json::from_value(view["position_m"].clone()).expect("a point");
    let rejected = run(elsewhere(&view), &from);
    let error = String::from_utf8_lossy(&rejected.stderr);
    assert!(rejected.status.code() == Some(1) && error.contains("cannot be registered"), "{error}");
    let after = answer(run(Vec::new(), &[]));
    assert_eq!(after["cloud"]["scans"], 1);
    assert_eq!(objections(&after, &view)[0]["constraint"], "registrability", "{}", after["next"]);
}

#[test]
fn who_created_or_deleted_a_session_is_answered_again_after_a_restart() {
    let kept = Kept::new();
    let server = kept.start(&[]);
    let create = |server: &Server, key: &str| with_key(server, key, "POST", "/sessions");
    let delete = |server: &Server| with_key(server, "d", "DELETE", "/sessions/2");
    let first = create(&server, "a");
    assert_eq!((first.0, &first.1), (201, &json!({ "session": "1" })));
    let server = kept.restart(server, &[]);
    assert_eq!(create(&server, "a"), first, "the one of the last restart");
    assert_eq!(server.ask("POST", "/sessions/1/scans", &sheet(30)).0, 200, "its record is written anew");
    let server = kept.restart(server, &[]);
    assert_eq!(create(&server, "a"), first);
    let second = create(&server, "b");
    assert_eq!(second.1, json!({ "session": "2" }));
    let deleted = delete(&server);
    assert_eq!(deleted.0, 200);
    let server = kept.restart(server, &[]);
    assert_eq!((create(&server, "a"), create(&server, "b"), delete(&server)), (first, second, deleted));
    let other = with_key(&server, "d", "DELETE", "/sessions/1");
    assert_eq!((other.0, &other.1["error"]["code"]), (409, &json!("key_reused")));
    assert_eq!(server.ask("GET", "/sessions", "").1["sessions"], json!(["1"]));
}

#[test]
fn a_scan_larger_than_is_allowed_now_is_not_called_damaged() {
    let kept = Kept::new();
    let server = kept.start(&[]);
    server.session();
    let large = sheet(30) + &" ".repeat(12 << 20);
    assert_eq!(server.ask("POST", "/sessions/1/scans", &large).0, 200);
    let server = kept.restart(server, &["--set", "service.body_mib=1"]);
    let (status, answer) = server.ask("POST", "/sessions/1/next", "");
    let message = answer["error"]["message"].as_str().unwrap_or_default();
    assert!(status == 500 && message.contains("scan-0001") && !message.contains("delete"), "{answer}");
    let enough = message.split("raise it to ").nth(1).expect("the way out");
    let server = kept.restart(server, &["--set", &format!("service.body_mib={enough}")]);
    assert_eq!(server.ask("POST", "/sessions/1/next", "").0, 200);
}

#[test]
fn a_session_of_commands_may_keep_all_points_and_is_named_where_it_has_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let cloud = geometry::PointCloud { points: sides(&Isometry3::identity()), normals: Vec::new() };
    formats::cloud::write_ply(&folder.path().join("scan.ply"), &cloud).expect("written");
    let run = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_infer")).args(arguments).output().expect("runs");
        (serde_json::from_slice::<Value>(&output.stdout).ok(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (scan, part) = (at("scan.ply"), at("part"));
    let given = ["--json", "--set", "max_points=0", "--scan", &scan, "--from", "0.7,0.8,0.9"];
    let (kept, error) = run(&[&given[..], &["--session", &part]].concat());
    assert!(kept.is_some() && kept == run(&given).0, "{error}");
    let (none, error) = run(&["--session", &at("prat")]);
    assert!(none.is_none() && error.contains("prat\": there is no scan yet"), "{error}");
}

#[test]
fn a_command_does_not_choose_among_several_sessions() {
    let kept = Kept::new();
    let mut server = kept.start(&[]);
    for _ in 0..2 {
        server.session();
    }
    server.process.kill().expect("SIGKILL");
    server.process.wait().expect("gone");
    let folder = kept.folder();
    let output = Command::new(env!("CARGO_BIN_EXE_infer")).args(["--session", &folder]).output().expect("runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{told}");
    for part in [folder.as_str(), "the sessions 1, 2,", "--serve --state", "another directory"] {
        assert!(told.contains(part), "{part}: {told}");
    }
}
