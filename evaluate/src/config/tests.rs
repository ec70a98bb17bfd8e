use super::*;

#[test]
fn shipped_configurations_equal_the_code() {
    let load = |path: &str| {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(path);
        formats::config::load::<EvaluateConfig>(Some(&file), &[], &[]).unwrap_or_else(|e| panic!("{path}: {e}"))
    };
    EvaluateConfig::default().validate().expect("defaults are valid");
    EvaluateConfig::paper().validate().expect("the publication's are valid");
    assert_eq!(load("evaluate.toml"), EvaluateConfig::default());
    assert_eq!(load("paper/evaluate.toml"), EvaluateConfig::paper());
}

#[test]
fn every_study_loads_and_changes_outcomes() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/studies");
    let plain = EvaluateConfig::default().outcome_hash().expect("hash");
    let mut studies = 0;
    for entry in std::fs::read_dir(folder).expect("configs/studies").flatten() {
        let config: EvaluateConfig = formats::config::load(Some(&entry.path()), &[], &[]).expect("loads");
        assert_ne!(config.outcome_hash().expect("hash"), plain, "{:?} changes nothing", entry.path());
        studies += 1;
    }
    assert!(studies >= 8);
}

#[test]
fn outcomes_do_not_depend_on_what_is_run_beside_them() {
    let hash = |c: &EvaluateConfig| c.outcome_hash().expect("hash");
    let plain = EvaluateConfig::default();
    let more = EvaluateConfig { episodes: 5, policies: vec!["see".into()], views_if_unreached: 16, ..plain.clone() };
    assert_eq!(hash(&plain), hash(&more));
    assert_ne!(hash(&plain), hash(&EvaluateConfig { seed: 1, ..plain.clone() }));
}

#[test]
fn the_old_name_of_a_setting_is_refused_with_the_new_one() {
    let error =
        formats::config::load::<EvaluateConfig>(None, &["never=16".to_owned()], &[]).expect_err("renamed").to_string();
    assert!(error.contains("`never` is called `views_if_unreached` now"), "{error}");
}
