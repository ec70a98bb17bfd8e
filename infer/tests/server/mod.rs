//! A service to test, and what is sent to it.
#![allow(dead_code, reason = "each test takes its part")]

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A running service, ended when dropped.
pub struct Server {
    pub process: Child,
    pub address: String,
}

impl Server {
    pub fn start() -> Self {
        Self::start_with(&["--planner", "farthest"])
    }

    pub fn start_with(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
            .args(["--serve", "--http", "127.0.0.1:0"])
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("piped")).read_line(&mut line).expect("the address");
        let address = line.trim().strip_prefix("listening on http://").expect("an address").to_owned();
        Self { process, address }
    }

    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).expect("the service accepts");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a timeout");
        stream
    }

    /// Status and body of one request.
    pub fn ask(&self, method: &str, path: &str, body: &str) -> (u16, Value) {
        self.ask_with("", method, path, body)
    }

    /// [`Server::ask`] with more headers, each with its line end.
    pub fn ask_with(&self, headers: &str, method: &str, path: &str, body: &str) -> (u16, Value) {
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nContent-Length: {}\r\nConnection: close\r\n{headers}\r\n",
            self.address,
            body.len()
        );
        self.raw(format!("{head}{body}").as_bytes())
    }

    pub fn raw(&self, request: &[u8]) -> (u16, Value) {
        let answer = self.text(request);
        let status = answer.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let body = answer.split_once("\r\n\r\n").map_or("", |(_, body)| body);
        (status, serde_json::from_str(body).unwrap_or(Value::Null))
    }

    /// The answer to these bytes, head and body.
    pub fn text(&self, request: &[u8]) -> String {
        let mut stream = self.connect();
        // The service may answer, and close, before all is sent.
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub fn session(&self) -> String {
        let (status, answer) = self.ask("POST", "/sessions", "{}");
        assert_eq!(status, 201, "{answer}");
        answer["session"].as_str().expect("a name").to_owned()
    }

    /// Resident memory in MiB; at its peak.
    pub fn memory(&self) -> [f64; 2] {
        ["VmRSS:", "VmHWM:"].map(|line| self.status(line))
    }

    fn status(&self, line: &str) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.process.id())).unwrap_or_default();
        let kib = status.lines().find_map(|l| l.strip_prefix(line)?.trim().strip_suffix(" kB")?.parse::<f64>().ok());
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
pub fn sheet(side: usize) -> String {
    let points: Vec<[f64; 3]> = (0..side * side)
        .map(|i| [(i % side) as f64 * 0.004, (i / side) as f64 * 0.004, 0.001 * ((i % 7) as f64)])
        .collect();
    json!({ "points": points, "from": [0.06, 0.06, 1.2] }).to_string()
}

/// Requests that must be refused, with the status expected.
pub fn malformed(server: &Server, id: &str) -> Vec<(Vec<u8>, u16)> {
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
        // A PNG of 30,000 x 30,000 pixels, by its head.
        (
            post(
                &scans,
                r#"{"depth": {"intrinsics": [1, 1, 0, 0], "quaternion_xyzw": [0, 0, 0, 1], "translation_m": [0, 0, 0],
                "png_base64": "iVBORw0KGgoAAAANSUhEUgAAdTAAAHUwEAAAAAAAAAAA"}}"#,
            ),
            413,
        ),
        (post(&scans, &"[".repeat(100_000)), 400),
        (post(&scans, ""), 400),
        (post("/sessions", r#"{"config": {"working_distance_m": -1}}"#), 400),
        (post("/sessions", r#"{"config": {"colour": "red"}}"#), 400),
        (post("/sessions", r#"[{"tolerance_m": 0.01}]"#), 400),
        (post("/sessions", r#"{"config": {"camera": [640, 480, 60, null]}}"#), 400),
        (post(&format!("/sessions/{id}/reset"), "[]"), 400),
        (post(&scans, r#"{"depth": ["AAAA", null, null, [1, 1, 0, 0], null, null, null, null]}"#), 400),
        (post("/sessions/nobody/next", "{}"), 404),
        (post("/nowhere", "{}"), 404),
        (format!("PUT /sessions HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").into_bytes(), 405),
        (b"GET /health HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_vec(), 403),
        (
            format!("GET /health HTTP/1.1\r\nHost: {host}\r\nOrigin: http://evil.example\r\nConnection: close\r\n\r\n")
                .into_bytes(),
            403,
        ),
        (
            format!("GET /health HTTP/1.1\r\nHost: {host}\r\nHost: {host}\r\nConnection: close\r\n\r\n").into_bytes(),
            400,
        ),
        (
            format!("GET http://evil.example/health HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
                .into_bytes(),
            421,
        ),
        (
            format!("GET /health HTTP/1.1\r\nHost: {host}\r\nSec-Fetch-Site: cross-site\r\nConnection: close\r\n\r\n")
                .into_bytes(),
            403,
        ),
        (post("/sessions", r#"{"config": {"camera": {"width": 16384, "height": 16384}}}"#), 400),
        (post("/sessions", r#"{"config": {"max_points": 0}}"#), 400),
        (post(&format!("/sessions/{id}/next"), r#"{"deadline_ms": 0}"#), 400),
        (format!("POST {scans} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 1000000000\r\n\r\n").into_bytes(), 413),
    ]
}
