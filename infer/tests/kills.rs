//! A service that is killed at random moments loses nothing that it answered: `INFER_KILLS=100 cargo test --workspace --test kills --
//! --nocapture`.

mod server;

use rand::RngExt;
use serde_json::{Value, json};
use server::Server;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// A separate sheet for each scan.
fn scan(number: usize) -> String {
    let x = 0.03 * number as f64;
    let points: Vec<[f64; 3]> =
        (0..400).map(|i| [x + (i % 20) as f64 * 0.004, (i / 20) as f64 * 0.004, 0.0005 * ((i % 7) as f64)]).collect();
    json!({ "points": points, "from": [x, 0.06, 1.2] }).to_string()
}

/// Status and body, or nothing where the service went away before it answered.
fn ask(server: &Server, path: &str, key: &str, body: &str) -> Option<(u16, Value)> {
    let mut stream = TcpStream::connect(&server.address).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(60))).ok()?;
    let (host, length) = (&server.address, body.len());
    let head = format!("POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\nConnection: close\r\n");
    let request = format!("{head}Idempotency-Key: {key}\r\n\r\n{body}");
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let (head, body) = answer.split_once("\r\n\r\n")?;
    Some((head.split(' ').nth(1)?.parse().ok()?, serde_json::from_str(body).ok()?))
}

#[test]
fn a_session_killed_at_random_moments_loses_nothing() {
    let kills: usize = std::env::var("INFER_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().join("state").display().to_string();
    let start = || Server::start_with(&["--planner", "volumetric", "--state", &state]);
    let mut rng = geometry::rng::stream(7, "kills");
    let mut server = start();
    let id = server.session();
    let scans = format!("/sessions/{id}/scans");
    // So many were answered; the key of the next one is sent until it is answered too.
    let (mut answered, mut unanswered) = (0, 0);
    for _ in 0..kills {
        let pid = server.process.id().to_string();
        let moment = Duration::from_micros(rng.random_range(0..40_000));
        let killer = std::thread::spawn(move || {
            std::thread::sleep(moment);
            std::process::Command::new("kill").args(["-9", &pid]).status().expect("kill runs")
        });
        while let Some((status, answer)) = ask(&server, &scans, &format!("scan-{answered}"), &scan(answered)) {
            assert_eq!((status, answer["scans"].as_u64()), (200, Some(answered as u64 + 1)), "{answer}");
            answered += 1;
        }
        unanswered += 1;
        killer.join().expect("a thread");
        server.process.wait().expect("gone");
        server = start();
    }
    let (status, answer) = ask(&server, &scans, &format!("scan-{answered}"), &scan(answered)).expect("an answer");
    answered += 1;
    assert_eq!((status, answer["scans"].as_u64()), (200, Some(answered as u64)), "each once: {answer}");
    let (_, export) = server.ask("GET", &format!("/sessions/{id}/export"), "");
    println!(
        "{kills} kills, {answered} scans, {unanswered} of them sent again after a kill: none lost, none added twice"
    );

    // As if nothing had happened.
    let calm = Server::start_with(&["--planner", "volumetric"]);
    let other = calm.session();
    for number in 0..answered {
        assert_eq!(calm.ask("POST", &format!("/sessions/{other}/scans"), &scan(number)).0, 200);
    }
    assert_eq!(
        calm.ask("GET", &format!("/sessions/{other}/export"), "").1["points_m"],
        export["points_m"],
        "to the last digit"
    );
}
