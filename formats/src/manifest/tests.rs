use super::*;

#[test]
fn every_flipped_bit_of_a_manifest_is_noticed() {
    let home = tempfile::tempdir().unwrap();
    let object = |i: usize| ObjectRecord {
        object: format!("chair/chair_{i:04}"),
        category: "chair".to_owned(),
        split: Split::Train,
        status: ObjectStatus::Done {
            shard: format!("shards/chair/chair_{i:04}.safetensors"),
            samples: 3,
            coverage: vec![0.25, 0.5],
            overlap: vec![0.125],
            void_episodes: 0,
        },
    };
    let manifest = Manifest {
        schema_version: crate::shard::SCHEMA_VERSION,
        sha256: String::new(),
        dataset: "folder".to_owned(),
        config_hash: "abc".to_owned(),
        seed: 4,
        commit: "c0ffee".to_owned(),
        objects: (0..3).map(object).collect(),
    };
    manifest.write(home.path()).unwrap();
    let path = home.path().join(MANIFEST);
    let good = std::fs::read(&path).unwrap();
    checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
        std::fs::write(&path, bad).unwrap();
        Manifest::read(home.path()).map(drop).map_err(|e| e.to_string())
    });
    let text = String::from_utf8(good).unwrap();
    let older: String = text.lines().filter(|l| !l.contains("sha256")).collect();
    std::fs::write(&path, older).unwrap();
    assert_eq!(Manifest::read(home.path()).expect("of an older program"), manifest);
}

#[test]
fn every_flipped_bit_of_a_skipped_object_is_noticed() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("skipped/chair/a.json");
    write_skipped(&path, "chair/a", "chair", Split::Validation, "the mesh has no area").unwrap();
    let record = ObjectRecord {
        object: "chair/a".to_owned(),
        category: "chair".to_owned(),
        split: Split::Validation,
        status: ObjectStatus::Skipped { reason: "the mesh has no area".to_owned() },
    };
    assert_eq!(read_skipped(&path).expect("as written"), record);
    let good = std::fs::read(&path).unwrap();
    checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
        std::fs::write(&path, bad).unwrap();
        read_skipped(&path).map(drop).map_err(|e| e.to_string())
    });
    let text = serde_json::to_string_pretty(&record).unwrap();
    std::fs::write(&path, text).unwrap();
    assert_eq!(read_skipped(&path).expect("of an older program"), record);
}

#[test]
fn a_set_that_was_begun_says_how_it_is_finished() {
    let home = tempfile::tempdir().unwrap();
    let text = || Manifest::read(home.path()).expect_err("no manifest").to_string();
    assert!(text().contains("manifest.json\": cannot read"), "{}", text());
    std::fs::write(home.path().join("run.toml"), "program = \"train 1.0.0\"\n").unwrap();
    assert!(text().contains("manifest.json\": cannot read"), "{}", text());
    std::fs::write(home.path().join("run.toml"), "program = \"datagen 1.0.0\"\n").unwrap();
    assert!(
        text().contains("no manifest.json") && text().contains("run the same `datagen` command again"),
        "{}",
        text()
    );
    std::fs::remove_file(home.path().join("run.toml")).unwrap();
    std::fs::create_dir(home.path().join("shards")).unwrap();
    assert!(text().contains("run the same `datagen` command again"), "{}", text());
}
