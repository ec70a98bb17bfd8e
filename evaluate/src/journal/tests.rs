use super::*;
use crate::metrics::tests::record;

fn open(directory: &Path, settings: &str) -> Result<(Journal, Contents), JournalError> {
    Journal::open(directory, settings, settings)
}

fn entry(episode: usize) -> Entry {
    let timing = Timing { episode_s: 0.1, decisions_s: vec![0.01] };
    Entry::Episode { record: record("a", "p", episode, &[0.3, 1.0 / 3.0], &[Some(0.1)]), timing }
}

#[test]
fn goes_on_after_a_cut_line_and_refuses_other_settings() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, contents) = open(dir.path(), "h1").expect("new");
    assert!(contents.episodes.is_empty());
    journal.append(&entry(1)).expect("written");
    journal.append(&entry(0)).expect("written");
    drop(journal);
    let path = dir.path().join(JOURNAL);
    let mut text = std::fs::read_to_string(&path).expect("readable");
    text.push_str("{\"episode\":{\"rec");
    std::fs::write(&path, &text).expect("writable");
    let (journal, contents) = open(dir.path(), "h1").expect("reopened");
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
    let error = open(dir.path(), "h2").err().expect("refused").to_string();
    assert!(["other settings", "--out", "objects by --only"].iter().all(|part| error.contains(part)), "{error}");
    std::fs::write(&path, "{}\n").expect("writable");
    assert!(read(dir.path()).expect_err("refused").to_string().contains("line 1"));
}

