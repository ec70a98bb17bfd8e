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
