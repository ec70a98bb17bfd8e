use super::*;
use crate::service::{Fingerprint, Key, Method, Reply};
use nalgebra::{Isometry3, Vector3};

fn kept(key: &str, body: &str) -> Kept {
    let key = Key::new(key, Method::Create, None, &Fingerprint::default()).expect("a key");
    Kept::new(key, &Reply::new(200, body.to_owned()))
}

#[test]
fn sessions_are_found_again_as_they_were_written() {
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path().join("state");
    let (store, Found { last, sessions, .. }) = Store::open(&folder).expect("a new one");
    assert_eq!((last, sessions.len()), (0, 0));
    let taken = Store::open(&folder).err().expect("one at a time").to_string();
    assert!(taken.contains("in use by another process (infer, process"), "{taken}");
    let config = SessionConfig { tolerance_m: 0.1 + 0.2, ..Default::default() };
    store.create(7, &Record::new(0, Vec::new(), &config), Vec::new()).expect("written");
    let pose = Isometry3::new(Vector3::new(0.1 + 0.2, -1.0, 1e-300), Vector3::new(0.3, 0.2, 0.1));
    let told = Told { notes: vec!["a \"note\"".to_owned()], world_from_camera: Some(pose) };
    let scan = Written { line: false, bytes: b"{\n}".to_vec(), told: Some(told) };
    let rejected_from_m = vec![[0.1 + 0.2, -1.0, 1e-300], [0.0; 3]];
    let one = Record { rejected_from_m, created: Some(kept("c", "{}")), ..Record::new(1, Vec::new(), &config) };
    store.write(7, &one, Some(&scan)).expect("written");
    drop(store);
    let (store, Found { last, sessions, .. }) = Store::open(&folder).expect("again");
    assert!(last == 7 && matches!(sessions[..], [(7, Ok(1))]), "{sessions:?}");
    assert_eq!(store.record(7).expect("there"), one);
    assert_eq!(store.scan(7, 1).expect("there"), (config.clone(), scan), "to the last digit");
    store.write(7, &Record::new(0, Vec::new(), &config), None).expect("taken back");
    assert!(store.scan(7, 1).is_err(), "and gone");
    store.remove(7).expect("ended");
    drop(store);
    let (_, Found { last, sessions, .. }) = Store::open(&folder).expect("again");
    assert_eq!((last, sessions.len()), (7, 0), "no name is given twice");
}

#[test]
fn answers_to_who_created_or_deleted_a_session_are_found_and_what_was_begun_is_ended() {
    let place = tempfile::tempdir().expect("a folder");
    let created = |key: &str| {
        let record = Record::new(0, Vec::new(), &SessionConfig::default());
        Record { created: Some(kept(key, "created")), ..record }
    };
    let again = || {
        let (store, found) = Store::open(place.path()).expect("the folder");
        let names: Vec<u64> = found.sessions.iter().map(|(id, _)| *id).collect();
        (store, names, found.answers)
    };
    let (store, _, none) = again();
    store.create(1, &created("a"), none).expect("written");
    drop(store);
    let (store, _, answers) = again();
    assert_eq!(answers, [kept("a", "created")]);
    store.create(2, &created("b"), answers).expect("written");
    drop(store);
    let (store, names, mut answers) = again();
    assert_eq!((names, &answers[..]), (vec![1, 2], &[kept("a", "created"), kept("b", "created")][..]));
    answers.push(kept("d", "deleted"));
    // As far as it gets before the program ends.
    let begun = State { version: VERSION, last: 2, deleting: Some(1), answers: answers.clone() };
    store.write_state(&begun).expect("written");
    drop(store);
    let (store, names, found) = again();
    assert_eq!((names, found), (vec![2], answers.clone()));
    drop(store);
    fs::create_dir(place.path().join("1")).expect("a folder");
    fs::copy(place.path().join("2/session.toml"), place.path().join("1/session.toml")).expect("put back by hand");
    let (store, names, _) = again();
    assert_eq!(names, [1, 2], "ended once");
    store.delete(2, 2, answers.clone()).expect("ended");
    drop(store);
    let (_, names, found) = again();
    assert_eq!((names, found), (vec![1], answers));
}

#[test]
fn damage_is_told_with_its_file() {
    let place = tempfile::tempdir().expect("a folder");
    let (store, _) = Store::open(place.path()).expect("a new one");
    store.create(1, &Record::new(0, Vec::new(), &SessionConfig::default()), Vec::new()).expect("written");
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
    fs::File::create(&scan).and_then(|file| file.set_len(80 << 20)).expect("a hole");
    let large = store.scan_size(1, 1, 64 << 20).expect_err("large").to_string();
    assert!(large.contains("80 MiB, more than service.body_mib = 64 allows: raise it to 80"), "{large}");
    assert!(!large.contains(WAY_OUT), "nothing is wrong with it: {large}");
    assert_eq!(store.scan_size(1, 1, 80 << 20).expect("fits"), 80 << 20);
}

