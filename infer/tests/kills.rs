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

#[test]
fn damaged_and_huge_files_cost_their_own_session_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let state = folder.path().join("state");
    let at = |name: &str| state.join(name);
    let text = state.display().to_string();
    let start = || {
        let memory = ["--set", "service.memory_mib=1024", "--set", "service.sessions=10000"];
        Server::start_with(&[&["--planner", "farthest", "--state", &text][..], &memory].concat())
    };
    let mut server = start();
    let names: Vec<String> = (0..7).map(|_| server.session()).collect();
    for name in &names {
        for number in 0..2 {
            assert_eq!(server.ask("POST", &format!("/sessions/{name}/scans"), &scan(number)).0, 200);
        }
    }
    server.process.kill().expect("SIGKILL");
    server.process.wait().expect("gone");

    let hole = |name: &str, bytes: u64| std::fs::File::create(at(name)).and_then(|f| f.set_len(bytes)).expect("a hole");
    let good = std::fs::read_to_string(at("1/session.toml")).expect("a session");
    std::fs::write(at("2/session.toml"), &good[..good.len() / 2]).expect("cut");
    hole("3/session.toml", 4 << 30);
    hole("4/scan-0001", 4 << 30);
    std::fs::remove_file(at("5/session.toml")).expect("removed");
    let made = std::process::Command::new("mkfifo").arg(at("5/session.toml")).status();
    assert!(made.is_ok_and(|status| status.success()), "a pipe");
    // As large as a scan may be, and nothing in it.
    let head = std::fs::read(at("6/scan-0001")).expect("a scan");
    let end = head.iter().position(|b| *b == b'\n').expect("a head") + 1;
    let bomb =
        [&head[..end], format!(r#"{{"points": [{}[1,2,3]]}}"#, "[0,0,0],".repeat(8_000_000)).as_bytes()].concat();
    std::fs::write(at("6/scan-0001"), bomb).expect("written");
    // As version 1 wrote it, without a checksum.
    let unsealed = good.split_once('\n').expect("its checksum").1.replace("version = 2", "version = 1");
    std::fs::write(at("7/session.toml"), unsealed.replace("scans = 2", "scans = 4000000000")).expect("written");
    // More sessions than there is room for at once.
    for name in 100..2600 {
        std::fs::create_dir(at(&name.to_string())).expect("a folder");
        std::fs::write(at(&format!("{name}/session.toml")), unsealed.replace("scans = 2", "scans = 0"))
            .expect("written");
    }
    std::fs::write(at("state.toml"), "version = ").expect("cut");

    let server = start();
    let next = |name: &str| server.ask("POST", &format!("/sessions/{name}/next"), "{}");
    for (name, file) in [
        ("2", "2/session.toml"),
        ("3", "3/session.toml"),
        ("4", "4/scan-0001"),
        ("5", "5/session.toml"),
        ("6", "6/scan-0001"),
        ("7", "7/scan-0003"),
    ] {
        let (status, answer) = next(name);
        assert!(status == 500 && answer.to_string().contains(file), "{name}: {status} {answer}");
    }
    let (status, answer) = next("1");
    assert!(status == 200 && answer["cloud"]["scans"] == 2, "{answer}");
    assert_eq!(next("2500").0, 422, "no scan yet");
    let fresh: u64 = server.session().parse().expect("a number");
    assert!(fresh > 100_000, "no name is given twice: {fresh}");
    assert_eq!(server.ask("DELETE", "/sessions/3", "").0, 200, "the way out");
    let [_, peak] = server.memory();
    println!("{} sessions of which six are damaged: peak of the resident memory {peak:.0} MiB", 2507);
    assert!(peak < 1024.0 + 256.0, "{peak} MiB");
}
