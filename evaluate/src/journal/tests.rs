use super::*;
use crate::metrics::tests::record;

fn entry(episode: usize) -> Entry {
    let timing = Timing { episode_s: 0.1, decisions_s: vec![0.01] };
    Entry::Episode { record: record("a", "p", episode, &[0.3, 1.0 / 3.0], &[Some(0.1)]), timing }
}

#[test]
fn goes_on_after_a_cut_line_and_refuses_other_settings() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, contents) = Journal::open(dir.path(), "h1").expect("new");
    assert!(contents.episodes.is_empty());
    journal.append(&entry(1)).expect("written");
    journal.append(&entry(0)).expect("written");
    drop(journal);
    let path = dir.path().join(JOURNAL);
    let mut text = std::fs::read_to_string(&path).expect("readable");
    text.push_str("{\"episode\":{\"rec");
    std::fs::write(&path, &text).expect("writable");
    let (journal, contents) = Journal::open(dir.path(), "h1").expect("reopened");
    assert_eq!(contents.episodes.len(), 2);
    assert_eq!(contents.episodes[0].0.key.episode, 0, "sorted by key");
    assert_eq!(contents.episodes[0].0.coverages[1], 1.0 / 3.0, "numbers survive exactly");
    journal.append(&entry(2)).expect("written");
    assert_eq!(read(dir.path()).expect("readable").episodes.len(), 3);
    let Entry::Episode { mut record, timing } = entry(1) else { panic!("an episode") };
    record.weights = Some("new".to_owned());
    journal.append(&Entry::Episode { record, timing }).expect("written");
    let mut contents = read(dir.path()).expect("readable");
    let weights: Vec<_> = contents.episodes.iter().map(|(r, _)| r.weights.as_deref()).collect();
    assert_eq!(weights, [None, Some("new"), None], "the later of two counts");
    assert_eq!(contents.forget_other_weights("q", Some("new")), 0);
    assert_eq!(contents.forget_other_weights("p", Some("new")), 2);
    let error = Journal::open(dir.path(), "h2").err().expect("refused").to_string();
    assert!(["other settings", "--out", "objects by --only"].iter().all(|part| error.contains(part)), "{error}");
    std::fs::write(&path, "{}\n").expect("writable");
    assert!(read(dir.path()).expect_err("refused").to_string().contains("line 1"));
}

#[test]
fn every_flipped_bit_of_a_journal_is_noticed() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, _) = Journal::open(dir.path(), "h1").expect("new");
    (0..4).for_each(|i| journal.append(&entry(i)).expect("written"));
    drop(journal);
    let path = dir.path().join(JOURNAL);
    let good = std::fs::read(&path).expect("readable");
    let whole = read(dir.path()).expect("readable").episodes;
    let mut rng = geometry::rng::stream(2, "test/flips");
    for _ in 0..200 {
        let (byte, bit) =
            (rand::RngExt::random_range(&mut rng, 0..good.len()), rand::RngExt::random_range(&mut rng, 0..8));
        let mut bad = good.clone();
        bad[byte] ^= 1 << bit;
        std::fs::write(&path, &bad).expect("writable");
        match Journal::open(dir.path(), "h1") {
            Err(error) => assert!(error.to_string().contains("line "), "{error}"),
            // The end of the last line: it counts as cut off, and its episode is run again.
            Ok((_, contents)) => {
                assert_eq!(byte, good.len() - 1, "bit {bit} of byte {byte} was not noticed");
                assert_eq!(contents.episodes, whole[..3]);
            }
        }
    }
    let older: String =
        String::from_utf8(good).expect("text").lines().map(|l| opened(l).expect("sound") + "\n").collect();
    std::fs::write(&path, older).expect("writable");
    assert_eq!(read(dir.path()).expect("of an older program").episodes, whole);
}

#[test]
fn what_was_tried_again_is_what_became_of_it_last() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, _) = Journal::open(dir.path(), "h1").expect("new");
    let skipped = |episode: usize, reason: &str| {
        let Entry::Episode { record, .. } = entry(episode) else { panic!("an episode") };
        Entry::Skipped(Skipped { key: record.key, reason: reason.to_owned() })
    };
    for entry in
        [skipped(0, "raised"), entry(1), skipped(2, "late"), entry(0), skipped(1, "raised"), skipped(2, "none")]
    {
        journal.append(&entry).expect("written");
    }
    let mut contents = read(dir.path()).expect("readable");
    let run: Vec<usize> = contents.episodes.iter().map(|(r, _)| r.key.episode).collect();
    assert_eq!(run, [0], "failed first, then run");
    let left: Vec<_> = contents.skipped.iter().map(|s| (s.key.episode, s.reason.as_str())).collect();
    assert_eq!(left, [(1, "raised"), (2, "none")], "run first, then failed; failed twice");
    contents.forget_skipped("q");
    assert_eq!(contents.skipped.len(), 2);
    contents.forget_skipped("p");
    assert_eq!((contents.skipped.len(), contents.forget("q"), contents.forget("p")), (0, 0, 1));
}
