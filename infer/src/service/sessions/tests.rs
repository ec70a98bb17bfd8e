use super::*;
use crate::service::ServiceConfig;
use planning::SessionConfig;

#[test]
fn nobody_waits_for_the_disk_of_who_creates_or_ends_a_session() {
    let place = tempfile::tempdir().expect("a folder");
    let service = Service::new(SessionConfig::default(), None, ServiceConfig::default());
    let service = service.keeping_state(place.path()).expect("a folder");
    service.create(CreateRequest::default(), None).expect("created");
    // While the disk works.
    let served = |names: &[&str]| {
        assert!(service.sessions.try_lock().is_ok(), "the lock that everybody takes is free");
        assert_eq!(service.names(), names);
        service.entry(Some("1")).expect("there");
    };
    let created = service.create_with(CreateRequest::default(), None, |store, id, record, answers| {
        served(&["1"]);
        store.create(id, record, answers)
    });
    assert_eq!(created.expect("created").status, 201);
    let entry = service.entry(Some("2")).expect("there");
    let mut open = entry.open.blocking_lock();
    let deleted = service.delete_with("2", Some(&mut *open), None, |store, id, answers| {
        served(&["1", "2"]);
        assert!(answers.is_none(), "nobody gave a key");
        store.remove(id)
    });
    assert_eq!(deleted.expect("deleted").status, 200);
    served(&["1"]);
}