#[test]
fn every_flipped_bit_of_a_journal_is_noticed() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, _) = open(dir.path(), "h1").expect("new");
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
        match open(dir.path(), "h1") {
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
    let (journal, _) = open(dir.path(), "h1").expect("new");
    let skipped = |episode: usize, reason: &str| {
        let Entry::Episode { record, .. } = entry(episode) else { panic!("an episode") };
        Entry::Skipped(Skipped { key: record.key, reason: reason.to_owned(), weights: None, files: None })
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

#[test]
fn without_its_first_line_a_journal_is_refused_with_the_line() {
    let dir = tempfile::tempdir().expect("a directory");
    let config = EvaluateConfig { seed: 7, ..EvaluateConfig::default() };
    let hash = config.outcome_hash().expect("hash");
    let (journal, _) = open(dir.path(), &hash).expect("new");
    (0..2).for_each(|i| journal.append(&entry(i)).expect("written"));
    drop(journal);
    let path = dir.path().join(JOURNAL);
    let good = std::fs::read_to_string(&path).expect("readable");
    let (first, rest) = good.split_once('\n').expect("lines");
    let refused = |text: &str| {
        std::fs::write(&path, text).expect("writable");
        let error = open(dir.path(), "h2").err().expect("other settings would go unnoticed").to_string();
        assert_eq!(error, read(dir.path()).expect_err("nor is it compared").to_string());
        assert!(error.contains("line 1: ") && error.contains("give another --out"), "{error}");
        assert!(!error.contains("delete"), "{error}");
        error
    };
    for damaged in [rest.to_owned(), good.replacen(&hash[..3], "xyz", 1)] {
        assert!(!refused(&damaged).contains(first), "nothing says what it was");
    }
    formats::run::RunDir::create(dir.path(), "evaluate", "c", &config).expect("written");
    for damaged in [rest.to_owned(), good.replacen("settings", "setting5", 1)] {
        assert!(refused(&damaged).ends_with(&format!(":\n{first}")), "as it was");
    }
    std::fs::write(&path, &good).expect("writable");
    assert_eq!(open(dir.path(), &hash).expect("restored").1.episodes.len(), 2);
}

#[test]
fn where_objects_lie_does_not_matter_if_their_files_are_known() {
    let of = |root: &str| {
        let mut config = EvaluateConfig::default();
        config.dataset.name = datagen::dataset::DatasetName::Folder;
        config.dataset.root = Some(root.into());
        (config.outcome_hash().expect("hash"), config.placed_hash().expect("hash"))
    };
    let (here, there) = (of("meshes"), of("./meshes"));
    assert!(here.0 == there.0 && here.1 != there.1);
    let with = |files: Option<&str>| {
        let Entry::Episode { mut record, timing } = entry(0) else { panic!("an episode") };
        record.files = files.map(str::to_owned);
        Entry::Episode { record, timing }
    };
    let begun = |hash: &str, files: Option<&str>| {
        let dir = tempfile::tempdir().expect("a directory");
        let (journal, _) = open(dir.path(), hash).expect("new");
        journal.append(&with(files)).expect("written");
        dir
    };
    let resumes = |dir: &tempfile::TempDir, hashes: &(String, String)| {
        Journal::open(dir.path(), &hashes.0, &hashes.1).map(|(_, contents)| contents.episodes.len())
    };
    let new = begun(&here.0, Some("m1"));
    assert_eq!([&here, &there].map(|hashes| resumes(&new, hashes).expect("resumed")), [1, 1]);
    // An older program's: the place is all that tells its objects from others.
    let older = begun(&here.1, None);
    assert_eq!(resumes(&older, &here).expect("resumed"), 1);
    assert!(matches!(resumes(&older, &there), Err(JournalError::OtherSettings { .. })));
    // Of the default place.
    let older = begun(&here.0, None);
    assert!(matches!(resumes(&older, &there), Err(JournalError::OtherSettings { .. })));
}

#[test]
fn what_failed_on_other_weights_or_files_is_tried_again() {
    let skipped = |episode: usize, weights: Option<&str>, files: Option<&str>| {
        let Entry::Episode { record, .. } = entry(episode) else { panic!("an episode") };
        let [weights, files] = [weights, files].map(|digest| digest.map(str::to_owned));
        Skipped { key: record.key, reason: "raised".to_owned(), weights, files }
    };
    let left = |contents: &Contents| contents.skipped.iter().map(|s| s.key.episode).collect::<Vec<_>>();
    let skipped = vec![skipped(0, None, None), skipped(1, Some("w1"), Some("m1")), skipped(2, Some("w2"), Some("m2"))];
    let contents = Contents { episodes: Vec::new(), skipped };
    let mut others = contents.clone();
    assert_eq!((others.forget_other_weights("p", Some("w2")), left(&others)), (0, vec![2]));
    assert_eq!((others.forget_other_weights("q", Some("w1")), left(&others)), (0, vec![2]), "another policy");
    let mut others = contents.clone();
    others.forget_skipped_on_other_files(&BTreeMap::from([("a", Some("m1".to_owned()))]));
    assert_eq!(left(&others), [1]);
    others.forget_skipped_on_other_files(&BTreeMap::from([("b", Some("m2".to_owned()))]));
    assert_eq!(left(&others), [1], "another object");
    let mut built_in = contents;
    built_in.forget_other_weights("p", None);
    built_in.forget_skipped_on_other_files(&BTreeMap::from([("a", None)]));
    assert_eq!(left(&built_in), [0], "without weights and files nothing changed");
}

#[test]
fn text_stays_text_and_older_numbers_are_read() {
    let dir = tempfile::tempdir().expect("a directory");
    let (journal, _) = open(dir.path(), "h1").expect("new");
    let Entry::Episode { mut record, timing } = entry(0) else { panic!("an episode") };
    record.key.object = "f64:1.5".to_owned();
    journal.append(&Entry::Episode { record: record.clone(), timing }).expect("written");
    drop(journal);
    assert_eq!(read(dir.path()).expect("readable").episodes[0].0, record);
    let path = dir.path().join(JOURNAL);
    let text = std::fs::read_to_string(&path).expect("readable");
    let (first, line) = text.trim_end().split_once('\n').expect("lines");
    let object = opened(line).expect("sound");
    let older = object.replace("0.3333333333333333", "\"f64:0.3333333333333333\"");
    assert!(object != older, "a number of the record: {object}");
    std::fs::write(&path, format!("{first}\n{}\n", sealed(&older))).expect("writable");
    assert_eq!(read(dir.path()).expect("of an older program").episodes[0].0, record);
}
