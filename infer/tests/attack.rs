//! The service under attack: clients that send what they like, for seconds, or for `INFER_ATTACK_SECONDS`, by
//! `INFER_ATTACK_CLIENTS` at once. What is promised: no session is lost, memory stays in its bounds, health is always told. For a third
//! of the time the same clients are honest alone: what their requests take then is what the rest is held against.
//!
//! The long run: `INFER_ATTACK_SECONDS=900 INFER_ATTACK_CLIENTS=8 cargo test --workspace --test attack -- --nocapture`.

mod server;

use serde_json::{Value, json};
use server::{Server, malformed, sheet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What the service may hold by its settings, and what the program takes beside that: code, weights, threads, and what the
/// allocator keeps, MiB.
const MEMORY: usize = 1024;
const BESIDE: f64 = 256.0;
/// Scans of a session before it is reset.
const SCANS: u64 = 5;

/// Honest requests under attack may take so many times as long as without, at the 99th percentile; seconds are too few to tell.
const SLOWER: f64 = 3.0;

fn setting(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// Numbers that look random and are the same every time.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }

    fn of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.roll(list.len() as u64) as usize]
    }
}

/// A scan, a setting or a position with numbers that no robot means.
fn wild(dice: &mut Dice, id: &str) -> (String, String) {
    let numbers = ["1e308", "-1e308", "1e30", "1e19", "-1e7", "1e-320", "0", "-0.0", "4e9", "18446744073709551615"];
    let n = *dice.of(&numbers);
    let scans = format!("/sessions/{id}/scans");
    let next = format!("/sessions/{id}/next");
    let points: Vec<String> = (0..200).map(|i| format!("[{}, {}, {n}]", i % 20, i / 20)).collect();
    let keys =
        ["working_distance_m", "tolerance_m", "outlier_factor", "stop_below", "max_points", "min_points", "seed"];
    let limits =
        ["max_travel_m", "visited_radius_m", "clearance_m", "floor_height_m", "min_tilt_deg", "travel_weight_per_m"];
    match dice.roll(8) {
        0 => (scans, format!(r#"{{"points": [{}], "from": [0, 0, 1]}}"#, points.join(","))),
        1 => (scans, format!(r#"{{"points": [{}], "from": [{n}, 0, {n}]}}"#, points.join(","))),
        2 => (scans, format!(r#"{{"points": [{}], "unit": "mm"}}"#, points.join(","))),
        3 => (next, format!(r#"{{"current_position_m": [{n}, {n}, 0]}}"#)),
        4 => (next, format!(r#"{{"config": {{"{}": {n}}}, "deadline_ms": 2000}}"#, dice.of(&keys))),
        5 => {
            (next, format!(r#"{{"config": {{"constraints": {{"{}": {n}}}}}, "deadline_ms": 2000}}"#, dice.of(&limits)))
        }
        6 => (
            next,
            format!(r#"{{"config": {{"camera": {{"intrinsics": [{n}, 500, 320, {n}]}}}}, "deadline_ms": 2000}}"#),
        ),
        _ => (next, format!(r#"{{"deadline_ms": {n}}}"#)),
    }
}

/// Small to send and large to read, or large to send for nothing.
fn bomb(dice: &mut Dice, id: &str) -> (String, String) {
    let scans = format!("/sessions/{id}/scans");
    let header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4000000000\nHEIGHT 1\n\
                  VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4000000000\nDATA binary\n";
    match dice.roll(7) {
        0 => ("/sessions".to_owned(), format!(r#"{{"config": {{"x": [{}0]}}}}"#, r#"{"":0},"#.repeat(140_000))),
        1 => (scans, format!(r#"{{"config": {{"x": [{}0]}}}}"#, r#"{"":0},"#.repeat(8_000_000))),
        2 => (scans, "[".repeat(40 << 20)),
        3 => (scans, format!(r#"{{"points": [{}[0,0,0]]}}"#, "[0,0,0],".repeat(8_000_000))),
        4 => (scans, format!(r#"{{"points_base64": "{}"}}"#, "A".repeat(60 << 20))),
        5 => (scans, json!({ "cloud_base64": base64(header.as_bytes()), "cloud_name": "a.pcd" }).to_string()),
        _ => (scans, format!(r#"{{"points": [{}[1,2,3]]}}"#, " ".repeat(63 << 20))),
    }
}

fn base64(bytes: &[u8]) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// What one client went through.
#[derive(Default)]
struct Diary {
    times: Vec<Duration>,
    busy: usize,
    attacks: usize,
}

fn client(server: &Server, number: u64, hostile: bool, until: &AtomicBool) -> Diary {
    let mut dice = Dice(number + 1);
    let mut diary = Diary::default();
    let id = server.session();
    let good = sheet(40);
    let broken = malformed(server, &id);
    let mut scans = 0;
    let mut asked = 0;
    while !until.load(Ordering::Relaxed) {
        let roll = dice.roll(100);
        if roll < 8 && !hostile {
            continue;
        }
        if roll < 5 {
            let (request, expected) = dice.of(&broken);
            // A request that is refused before it was read may find its answer cut off.
            let (status, answer) = server.raw(request);
            assert!(status == *expected || status == 0, "{status} {answer} for {}", String::from_utf8_lossy(request));
            diary.attacks += 1;
            continue;
        }
        if roll < 8 {
            let attack = if roll < 7 { wild(&mut dice, &id) } else { bomb(&mut dice, &id) };
            let (status, answer) = server.ask("POST", &attack.0, &attack.1);
            assert_ne!(status, 500, "{answer} for {}", attack.1.get(..200).unwrap_or_default());
            assert!(status > 0, "no answer to {} of {}", attack.1.get(..200).unwrap_or_default(), attack.0);
            diary.attacks += 1;
            // What was accepted is taken back.
            if status == 200 && attack.0.ends_with("scans") {
                assert_eq!(server.ask("POST", &format!("/sessions/{id}/undo"), "").0, 200);
            } else if status == 200 {
                let usual = json!({ "config": usual(server) }).to_string();
                let (status, answer) = server.ask("POST", &format!("/sessions/{id}/next"), &usual);
                assert!(matches!(status, 200 | 422 | 503 | 507), "{status} {answer}");
            }
            continue;
        }
        asked += 1;
        let (what, body) = match roll {
            _ if scans == 0 => ("scans", good.as_str()),
            8..30 if scans < SCANS => ("scans", good.as_str()),
            8..12 => ("reset", "{}"),
            _ => ("next", "{}"),
        };
        let clock = Instant::now();
        let key = format!("Idempotency-Key: {asked}\r\n");
        let path = format!("/sessions/{id}/{what}");
        let (status, answer) = server.ask_with(&key, "POST", &path, body);
        match (status, what) {
            (200, "scans") => {
                scans += 1;
                assert_eq!(answer["scans"], scans, "{answer}");
            }
            (200, "reset") => scans = 0,
            (200, _) => assert!(answer["candidates"].is_array(), "{answer}"),
            // Others were before it.
            (503 | 504 | 507, _) => diary.busy += 1,
            _ => panic!("{status} {answer} for {what}"),
        }
        diary.times.push(clock.elapsed());
    }
    let (_, list) = server.ask("GET", "/sessions", "");
    let own = |s: &&Value| s["session"] == id;
    let found = list["open"].as_array().and_then(|open| open.iter().find(own).cloned());
    assert_eq!(found.map(|s| s["scans"].clone()), Some(json!(scans)), "session {id} of {list}");
    diary
}

/// The defaults of what attacks change.
fn usual(server: &Server) -> Value {
    let (_, fresh) = server.ask("POST", "/sessions", "{}");
    let id = fresh["session"].as_str().expect("a session").to_owned();
    let (_, export) = server.ask("GET", &format!("/sessions/{id}/export"), "");
    assert_eq!(server.ask("DELETE", &format!("/sessions/{id}"), "").0, 200);
    export["config"].clone()
}

/// A list of durations, sorted: what so large a share of them is at most, in milliseconds.
fn at_most(mut times: Vec<Duration>) -> impl Fn(f64) -> f64 {
    times.sort();
    move |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * 1000.0
}

/// Lets clients work for so long, and prints what they went through; the 99th percentile of honest requests, in milliseconds.
fn spend(server: &Server, seconds: Duration, hostile: bool) -> f64 {
    let over = AtomicBool::new(false);
    let begun = Instant::now();
    let (diaries, health) = std::thread::scope(|scope| {
        let over = &over;
        let clients: Vec<_> = (0..setting("INFER_ATTACK_CLIENTS").unwrap_or(4))
            .map(|number| scope.spawn(move || client(server, number, hostile, over)))
            .collect();
        let mut health = Vec::new();
        while begun.elapsed() < seconds && !clients.iter().any(|c| c.is_finished()) {
            let clock = Instant::now();
            assert_eq!(server.ask("GET", "/health", "").0, 200, "health is always told");
            health.push(clock.elapsed());
            std::thread::yield_now();
        }
        over.store(true, Ordering::Relaxed);
        let diaries: Vec<Diary> = clients.into_iter().map(|c| c.join().expect("no client is let down")).collect();
        (diaries, health)
    });
    let [_, peak] = server.memory();
    let [attacks, busy, good] = [|d: &Diary| d.attacks, |d: &Diary| d.busy, |d: &Diary| d.times.len()]
        .map(|count| diaries.iter().map(count).sum::<usize>());
    let (told, worst_health) = (health.len(), at_most(health));
    let times = at_most(diaries.into_iter().flat_map(|d| d.times).collect());
    println!(
        "{seconds:?}: {good} honest requests ({busy} told to try again), {attacks} attacks; p50 {:.0} ms, p99 {:.0} ms, worst \
         {:.0} ms; health told {told} times, p99 {:.1} ms, worst {:.1} ms; peak of the resident memory {peak:.0} MiB",
        times(0.5),
        times(0.99),
        times(1.0),
        worst_health(0.99),
        worst_health(1.0),
    );
    assert!(peak < MEMORY as f64 + BESIDE, "{peak} MiB");
    assert!(busy * 20 <= good, "{busy} of {good} honest requests were told to try again");
    times(0.99)
}

#[test]
fn nothing_is_lost_under_attack() {
    let memory = format!("service.memory_mib={MEMORY}");
    let server = Server::start_with(&["--set", &memory, "--set", "service.deadline_ms=20000"]);
    let long = setting("INFER_ATTACK_SECONDS");
    let seconds = Duration::from_secs(long.unwrap_or(6));
    let calm = spend(&server, seconds / 3, false);
    let attacked = spend(&server, seconds - seconds / 3, true);
    println!("the 99th percentile under attack is {:.2} times that without", attacked / calm);
    assert!(long.is_none() || attacked <= SLOWER * calm, "{attacked} ms for {calm} ms");
}
