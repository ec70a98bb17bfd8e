//! The shipped settings say what the code says.
#![allow(missing_docs)]

use std::path::{Path, PathBuf};
use train::TrainConfig;

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(name)
}

#[test]
fn the_commented_defaults_are_the_codes() {
    let path = shipped("train.toml");
    let text = std::fs::read_to_string(&path).expect("shipped");
    let said: toml::Table = text.parse().expect("TOML");
    assert_eq!(said, toml::Table::try_from(TrainConfig::default()).expect("a table"), "every key at its default");
}

#[test]
fn presets_are_valid() {
    for name in ["tiny", "compact", "paper-scale", "pc-nbv", "paper"] {
        let path = shipped(&format!("{name}/train.toml"));
        let config: TrainConfig = formats::config::load(Some(&path), &[], &[]).expect(name);
        config.validate().expect(name);
        assert_ne!(config, TrainConfig::default(), "{name} must differ from the defaults");
    }
}
