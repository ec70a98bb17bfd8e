use super::*;

#[test]
fn utc_knows_the_calendar() {
    let at = |s| utc(UNIX_EPOCH + Duration::from_secs(s));
    assert_eq!(at(0), "1970-01-01T00:00:00Z");
    assert_eq!(at(951_782_400), "2000-02-29T00:00:00Z");
    assert_eq!(at(1_709_251_199), "2024-02-29T23:59:59Z");
    assert_eq!(at(4_102_444_800), "2100-01-01T00:00:00Z");
}

#[test]
fn a_failed_write_leaves_the_old_file_and_no_litter() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("deep/er/a.bin");
    atomic_write(&path, b"old").unwrap();
    let broken = atomic_write_with(&path, |w| {
        w.write_all(b"half")?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
    });
    assert!(matches!(broken, Err(FormatError::Io { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    let names: Vec<_> = std::fs::read_dir(path.parent().unwrap()).unwrap().collect();
    assert_eq!(names.len(), 1, "{names:?}");
    let long = dir.path().join("deep/er").join("ü".repeat(127));
    atomic_write(&long, b"a name of 254 bytes").unwrap();
    std::fs::remove_file(&long).unwrap();
    std::fs::write(path.with_file_name(".a.bin.x1.tmp"), b"left over").unwrap();
    remove_temporaries(&path);
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn the_newest_run_is_found_by_its_marker() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(newest(dir.path(), "manifest.json"), None);
    for name in ["a", "b"] {
        atomic_write(&dir.path().join(name).join("manifest.json"), b"{}").unwrap();
        std::thread::sleep(Duration::from_millis(15));
    }
    std::fs::create_dir(dir.path().join("c")).unwrap();
    assert_eq!(newest(dir.path(), "manifest.json"), Some(dir.path().join("b")));
}

#[test]
fn a_run_that_another_version_goes_on_with_says_so_and_keeps_it_noted() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path();
    let mixture = |commit: &str| {
        let run = RunDir::create(path, "evaluate", commit, &toml::Table::new()).expect("made");
        run.mixture("episodes").unwrap_or_default()
    };
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(mixture("one"), "", "nothing was there");
    assert_eq!(mixture("one"), "", "the same version");
    let text = mixture("two");
    let both = format!("by evaluate {version} (one), and this is evaluate {version} (two)");
    assert!(text.contains(&both) && text.contains("another --out"), "{text}");
    assert_eq!(mixture("two"), text, "it stays noted");
    assert!(mixture("one").contains("(two), and this is"), "{text}");
    let text = mixture("three");
    assert!(text.contains(&format!("(two), evaluate {version} (one), and")), "{text}");
    std::fs::write(path.join("run.toml"), "program = \"evaluate 0.1.0\"\n").expect("written");
    assert!(mixture("three").contains("by evaluate 0.1.0 (unknown), and"));
    std::fs::write(path.join("run.toml"), "= no TOML").expect("written");
    assert!(mixture("three").contains("by an unknown version, and"));
}

#[cfg(unix)]
#[test]
fn a_link_is_followed_and_stays_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let [file, link] = ["real.txt", "link.txt"].map(|name| folder.path().join(name));
    std::fs::write(&file, "old").expect("written");
    std::os::unix::fs::symlink("real.txt", &link).expect("linked");
    atomic_write(&link, b"new").expect("written");
    assert!(link.is_symlink());
    assert_eq!(std::fs::read(&file).expect("read"), b"new");
    let [there, to_there] = ["there", "to_there"].map(|name| folder.path().join(name));
    std::fs::create_dir(&there).expect("made");
    std::os::unix::fs::symlink("there", &to_there).expect("linked");
    atomic_write(&to_there, b"new").expect_err("a directory");
    assert!(to_there.is_symlink() && there.is_dir());
}

#[cfg(unix)]
#[test]
fn a_link_to_a_file_that_is_not_there_yet_is_followed_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let [file, middle, link] = ["real.txt", "middle.txt", "link.txt"].map(|name| folder.path().join(name));
    std::os::unix::fs::symlink(&file, &middle).expect("linked");
    std::os::unix::fs::symlink("middle.txt", &link).expect("linked");
    atomic_write(&link, b"new").expect("written");
    assert!(link.is_symlink() && middle.is_symlink());
    assert_eq!(std::fs::read(&file).expect("read"), b"new");
}

#[cfg(unix)]
#[test]
fn a_pipe_is_written_to_and_not_replaced_by_a_file() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().expect("a folder");
    let [pipe, link] = ["pipe", "link"].map(|name| folder.path().join(name));
    if !std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
        return;
    }
    std::os::unix::fs::symlink("pipe", &link).expect("linked");
    for path in [&pipe, &link] {
        // Both ends are held open, so that the writer does not wait.
        let mut reader = std::fs::File::options().read(true).write(true).open(&pipe).expect("opened");
        atomic_write(path, b"page").expect("written");
        assert!(std::fs::metadata(&pipe).expect("there").file_type().is_fifo(), "{path:?}");
        let mut found = [0; 4];
        std::io::Read::read_exact(&mut reader, &mut found).expect("read");
        assert_eq!(&found, b"page");
    }
    assert!(link.is_symlink());
}
