use super::*;
use crate::metrics::tests::record;
use crate::record::{EpisodeKey, Skipped, Timing};
use formats::Split;

fn object(name: &str, source: Source) -> Object {
    Object { name: name.to_owned(), category: "test".to_owned(), split: Split::Test, source }
}

fn write(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    std::fs::write(path, text).expect("written");
}

#[test]
fn a_digest_follows_every_file_that_an_object_is_read_from() {
    let home = tempfile::tempdir().expect("dir");
    let at = |name: &str| home.path().join(name);
    let sequence = r#"{"object": "ball", "poses": "poses.txt", "scans": [{"cloud": "scans/0.ply", "depth": "0.png"}]}"#;
    let all = ["a.off", "a_simple60k.npy", "s/sequence.json", "s/poses.txt", "s/scans/0.ply", "s/0.png", "s/notes.txt"];
    for name in all {
        write(&at(name), if name.ends_with(".json") { sequence } else { name });
    }
    let of = |source: Source, surface| digest_of(&object("a", source), surface).expect("readable");
    let mesh = |surface| of(Source::File(at("a.off")), surface);
    let every = || {
        (
            mesh(Surface::Sampled),
            mesh(Surface::Published),
            of(Source::Sequence(at("s/sequence.json")), Surface::Sampled),
        )
    };
    let before = every();
    assert_eq!(before.0, Some(digest(b"a.off")), "as in the shards of a set");
    for (name, changed) in all.into_iter().zip([
        [true, true, false],
        [false, true, false],
        [false, false, true],
        [false, false, true],
        [false, false, true],
        [false, false, true],
        [false, false, false],
    ]) {
        let kept = std::fs::read(at(name)).expect("readable");
        write(&at(name), &format!("{} ", String::from_utf8_lossy(&kept)));
        let now = every();
        assert_eq!([now.0 != before.0, now.1 != before.1, now.2 != before.2], changed, "{name}");
        std::fs::write(at(name), kept).expect("written");
    }
    assert_eq!(every(), before);
    assert_eq!(of(Source::Procedural { seed: 0, index: 3 }, Surface::Sampled), None);
    digest_of(&object("b", Source::File(at("b.off"))), Surface::Sampled).expect_err("there is none");
}

#[test]
fn results_of_other_files_are_refused_by_name_and_failures_tried_again() {
    let home = tempfile::tempdir().expect("dir");
    let objects = ["a", "b", "c"].map(|name| {
        let path = home.path().join(format!("{name}.off"));
        write(&path, name);
        object(name, Source::File(path))
    });
    let mut contents = Contents::default();
    for (name, files) in [("a", Some(digest(b"a"))), ("b", None), ("elsewhere", Some("old".to_owned()))] {
        let mut record = record(name, "p", 0, &[0.5], &[]);
        record.files = files;
        contents.episodes.push((record, Timing { episode_s: 0.1, decisions_s: Vec::new() }));
    }
    for (episode, files) in [(1, None), (2, Some(digest(b"c"))), (3, Some("old".to_owned()))] {
        let key = EpisodeKey { object: "c".to_owned(), policy: "p".to_owned(), episode };
        contents.skipped.push(Skipped { key, reason: "void".to_owned(), weights: None, files });
    }
    let out = Path::new("out");
    let mut kept = contents.clone();
    check(out, &objects, Surface::Sampled, &mut kept).expect("the same, or of an older program, or not asked for");
    assert_eq!(kept.episodes.len(), 3);
    assert_eq!(kept.skipped.iter().map(|s| s.key.episode).collect::<Vec<_>>(), [2]);
    std::fs::write(home.path().join("a.off"), "another").expect("written");
    let error = check(out, &objects, Surface::Sampled, &mut contents).expect_err("another mesh");
    assert_eq!(error.objects, "a");
    assert!(error.to_string().contains("\"out\" contains episodes on other meshes or scans of these names: a; give"));
    assert_eq!(contents.skipped.len(), 3, "nothing was touched");
}
