use super::*;

#[test]
fn sessions_are_found_again_as_they_were_written() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path().join("state");
    let (store, Found { last, sessions }) = Store::open(&folder).expect("a new one");
    assert_eq!((last, sessions.len()), (0, 0));
    assert!(matches!(Store::open(&folder), Err(StoreError::Taken(_))), "one at a time");
    let config = SessionConfig { tolerance_m: 0.1 + 0.2, ..Default::default() };
    store.create(7, &Record::new(0, Vec::new(), &config)).expect("written");
    let scan = Written { line: false, bytes: b"{\n}".to_vec() };
    let one = Record::new(1, Vec::new(), &config);
    store.write(7, &one, Some(&scan)).expect("written");
    drop(store);
    let (store, Found { last, sessions }) = Store::open(&folder).expect("again");
    assert_eq!((last, &sessions[..]), (7, &[(7, one)][..]));
    assert_eq!(store.scan(7, 1).expect("there"), (config.clone(), scan), "to the last digit");
    store.write(7, &Record::new(0, Vec::new(), &config), None).expect("taken back");
    assert!(store.scan(7, 1).is_err(), "and gone");
    store.remove(7).expect("ended");
    drop(store);
    let (_, Found { last, sessions }) = Store::open(&folder).expect("again");
    assert_eq!((last, sessions.len()), (7, 0), "no name is given twice");
}

#[test]
fn damage_is_told_with_its_file() {
    let place = tempfile::tempdir().expect("a folder");
    let (store, _) = Store::open(place.path()).expect("a new one");
    store.create(1, &Record::new(0, Vec::new(), &SessionConfig::default())).expect("written");
    drop(store);
    fs::write(place.path().join("1/session.toml"), "version = 2\nscans = 0\n[config]\n").expect("written");
    let told = Store::open(place.path()).err().expect("another version").to_string();
    assert!(told.contains("session.toml") && told.contains("version 2, expected 1"), "{told}");
}
