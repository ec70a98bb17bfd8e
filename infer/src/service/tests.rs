use super::*;
use crate::direct;
use crate::request::{Ask, Body, CreateRequest};
use planning::PlannerName;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::thread;
use std::time::Duration;

fn sheet() -> Vec<u8> {
    let point = |i: u32| [f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, f64::from(i % 7) * 0.001];
    let points: Vec<[f64; 3]> = (0..900).map(point).collect();
    json!({ "points": points, "from": [0.06, 0.06, 1.2] }).to_string().into_bytes()
}

#[test]
fn a_session_is_deleted_when_who_works_on_it_has_ended_and_who_waits_finds_it_gone() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path().join("1");
    let service = Service::new(SessionConfig::default(), None, ServiceConfig::default());
    let service = service.keeping_state(place.path()).expect("a folder");
    service.create(CreateRequest::default(), None).expect("created");
    let entry = service.entry(Some("1")).expect("there");
    let add = |open: &mut Open| {
        let ask = Ask::parse(Method::AddScan, Body::Whole(&sheet()), false, true)?;
        service.work(&entry, open, ask, None, &service.patience(), service.memory().nothing())
    };
    let deleted = thread::scope(|scope| {
        let mut open = entry.open.blocking_lock();
        let deleting = scope.spawn(|| direct::answer(&service, Method::Delete, Some("1"), Body::Whole(b""), None));
        // Those who have it are the service, this test, and who deletes it.
        while Arc::strong_count(&entry) < 3 && !deleting.is_finished() {
            thread::yield_now();
        }
        add(&mut open).expect("added");
        assert!(!deleting.is_finished() && folder.join("scan-0001").exists(), "it waits for the scan, which is kept");
        drop(open);
        deleting.join().expect("answered")
    });
    assert_eq!(deleted.expect("deleted").status, 200);
    assert!(!folder.exists(), "nothing is left");
    let late = add(&mut entry.open.blocking_lock()).expect_err("gone");
    assert_eq!((late.status, late.code), (404, "unknown_session"));
    assert!(!folder.exists(), "nor written again");
}

#[test]
fn a_file_is_refused_that_would_be_too_large_for_the_session_to_be_read_again() {
    let place = tempfile::tempdir().expect("a folder");
    let start = || {
        let limits = ServiceConfig { body_mib: 1, ..ServiceConfig::default() };
        let service = Service::new(SessionConfig::default(), None, limits);
        service.keeping_state(&place.path().join("state")).expect("a folder")
    };
    let file = place.path().join("sheet.xyz");
    let add = |service: &Service, blank_lines: usize| {
        let row = |i: u32| format!("{} {} 0\n", 0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30));
        fs::write(&file, (0..900).map(row).collect::<String>() + &"\n".repeat(blank_lines)).expect("written");
        let line = json!({ "params": { "file": file, "from": [0.06, 0.06, 1.2] } }).to_string();
        direct::answer(service, Method::AddScan, Some("1"), Body::Line(line.as_bytes()), None)
    };
    let service = start();
    service.create(CreateRequest::default(), None).expect("created");
    assert_eq!(add(&service, 0).expect("added").status, 200);
    let refused = add(&service, 8 << 20).expect_err("too large");
    assert_eq!((refused.status, refused.code), (413, "too_large"));
    assert!(refused.message.contains("service.body_mib = 1 allows: raise it to 11"), "{}", refused.message);
    drop(service);
    let next = direct::answer(&start(), Method::NextView, Some("1"), Body::Whole(b""), None);
    assert_eq!(next.expect("read again").status, 200);
}

#[test]
fn a_session_is_read_over_several_requests_where_one_has_too_little_time() {
    let place = tempfile::tempdir().expect("a folder");
    let start = || {
        let service = Service::new(SessionConfig::default(), None, ServiceConfig::default());
        service.keeping_state(place.path()).expect("a folder")
    };
    let service = start();
    service.create(CreateRequest::default(), None).expect("created");
    for _ in 0..3 {
        direct::answer(&service, Method::AddScan, Some("1"), Body::Whole(&sheet()), None).expect("added");
    }
    let export = |service: &Service, patience: &Patience| {
        let entry = service.entry(Some("1"))?;
        let mut open = entry.open.blocking_lock();
        let ask = Ask::parse(Method::Export, Body::Whole(b""), false, true)?;
        service.work(&entry, &mut open, ask, None, patience, service.memory().nothing())
    };
    let expected = export(&service, &service.patience()).expect("an export");
    drop(service);
    let service = start();
    let none = Patience::new(Duration::ZERO, &service.halted);
    for read in 1..3 {
        let late = export(&service, &none).expect_err("there is more to read");
        assert_eq!((late.status, late.code), (503, "loading"));
        assert!(late.message.starts_with(&format!("{read} of the session's 3 scans")), "{}", late.message);
        let list = String::from_utf8_lossy(&service.list().expect("a list").body).into_owned();
        assert!(list.contains(r#""scans":3"#), "those on disk count: {list}");
    }
    let gone = Patience::new(Duration::from_secs(60), &service.halted);
    gone.gone.set();
    assert_eq!(export(&service, &gone).expect_err("nobody waits").code, "stopping");
    assert_eq!(export(&service, &none).expect("read to its end"), expected);
}

/// Adds the names of all fields in it.
fn fields(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => object.iter().for_each(|(name, value)| {
            found.insert(name.clone());
            fields(value, found);
        }),
        Value::Array(values) => values.iter().for_each(|value| fields(value, found)),
        _ => {}
    }
}

#[test]
fn every_field_of_an_answer_is_described() {
    let description = include_str!("../../../docs/openapi.yaml");
    let described: BTreeSet<&str> =
        description.split([' ', '{', '\n']).filter_map(|word| word.strip_suffix(':')).collect();
    let config = SessionConfig { planner: PlannerName::Volumetric, ..SessionConfig::default() };
    let service = Service::new(config, None, ServiceConfig::default());
    let mut found = BTreeSet::new();
    for (method, body) in [
        (Method::Create, br#"{"config": {"registration": {"register": "check"}}}"#.to_vec()),
        (Method::AddScan, sheet()),
        (Method::NextView, br#"{"plan_views": 3}"#.to_vec()),
        (Method::AddScan, sheet()),
        (Method::NextView, Vec::new()),
        (Method::Export, Vec::new()),
        (Method::Mesh, Vec::new()),
        (Method::Health, Vec::new()),
        (Method::List, Vec::new()),
        (Method::Undo, Vec::new()),
        (Method::Delete, Vec::new()),
    ] {
        let reply = direct::answer(&service, method, Some("1"), Body::Whole(&body), None).expect("an answer");
        fields(&serde_json::from_slice(&reply.body).expect("JSON"), &mut found);
    }
    for shown in ["notes", "duplicates", "chosen", "like_normals"] {
        assert!(found.contains(shown), "no answer has {shown}");
    }
    let missing: Vec<&String> = found.iter().filter(|name| !described.contains(name.as_str())).collect();
    assert!(missing.is_empty(), "docs/openapi.yaml lacks {missing:?}");
}
