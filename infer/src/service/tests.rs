use super::*;
use crate::direct;
use crate::request::{Ask, Body};
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
        thread::sleep(Duration::from_millis(200));
        assert!(!deleting.is_finished(), "it waits for the scan");
        add(&mut open).expect("added");
        assert!(folder.join("scan-0001").exists(), "kept");
        drop(open);
        deleting.join().expect("answered")
    });
    assert_eq!(deleted.expect("deleted").status, 200);
    assert!(!folder.exists(), "nothing is left");
    let late = add(&mut entry.open.blocking_lock()).expect_err("gone");
    assert_eq!((late.status, late.code), (404, "unknown_session"));
    assert!(!folder.exists(), "nor written again");
}
