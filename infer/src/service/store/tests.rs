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
    let version = told("version = 3\nscans = 0\n[config]\n");
    assert!(version.contains("session.toml") && version.contains("version 3, expected 2"), "{version}");
    assert!(told("version = 2\nscans = 0\n[config]\n").contains("no checksum"));
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

#[test]
fn every_flipped_bit_and_every_lost_end_is_noticed() {
    let place = tempfile::tempdir().expect("a folder");
    let (store, _) = Store::open(place.path()).expect("a new one");
    let config = SessionConfig::default();
    let scan = Written { line: true, bytes: br#"{"points": [[0.125, 0.25, 0.5]]}"#.to_vec() };
    store.create(1, &Record::new(0, Vec::new(), &config)).expect("written");
    store.write(1, &Record::new(1, Vec::new(), &config), Some(&scan)).expect("written");
    drop(store);
    let mut rng = geometry::rng::stream(1, "test/store");
    for name in ["state.toml", "1/session.toml", "1/scan-0001"] {
        let path = place.path().join(name);
        let good = fs::read(&path).expect("there");
        let noticed = |bytes: &[u8]| {
            fs::write(&path, bytes).expect("written");
            let (store, Found { last, sessions }) = Store::open(place.path()).expect("the folder");
            let read =
                || sessions[0].1.is_ok() && store.scan(1, 1).is_ok_and(|read| read == (config.clone(), scan.clone()));
            last > 1000 || !read()
        };
        assert!(!noticed(&good), "{name} as it was written");
        for _ in 0..200 {
            let mut bad = good.clone();
            let bit = rand::RngExt::random_range(&mut rng, 0..8 * bad.len());
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(noticed(&bad), "{name}: bit {bit}");
        }
        let lines = (0..good.len()).filter(|&i| good[i] == b'\n').map(|i| i + 1);
        for end in lines.chain([0, 1, good.len() / 2, good.len() - 1]).filter(|&end| end < good.len()) {
            assert!(noticed(&good[..end]), "{name}: its first {end} bytes");
        }
        fs::write(&path, &good).expect("written");
    }
}

#[test]
fn what_version_1_wrote_is_read() {
    let place = tempfile::tempdir().expect("a folder");
    fs::create_dir(place.path().join("4")).expect("a folder");
    let write = |name: &str, text: &str| fs::write(place.path().join(name), text).expect("written");
    write("state.toml", "version = 1\nlast = 4\n");
    write("4/session.toml", "version = 1\nscans = 1\n[config]\ntolerance_m = 0.003\n");
    write("4/scan-0001", "{\"version\":1,\"line\":false,\"config\":\"tolerance_m = 0.003\"}\n{}");
    let (store, Found { last, sessions }) = Store::open(place.path()).expect("the folder");
    assert!(last == 4 && matches!(sessions[..], [(4, Ok(1))]), "{sessions:?}");
    let config = SessionConfig { tolerance_m: 0.003, ..Default::default() };
    assert_eq!(store.scan(4, 1).expect("there"), (config, Written { line: false, bytes: b"{}".to_vec() }));
}
