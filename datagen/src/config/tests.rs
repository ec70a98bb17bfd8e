use super::*;
use std::path::{Path, PathBuf};

fn shipped(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../configs")).join(name)
}

fn load(name: &str) -> DatagenConfig {
    let config: DatagenConfig = formats::config::load(Some(&shipped(name)), &[], &[]).unwrap();
    config.validate().unwrap();
    config
}

/// Dotted keys of a table's values.
fn keys(table: &toml::Table, prefix: &str, out: &mut Vec<String>) {
    for (key, value) in table {
        match value {
            toml::Value::Table(inner) => keys(inner, &format!("{prefix}{key}."), out),
            _ => out.push(format!("{prefix}{key}")),
        }
    }
}

#[test]
fn the_shipped_file_says_every_default() {
    assert_eq!(load("datagen.toml"), DatagenConfig::default());
    let text = std::fs::read_to_string(shipped("datagen.toml")).unwrap();
    let (mut said, mut all) = (vec![], vec![]);
    keys(&text.parse().unwrap(), "", &mut said);
    keys(&toml::Table::try_from(DatagenConfig::default()).unwrap(), "", &mut all);
    said.sort();
    all.sort();
    assert_eq!(said, all, "configs/datagen.toml must spell out every setting, no more");
    // What is absent by default stands there as a comment that is true when it is uncommented.
    let uncommented: Vec<&str> = text
        .lines()
        .map(|l| l.strip_prefix("# ").filter(|r| r.contains(" = ") || r.starts_with('[')).unwrap_or(l))
        .collect();
    let optional: DatagenConfig = toml::from_str(&uncommented.join("\n")).unwrap();
    assert_eq!(optional.episode.render.noise, Some(crate::NoiseConfig::default()));
    assert_eq!(optional.dataset.objects, Some(20));
}

#[test]
fn the_other_files_are_what_their_names_say() {
    let paper = load("paper/datagen.toml");
    assert_eq!((paper.episode, paper.candidates), (EpisodeConfig::paper(), CandidateConfig::paper()));
    assert_eq!((paper.dataset.name, paper.dataset.per_category), (DatasetName::ModelNet40, Some(20)));
    assert_eq!(load("tiny/datagen.toml").dataset.objects, Some(40));
    assert_eq!(load("compact/datagen.toml").cloud_precision, CloudPrecision::F16);
}

#[test]
fn values_that_cannot_be_meant_are_refused() {
    let mut config = DatagenConfig::default();
    config.episode.tolerance_m = f64::NAN;
    assert!(config.validate().unwrap_err().to_string().contains("episode.tolerance_m = NaN"));
    let config = DatagenConfig { surface_samples: 1_000_000_000_000, ..Default::default() };
    assert!(config.validate().unwrap_err().to_string().contains("surface_samples = 1000000000000"));
    let mut config = DatagenConfig::default();
    config.episode.image.width = 1_000_000;
    assert!(config.validate().unwrap_err().to_string().contains("episode.image.width = 1000000"));
    let config = DatagenConfig { validation_share: 1.0, ..Default::default() };
    assert!(config.validate().unwrap_err().to_string().contains("validation_share = 1"));
    let mut config = DatagenConfig::default();
    config.candidates.tilts_deg = vec![0.0, f64::NAN];
    assert!(config.validate().unwrap_err().to_string().contains("candidates.tilts_deg = NaN"));
}

#[test]
fn a_folder_has_no_test_half() {
    let mut config = DatagenConfig::default();
    config.dataset.name = DatasetName::Folder;
    config.validate().unwrap();
    config.dataset.split = Some(SplitChoice::Train);
    config.validate().unwrap();
    config.dataset.split = Some(SplitChoice::Test);
    let text = config.validate().unwrap_err().to_string();
    assert!(text.starts_with("dataset.split = test: ") && text.contains("evaluate --dataset folder --root"), "{text}");
    config.dataset.name = DatasetName::ModelNet40;
    config.validate().unwrap();
}
