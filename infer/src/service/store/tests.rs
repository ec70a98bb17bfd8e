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
    assert!(last == 7 && matches!(sessions[..], [(7, Ok(1))]), "{sessions:?}");
    assert_eq!(store.record(7).expect("there"), one);
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
    let told = |text: &str| {
        fs::write(place.path().join("1/session.toml"), text).expect("written");
        let (_, Found { sessions, .. }) = Store::open(place.path()).expect("the folder");
        sessions[0].1.as_ref().expect_err("damaged").to_string()
    };
    let version = told("version = 2\nscans = 0\n[config]\n");
    assert!(version.contains("session.toml") && version.contains("version 2, expected 1"), "{version}");
    assert!(told(&"#".repeat(9 << 20)).contains("9 MiB, and no such file is larger than 8"));
    assert!(told("scans").contains("session.toml"));
    fs::write(place.path().join("state.toml"), "version = 1\nlast =").expect("written");
    let (store, Found { last, .. }) = Store::open(place.path()).expect("the folder");
    assert!(last > 1000, "no name is given twice: {last}");
    let scan = place.path().join("1/scan-0001");
    File::create(&scan).and_then(|file| file.set_len(80 << 20)).expect("a hole");
    assert!(store.scan_size(1, 1, 64 << 20).expect_err("large").to_string().contains("80 MiB, and no scan"));
    assert_eq!(store.scan_size(1, 1, 80 << 20).expect("fits"), 80 << 20);
}
