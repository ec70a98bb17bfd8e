//! The service as a robot meets it: over stdin and over HTTP, under load and ill-treated.
//!
//! The full load of docs/robots.md (1,000 requests): `cargo test --release --test service -- --ignored --nocapture`.

mod server;

use serde_json::{Value, json};
use server::{Server, malformed, sheet};
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn a_session_over_http() {
    let server = Server::start();
    assert_eq!(server.ask("GET", "/health", "").1["status"], "ok", "the service is there");
    let id = server.session();
    let path = |what: &str| format!("/sessions/{id}/{what}");
    let (status, answer) = server.ask("POST", &path("next"), "");
    assert_eq!((status, &answer["error"]["code"]), (422, &json!("no_scan")), "nothing to plan on");
    let (status, answer) = server.ask("POST", &path("scans"), &sheet(30));
    assert_eq!((status, &answer["report"]["used"]), (200, &json!(900)), "{answer}");
    let (status, first) = server.ask("POST", &path("next"), "{}");
    assert_eq!(status, 200, "{first}");
    assert!(first["next"]["world_from_camera"]["matrix"][0][0].is_number(), "a pose: {first}");
    let (_, limited) = server.ask("POST", &path("next"), r#"{"config": {"constraints": {"floor_height_m": 99}}}"#);
    assert!(limited["next"].is_null() && limited["excluded"][0]["constraint"] == "floor", "{limited}");
    let (_, back) = server.ask("POST", &path("next"), r#"{"config": {"constraints": {"floor_height_m": null}}}"#);
    assert_eq!(back, first, "the same settings, the same answer");
    let (_, export) = server.ask("GET", &path("export"), "");
    assert_eq!(export["points_m"].as_array().map(Vec::len), Some(900), "the cloud comes back");
    assert_eq!(server.ask("POST", &path("undo"), "").1, json!({ "scans": 0 }), "the scan is taken back");
    assert_eq!(server.ask("POST", &path("undo"), "").0, 422, "nothing to take back");
    assert_eq!(server.ask("DELETE", &format!("/sessions/{id}"), "").0, 200, "the session ends");
    assert_eq!(server.ask("POST", &path("next"), "{}").0, 404, "and is gone");
}

#[test]
fn malformed_requests_are_answered_and_never_fatal() {
    let server = Server::start();
    let id = server.session();
    for (request, expected) in malformed(&server, &id) {
        let (status, answer) = server.raw(&request);
        let shown = String::from_utf8_lossy(&request[..request.len().min(120)]).into_owned();
        assert_eq!(status, expected, "{shown}: {answer}");
        if expected != 400 || request[0] != 0x16 {
            assert!(answer["error"]["message"].as_str().is_some_and(|m| m.len() > 10), "{shown}: {answer}");
        }
    }
    server.ask("POST", &format!("/sessions/{id}/scans"), &sheet(30));
    assert_eq!(server.ask("POST", &format!("/sessions/{id}/next"), "{}").0, 200, "the session lives on");
}

#[test]
fn only_loopback_is_served() {
    let output =
        Command::new(env!("CARGO_BIN_EXE_infer")).args(["--serve", "--http", "0.0.0.0:0"]).output().expect("runs");
    assert!(!output.status.success(), "must refuse");
    assert!(String::from_utf8_lossy(&output.stderr).contains("loopback"), "and say why");
}

#[test]
fn lines_over_stdin() {
    let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--serve", "--planner", "farthest"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut input = process.stdin.take().expect("piped");
    let mut output = BufReader::new(process.stdout.take().expect("piped"));
    let mut ask = |line: &str| -> Value {
        writeln!(input, "{line}").expect("the service reads");
        let mut answer = String::new();
        output.read_line(&mut answer).expect("the service answers");
        serde_json::from_str(&answer).expect("JSON")
    };
    assert_eq!(ask(r#"{"id": 7, "method": "create"}"#), json!({ "id": 7, "result": { "session": "1" } }));
    let scan = format!(r#"{{"id": "a", "method": "add_scan", "session": "1", "params": {}}}"#, sheet(30));
    assert_eq!(ask(&scan)["result"]["scans"], 1, "a scan");
    assert_eq!(ask("no json")["error"]["code"], "bad_request", "a bad line is answered");
    let unknown = ask(r#"{"id": {"n": [1]}, "method": "dance"}"#);
    assert_eq!((&unknown["id"], &unknown["error"]["code"]), (&json!({ "n": [1] }), &json!("bad_request")), "{unknown}");
    let odd = ask(r#"{"id": 9, "method": "health", "colour": "red"}"#);
    assert_eq!((&odd["id"], &odd["error"]["code"]), (&json!(9), &json!("bad_request")), "{odd}");
    assert_eq!(ask(r#"[10, "health"]"#)["error"]["code"], "bad_request", "a list is no request");
    let nothing = ask(r#"{"method": "reset", "session": "1", "params": null}"#);
    assert_eq!(nothing["result"]["scans"], 0, "{nothing}");
    assert_eq!(ask(&scan)["result"]["scans"], 1, "a scan");
    let device = ask(r#"{"method": "add_scan", "session": "1", "params": {"file": "/dev/zero"}}"#);
    assert!(device["error"]["message"].as_str().is_some_and(|m| m.contains("not a regular file")), "{device}");
    let keyed = scan.replace(r#""id": "a""#, r#""id": "b", "request_id": "k1""#);
    let [first, again] = [ask(&keyed), ask(&keyed.replace(r#""id": "b""#, r#""id": "c""#))];
    assert_eq!((&first["result"]["scans"], &again["result"]), (&json!(2), &first["result"]), "added once");
    let other = ask(r#"{"request_id": "k1", "method": "undo", "session": "1"}"#);
    assert_eq!(other["error"]["code"], "key_reused", "{other}");
    let missing = ask(r#"{"method": "add_scan", "session": "1", "params": {"file": "missing.ply"}}"#);
    assert!(missing["error"]["message"].as_str().is_some_and(|m| m.contains("missing.ply")), "{missing}");
    let next = ask(r#"{"id": 8, "method": "next_view", "session": "1"}"#);
    assert!(next["result"]["next"]["position_m"].is_array() && next["id"] == 8, "{next}");
    assert_eq!(ask(r#"{"method": "reset", "session": "1"}"#)["result"]["scans"], 0, "reset");
    drop(input);
    assert!(process.wait().expect("ends").success(), "the end of the input ends the service");
}

#[test]
fn a_repeated_request_is_answered_again_and_not_done_again() {
    let server = Server::start();
    let with =
        |key: &str, path: &str, body: &str| server.ask_with(&format!("Idempotency-Key: {key}\r\n"), "POST", path, body);
    let first = with("c", "/sessions", "{}");
    assert_eq!((first.0, &first), (201, &with("c", "/sessions", "{ }")), "one session");
    assert_eq!(server.ask("GET", "/health", "").1["sessions"], 1);
    let id = first.1["session"].as_str().expect("a name").to_owned();
    let scans = format!("/sessions/{id}/scans");
    let added = with("a", &scans, &sheet(30));
    assert_eq!((added.0, &added), (200, &with("a", &scans, &sheet(30))));
    let (status, answer) = with("a", &scans, &sheet(31));
    assert_eq!((status, &answer["error"]["code"]), (409, &json!("key_reused")), "{answer}");
    assert_eq!(server.ask("GET", "/sessions", "").1["open"][0]["scans"], 1, "one scan");
    let next = format!("/sessions/{id}/next");
    assert_eq!(with("n", &next, "{}"), with("n", &next, "{}"));
    assert_eq!(with("bad key", &next, "{}").0, 400, "a key is visible ASCII");
    let gone = server.ask_with("Idempotency-Key: d\r\n", "DELETE", &format!("/sessions/{id}"), "");
    assert_eq!(gone, server.ask_with("Idempotency-Key: d\r\n", "DELETE", &format!("/sessions/{id}"), ""));
    assert_eq!(gone.0, 200, "{}", gone.1);
}

#[test]
fn a_body_that_is_too_large_says_what_may_be_larger() {
    let server = Server::start_with(&["--planner", "farthest", "--set", "service.body_mib=1"]);
    for (path, said) in [("/sessions", "only those of scans may be"), ("/sessions/1/scans", "raise service.body_mib")] {
        let host = &server.address;
        let head = format!("POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 9999999\r\n\r\n");
        let (status, answer) = server.raw(head.as_bytes());
        let message = answer["error"]["message"].as_str().unwrap_or_default();
        assert!(status == 413 && message.contains("larger than 1 MiB") && message.contains(said), "{answer}");
    }
}

#[test]
fn every_refused_method_says_what_the_path_answers() {
    let server = Server::start();
    for (path, allow) in [("/openapi.yaml", "GET"), ("/sessions", "GET, POST"), ("/sessions/1/next", "POST")] {
        let text = server
            .text(format!("PATCH {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", server.address).as_bytes());
        assert!(text.starts_with("HTTP/1.1 405") && text.contains(&format!("allow: {allow}\r\n")), "{text}");
    }
}

/// Settings with which a decision takes seconds.
const SLOW: &str = r#"{"config": {"planner": "volumetric", "camera": {"width": 8192, "height": 4096},
    "working_distance_range_m": [0.3, 1.5], "working_distance_steps": 20, "tolerance_m": 0.0005, "max_points": 50000}}"#;

/// A session whose decisions take long, the longer the larger the `side` of its sheet.
fn slow_session(server: &Server, side: usize) -> String {
    let (status, answer) = server.ask("POST", "/sessions", SLOW);
    assert_eq!(status, 201, "{answer}");
    let id = answer["session"].as_str().expect("a name");
    assert_eq!(server.ask("POST", &format!("/sessions/{id}/scans"), &sheet(side)).0, 200, "a scan");
    format!("/sessions/{id}/next")
}

#[test]
fn a_decision_ends_at_its_deadline() {
    let server = Server::start();
    let next = slow_session(&server, 80);
    let clock = Instant::now();
    let (status, answer) = server.ask("POST", &next, r#"{"deadline_ms": 100}"#);
    assert_eq!((status, &answer["error"]["code"]), (504, &json!("deadline")), "{answer}");
    let (status, answer) = server.ask("POST", &next, r#"{"deadline_ms": 1500, "on_deadline": "best"}"#);
    assert!(status == 200 && answer["complete"] == false && answer["next"].is_object(), "{status} {answer}");
    assert!(clock.elapsed() < Duration::from_secs(20), "a whole decision takes longer");
    let (status, answer) = server.ask("POST", &next, r#"{"deadline_ms": 10000000}"#);
    assert_eq!((status, &answer["error"]["code"]), (400, &json!("bad_deadline")), "{answer}");
}

#[test]
fn health_is_told_while_every_core_is_busy() {
    let server = Server::start();
    let sessions: Vec<String> =
        (0..std::thread::available_parallelism().map_or(1, usize::from)).map(|_| slow_session(&server, 80)).collect();
    std::thread::scope(|scope| {
        let decisions: Vec<_> = sessions
            .iter()
            .map(|next| scope.spawn(|| server.ask("POST", next, r#"{"deadline_ms": 3000}"#).0))
            .collect();
        let mut told = 0;
        while !decisions.iter().any(|d| d.is_finished()) {
            assert_eq!(server.ask("GET", "/health", "").0, 200);
            told += 1;
        }
        assert!(told > 10, "{told} times while the decisions ran");
    });
}

#[test]
fn a_client_that_hangs_up_frees_its_core() {
    let server = Server::start_with(&["--planner", "farthest", "--set", "service.max_deadline_ms=3600000"]);
    for _ in 0..2 * std::thread::available_parallelism().map_or(1, usize::from) {
        let next = slow_session(&server, 220);
        let body = r#"{"deadline_ms": 3600000}"#;
        let head =
            format!("POST {next} HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\n\r\n", server.address, body.len());
        server.connect().write_all((head + body).as_bytes()).expect("sent, and hung up");
    }
    let id = server.session();
    let scan = sheet(30).replacen('{', r#"{"deadline_ms": 5000, "#, 1);
    assert_eq!(server.ask("POST", &format!("/sessions/{id}/scans"), &scan).0, 200, "in its five seconds");
}

#[test]
fn slow_bodies_do_not_keep_others_waiting() {
    let server = Server::start();
    let half = "POST /sessions/1/scans HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\n{";
    let hanging: Vec<_> = (0..400)
        .map(|_| {
            let mut stream = server.connect();
            stream.write_all(half.as_bytes()).expect("half a body");
            stream
        })
        .collect();
    let clock = Instant::now();
    let id = server.session();
    assert_eq!(server.ask("POST", &format!("/sessions/{id}/scans"), &sheet(30)).0, 200);
    assert!(clock.elapsed() < Duration::from_secs(4), "before the first of them is given up: {:?}", clock.elapsed());
    drop(hanging);
}

#[test]
fn sessions_survive_a_sudden_end() {
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().join("state").display().to_string();
    let start = || Server::start_with(&["--planner", "volumetric", "--state", &state]);
    let mut server = start();
    let twin = server.session();
    let id = server.session();
    for name in [&twin, &id] {
        let scans = format!("/sessions/{name}/scans");
        assert_eq!(server.ask("POST", &scans, &sheet(30)).0, 200);
        assert_eq!(server.ask_with("Idempotency-Key: k\r\n", "POST", &scans, &sheet(31)).0, 200);
        assert_eq!(server.ask("POST", &scans, &sheet(32)).0, 200);
        assert_eq!(server.ask("POST", &format!("/sessions/{name}/undo"), "").0, 200);
    }
    let changes = r#"{"config": {"working_distance_m": 0.7, "tolerance_m": 0.0021}}"#;
    let (_, expected) = server.ask("POST", &format!("/sessions/{id}/next"), changes);
    assert!(expected["next"].is_object(), "{expected}");
    let (_, export) = server.ask("GET", &format!("/sessions/{id}/export"), "");
    assert_eq!(server.ask("DELETE", &format!("/sessions/{twin}"), "").0, 200);
    server.process.kill().expect("SIGKILL");
    server.process.wait().expect("gone");

    let mut server = start();
    assert_eq!(server.ask("GET", "/sessions", "").1["open"][0]["scans"], 2, "known before it is read");
    let again = server.ask_with("Idempotency-Key: k\r\n", "POST", &format!("/sessions/{id}/scans"), &sheet(31));
    assert_eq!((again.0, &again.1["scans"]), (200, &json!(2)), "answered before the end: not added again");
    assert_eq!(server.ask("GET", &format!("/sessions/{id}/export"), "").1, export, "to the last digit");
    assert_eq!(server.ask("POST", &format!("/sessions/{id}/next"), "{}").1, expected);
    assert_eq!(server.ask("POST", &format!("/sessions/{twin}/next"), "{}").0, 404, "what was ended stays so");
    let other = server.session();
    assert!(other != id && other != twin, "no name is given twice");
    let second = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--serve", "--http", "127.0.0.1:0", "--state", &state])
        .output()
        .expect("runs");
    assert!(String::from_utf8_lossy(&second.stderr).contains("in use by another process (infer"), "one at a time");
    server.process.kill().expect("SIGKILL");
    server.process.wait().expect("gone");

    std::fs::write(format!("{state}/{id}/scan-0002"), "{").expect("damage");
    let server = start();
    let (status, answer) = server.ask("POST", &format!("/sessions/{id}/next"), "{}");
    let message = answer["error"]["message"].as_str().unwrap_or_default();
    assert!(status == 500 && message.contains("scan-0002"), "{answer}");
    let (_, list) = server.ask("GET", "/sessions", "");
    assert_eq!((&list["open"][0]["session"], &list["open"][0]["scans"]), (&json!(id), &json!(2)), "as on disk: {list}");
    assert_eq!(server.ask("POST", &format!("/sessions/{other}/scans"), &sheet(30)).0, 200, "others are not affected");
    assert_eq!(server.ask("DELETE", &format!("/sessions/{id}"), "").0, 200, "the way out");
}

/// Sends a signal and waits for the end.
fn end(server: &mut Server, signal: &str) -> Option<i32> {
    let killed = Command::new("kill").args([signal, &server.process.id().to_string()]).status();
    assert!(killed.is_ok_and(|s| s.success()), "kill runs");
    server.process.wait().expect("it ends").code()
}

#[test]
fn asked_to_stop_it_answers_what_runs_and_ends_with_0() {
    let mut server = Server::start_with(&["--planner", "farthest", "--set", "service.stop_ms=60000"]);
    let next = slow_session(&server, 80);
    let body = r#"{"deadline_ms": 2000, "on_deadline": "best"}"#;
    let mut stream = server.connect();
    let head = format!("POST {next} HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\n\r\n", server.address, body.len());
    stream.write_all((head + body).as_bytes()).expect("sent");
    // Once the service has told its health, it has taken in what came before.
    assert_eq!(server.ask("GET", "/health", "").0, 200);
    let code = end(&mut server, "-TERM");
    let mut answer = String::new();
    std::io::Read::read_to_string(&mut stream, &mut answer).expect("the answer");
    assert!(answer.starts_with("HTTP/1.1 200"), "{}", answer.get(..300).unwrap_or(&answer));
    assert_eq!(code, Some(0));
}

#[test]
fn asked_to_stop_it_does_not_wait_for_its_input() {
    let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--serve", "--planner", "farthest"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut output = BufReader::new(process.stdout.take().expect("piped"));
    writeln!(process.stdin.as_mut().expect("piped"), r#"{{"method": "health"}}"#).expect("the service reads");
    output.read_line(&mut String::new()).expect("the service answers");
    let killed = Command::new("kill").args(["-INT", &process.id().to_string()]).status();
    assert!(killed.is_ok_and(|s| s.success()), "kill runs");
    let input = process.stdin.take();
    assert_eq!(process.wait().expect("ends").code(), Some(0), "with its input still open");
    drop(input);
}

/// `requests` decisions by eight clients, `bad` malformed requests among them, one client that hangs and one that
/// sends a gigabyte. Returns the sorted times of the good ones.
fn load(server: &Server, requests: usize, bad: usize) -> Vec<Duration> {
    const CLIENTS: usize = 8;
    let mut hanging = server.connect();
    hanging
        .write_all(b"POST /sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 50\r\n\r\n{")
        .expect("half a body");
    let mut times: Vec<Duration> = std::thread::scope(|scope| {
        let large = scope.spawn(|| {
            let mut stream = server.connect();
            let head =
                format!("POST /sessions HTTP/1.1\r\nHost: {}\r\nTransfer-Encoding: chunked\r\n\r\n", server.address);
            stream.write_all(head.as_bytes()).expect("the head is taken");
            let block = vec![b' '; 1 << 20];
            let sent = (0..1024).take_while(|_| {
                stream
                    .write_all(b"100000\r\n")
                    .and_then(|()| stream.write_all(&block))
                    .and_then(|()| stream.write_all(b"\r\n"))
                    .is_ok()
            });
            sent.count()
        });
        let clients: Vec<_> = (0..CLIENTS)
            .map(|client| {
                scope.spawn(move || {
                    let id = server.session();
                    assert_eq!(server.ask("POST", &format!("/sessions/{id}/scans"), &sheet(40)).0, 200, "a scan");
                    let broken = malformed(server, &id);
                    let mut times = Vec::new();
                    for i in (client..requests).step_by(CLIENTS) {
                        if i * bad / requests != (i + 1) * bad / requests {
                            let (request, expected) = &broken[i % broken.len()];
                            assert_eq!(server.raw(request).0, *expected, "refused");
                            continue;
                        }
                        let clock = Instant::now();
                        let (status, answer) = server.ask("POST", &format!("/sessions/{id}/next"), "{}");
                        times.push(clock.elapsed());
                        assert!(status == 200 && answer["next"].is_object(), "{status} {answer}");
                    }
                    times
                })
            })
            .collect();
        let times = clients.into_iter().flat_map(|c| c.join().expect("no client fails")).collect();
        let sent = large.join().expect("the large client ends");
        assert!(sent < 1024, "a gigabyte must not be taken: {sent} MiB were");
        times
    });
    drop(hanging);
    times.sort();
    times
}

#[test]
fn others_are_served_under_ill_treatment() {
    let server = Server::start();
    let times = load(&server, 80, 16);
    assert_eq!(times.len(), 64, "every good request is answered");
    assert_eq!(server.ask("GET", "/health", "").0, 200, "the service is alive");
}

#[test]
#[ignore = "the full load: run with --release and --ignored --nocapture"]
fn full_load() {
    let server = Server::start();
    load(&server, 200, 10);
    let [before, _] = server.memory();
    let times = load(&server, 1000, 50);
    let [after, _] = server.memory();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1000.0;
    println!(
        "{} good of 1000 requests, 8 clients: p50 {:.1} ms, p99 {:.1} ms, worst {:.1} ms; resident {before:.0} MiB before, {after:.0} after",
        times.len(),
        at(0.5),
        at(0.99),
        at(1.0)
    );
    assert_eq!(times.len(), 950, "every good request is answered");
    assert!(after < before + 64.0, "no leak: {before} MiB before, {after} after");
}