#[test]
fn what_another_version_wrote_is_not_called_damaged_nor_replaced() {
    let (place, store) = with_a_session();
    let scan = Written { line: false, bytes: b"{}".to_vec(), told: None };
    store.write(1, &Record::new(1, Vec::new(), &SessionConfig::default()), Some(&scan)).expect("written");
    drop(store);
    let foreign = |error: StoreError, name: &str, key: &str| {
        let told = error.to_string();
        assert!(
            told.contains(name) && told.contains(key) && told.contains("another version of infer wrote it"),
            "{told}"
        );
        assert!(!told.contains("delete"), "{told}");
    };
    // Sealed as it is written by a program that knows more.
    let rewrite = |name: &str, key: &[u8], change: &dyn Fn(String) -> String| {
        let path = place.path().join(name);
        let mut bytes = change(fs::read_to_string(&path).expect("there")).into_bytes();
        checksum::seal(&mut bytes, key);
        fs::write(&path, bytes).expect("written");
    };
    rewrite("1/scan-0001", SCAN_SEAL, &|text| text.replace("\"line\"", "\"colour\":1,\"line\""));
    rewrite("1/session.toml", SEAL, &|text| text.replace("scans = 1", "scans = 1\nnewer = 2"));
    let (store, Found { mut sessions, .. }) = Store::open(place.path()).expect("the folder");
    foreign(sessions.remove(0).1.expect_err("unknown"), "session.toml", "newer");
    foreign(store.scan(1, 1).expect_err("unknown"), "scan-0001", "colour");
    foreign(store.refused(1, 1, "unknown field `x`"), "scan-0001", "`x`");
    drop(store);
    rewrite("state.toml", SEAL, &|text| text + "newer = 2\n");
    foreign(Store::open(place.path()).err().expect("not replaced"), "state.toml", "newer");
    rewrite("state.toml", SEAL, &|text| text.replace("version = 2", "version = 3"));
    let version = Store::open(place.path()).err().expect("of another version").to_string();
    assert!(version.contains("version 3, expected 2"), "before what it does not know: {version}");
}

#[test]
fn every_flipped_bit_and_every_lost_end_is_noticed() {
    let place = tempfile::tempdir().expect("a folder");
    let (store, _) = Store::open(place.path()).expect("a new one");
    let config = SessionConfig::default();
    let scan = Written { line: true, bytes: br#"{"points": [[0.125, 0.25, 0.5]]}"#.to_vec(), told: None };
    store.create(1, &Record::new(0, Vec::new(), &config), vec![kept("k", "{}")]).expect("written");
    store.write(1, &Record::new(1, Vec::new(), &config), Some(&scan)).expect("written");
    drop(store);
    let mut rng = geometry::rng::stream(1, "test/store");
    for name in ["state.toml", "1/session.toml", "1/scan-0001"] {
        let path = place.path().join(name);
        let good = fs::read(&path).expect("there");
        let noticed = |bytes: &[u8]| {
            fs::write(&path, bytes).expect("written");
            let (store, Found { last, sessions, .. }) = Store::open(place.path()).expect("the folder");
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
    let (store, Found { last, sessions, .. }) = Store::open(place.path()).expect("the folder");
    assert!(last == 4 && matches!(sessions[..], [(4, Ok(1))]), "{sessions:?}");
    let config = SessionConfig { tolerance_m: 0.003, ..Default::default() };
    assert_eq!(store.scan(4, 1).expect("there"), (config, Written { line: false, bytes: b"{}".to_vec(), told: None }));
}

/// A folder with a session 1.
fn with_a_session() -> (tempfile::TempDir, Store) {
    let place = tempfile::tempdir().expect("a folder");
    let (store, _) = Store::open(place.path()).expect("a new one");
    store.create(1, &Record::new(0, Vec::new(), &SessionConfig::default()), Vec::new()).expect("written");
    (place, store)
}

#[test]
fn a_session_is_deleted_where_no_space_is_left() {
    let (place, store) = with_a_session();
    let (folder, answers) = (place.path().join("1"), vec![kept("d", "deleted")]);
    let full_until_it_is_gone = |state: &State| {
        if folder.exists() {
            let cause = std::io::Error::from(ErrorKind::StorageFull);
            return Err(StoreError::from(formats::FormatError::io(&folder, "write", cause)));
        }
        store.write_state(state)
    };
    let state = State { version: VERSION, last: 1, deleting: Some(1), answers: answers.clone() };
    store.delete_with(1, state, full_until_it_is_gone).expect("ended");
    drop(store);
    let (_, found) = Store::open(place.path()).expect("again");
    assert!(found.sessions.is_empty(), "{found:?}");
    assert_eq!(found.answers, answers);
}

#[test]
fn a_session_that_cannot_be_removed_is_still_there_after_a_restart() {
    let (place, store) = with_a_session();
    let [record, aside] = ["1/session.toml", "aside"].map(|name| place.path().join(name));
    fs::rename(&record, &aside).expect("moved");
    fs::create_dir(&record).expect("what cannot be removed as a file");
    assert!(store.delete(1, 1, vec![kept("d", "deleted")]).is_err());
    fs::remove_dir(&record).expect("removed");
    fs::rename(&aside, &record).expect("moved back");
    drop(store);
    let (_, found) = Store::open(place.path()).expect("again");
    assert!(matches!(found.sessions[..], [(1, Ok(0))]), "{found:?}");
    assert!(found.answers.is_empty(), "nobody is told that it was deleted");
}

#[test]
fn a_removed_session_is_not_written_again() {
    let (place, store) = with_a_session();
    store.remove(1).expect("ended");
    let scan = Written { line: false, bytes: b"{}".to_vec(), told: None };
    let one = Record::new(1, Vec::new(), &SessionConfig::default());
    assert!(store.write(1, &one, Some(&scan)).is_err());
    assert!(!place.path().join("1").exists());
}
