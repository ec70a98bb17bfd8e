//! The service as a robot meets it: over stdin and over HTTP, under load and ill-treated.
//!
//! The full load of docs/robots.md (1,000 requests): `cargo test --release --test service -- --ignored --nocapture`.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A running service, ended when dropped.
struct Server {
    process: Child,
    address: String,
}

impl Server {
    fn start() -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
            .args(["--serve", "--http", "127.0.0.1:0", "--planner", "farthest"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("piped")).read_line(&mut line).expect("the address");
        let address = line.trim().strip_prefix("listening on http://").expect("an address").to_owned();
        Self { process, address }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).expect("the service accepts");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a timeout");
        stream
    }

    /// Status and body of one request.
    fn ask(&self, method: &str, path: &str, body: &str) -> (u16, Value) {
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            self.address,
            body.len()
        );
        self.raw(format!("{head}{body}").as_bytes())
    }

    fn raw(&self, request: &[u8]) -> (u16, Value) {
        let mut stream = self.connect();
        // The service may answer, and close, before all is sent.
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let body = answer.split_once("\r\n\r\n").map_or("", |(_, body)| body);
        (status, serde_json::from_str(body).unwrap_or(Value::Null))
    }

    fn session(&self) -> String {
        let (status, answer) = self.ask("POST", "/sessions", "{}");
        assert_eq!(status, 201, "{answer}");
        answer["session"].as_str().expect("a name").to_owned()
    }

    /// Resident memory in MiB.
    fn memory(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap_or_default();
        let kib =
            status.lines().find_map(|l| l.strip_prefix("VmRSS:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
        kib.unwrap_or(0.0) / 1024.0
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A scan of a sheet of `side` x `side` points.
fn sheet(side: usize) -> String {
    let points: Vec<[f64; 3]> = (0..side * side)
        .map(|i| [(i % side) as f64 * 0.004, (i / side) as f64 * 0.004, 0.001 * ((i % 7) as f64)])
        .collect();
    json!({ "points": points, "from": [0.06, 0.06, 1.2] }).to_string()
}

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

/// Requests that must be refused, with the status expected.
fn malformed(server: &Server, id: &str) -> Vec<(Vec<u8>, u16)> {
    let host = &server.address;
    let post = |path: &str, body: &str| {
        format!(
            "POST {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        )
        .into_bytes()
    };
    let scans = format!("/sessions/{id}/scans");
    vec![
        (b"\x16\x03\x01\x02\x00 not http\r\n\r\n".to_vec(), 400),
        (post(&scans, "{"), 400),
        (post(&scans, r#"{"points": [[1, 2]]}"#), 400),
        (post(&scans, r#"{"points": [[1, 2, "x"]]}"#), 400),
        (post(&scans, r#"{"point": [[1, 2, 3]]}"#), 400),
        (post(&scans, r#"{"points": [[1, 2, 3]]}"#), 422),
        (post(&scans, r#"{"points_base64": "AAA"}"#), 400),
        (post(&scans, r#"{"file": "/etc/passwd"}"#), 403),
        (post(&scans, r#"{"depth": {"png_base64": "AAAA", "intrinsics": [1, 1, 0, 0]}}"#), 400),
        (post(&scans, r#"{"cloud_base64": "AAAA", "cloud_name": "x.pcd"}"#), 400),
        (post(&scans, &"[".repeat(100_000)), 400),
        (post(&scans, ""), 400),
        (post("/sessions", r#"{"config": {"working_distance_m": -1}}"#), 400),
        (post("/sessions", r#"{"config": {"colour": "red"}}"#), 400),
        (post("/sessions/nobody/next", "{}"), 404),
        (post("/nowhere", "{}"), 404),
        (format!("PUT /sessions HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").into_bytes(), 405),
        (b"GET /health HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_vec(), 403),
        (
            format!("GET /health HTTP/1.1\r\nHost: {host}\r\nOrigin: http://evil.example\r\nConnection: close\r\n\r\n")
                .into_bytes(),
            403,
        ),
        (format!("POST {scans} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 1000000000\r\n\r\n").into_bytes(), 413),
    ]
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
    assert_eq!(ask(r#"{"method": "dance"}"#)["error"]["code"], "bad_request", "an unknown method is answered");
    let missing = ask(r#"{"method": "add_scan", "session": "1", "params": {"file": "missing.ply"}}"#);
    assert!(missing["error"]["message"].as_str().is_some_and(|m| m.contains("missing.ply")), "{missing}");
    let next = ask(r#"{"id": 8, "method": "next_view", "session": "1"}"#);
    assert!(next["result"]["next"]["position_m"].is_array() && next["id"] == 8, "{next}");
    assert_eq!(ask(r#"{"method": "reset", "session": "1"}"#)["result"]["scans"], 0, "reset");
    drop(input);
    assert!(process.wait().expect("ends").success(), "the end of the input ends the service");
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
    let before = server.memory();
    let times = load(&server, 1000, 50);
    let after = server.memory();
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

#[test]
fn the_python_client_works() {
    let server = Server::start();
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/client.py");
    let run = Command::new("python3").args([client, &format!("http://{}", server.address)]).output();
    let Ok(output) = run else {
        println!("skipped: there is no python3 here to run docs/client.py with");
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("'scans': 1") && text.contains("next view: [["), "{text}");
    assert_eq!(server.ask("GET", "/health", "").1["sessions"], 0, "the client closes its session");
}
