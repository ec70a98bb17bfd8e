use super::*;

#[test]
fn shipped_configurations_equal_the_code() {
    let load = |path: &str| {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs").join(path);
        formats::config::load::<EvaluateConfig>(Some(&file), &[], &[]).unwrap_or_else(|e| panic!("{path}: {e}"))
    };
    EvaluateConfig::default().validate().expect("defaults are valid");
    EvaluateConfig::paper().validate().expect("the publication's are valid");
    assert_eq!(load("evaluate.toml"), EvaluateConfig::default());
    assert_eq!(load("paper/evaluate.toml"), EvaluateConfig::paper());
}

#[test]
fn every_study_loads_and_changes_outcomes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/studies");
    let plain = EvaluateConfig::default().outcome_hash().expect("hash");
    let mut studies = 0;
    for entry in std::fs::read_dir(folder).expect("configs/studies").flatten() {
        let config: EvaluateConfig = formats::config::load(Some(&entry.path()), &[], &[]).expect("loads");
        config.validate().unwrap_or_else(|e| panic!("{:?}: {e}", entry.path()));
        assert_ne!(config.outcome_hash().expect("hash"), plain, "{:?} changes nothing", entry.path());
        studies += 1;
    }
    assert!(studies >= 8);
}

#[test]
fn outcomes_do_not_depend_on_what_is_run_beside_them() {
    let hash = |c: &EvaluateConfig| c.outcome_hash().expect("hash");
    let plain = EvaluateConfig::default();
    let more =
        EvaluateConfig { episodes: 5, policies: vec!["see".into()], views_if_unreached: Some(16), ..plain.clone() };
    assert_eq!(hash(&plain), hash(&more));
    assert_ne!(hash(&plain), hash(&EvaluateConfig { seed: 1, ..plain.clone() }));
}

#[test]
fn the_old_name_of_a_setting_is_refused_with_the_new_one() {
    let error =
        formats::config::load::<EvaluateConfig>(None, &["never=16".to_owned()], &[]).expect_err("renamed").to_string();
    assert!(error.contains("`never` is called `views_if_unreached` now"), "{error}");
}

#[test]
fn never_counts_as_more_views_than_there_are() {
    let with = |num_views: usize, views_if_unreached: Option<usize>| {
        let mut config = EvaluateConfig { views_if_unreached, ..EvaluateConfig::default() };
        config.episode.num_views = num_views;
        config
    };
    assert_eq!([15, 40, 8].map(|n| with(n, None).views_if_unreached()), [17, 42, 10]);
    for (num_views, count) in [(15, 16), (35, 37), (40, 41)] {
        with(num_views, Some(count)).validate().unwrap_or_else(|e| panic!("{e}"));
    }
    let error = with(40, Some(17)).validate().expect_err("refused").to_string();
    assert!(error.starts_with("views_if_unreached = 17 with episode.num_views = 40: expected"), "{error}");
    with(40, Some(40)).validate().expect_err("as many as the next views");
}

#[test]
fn runs_of_before_can_be_resumed() {
    let before = EvaluateConfig { views_if_unreached: Some(17), ..EvaluateConfig::default() };
    let hash = formats::config::hash(&before).expect("hash");
    assert_eq!(EvaluateConfig::default().outcome_hash().expect("hash"), hash);
}

#[test]
fn what_differs_is_named_with_both_values() {
    let load = |set: &[&str]| -> EvaluateConfig {
        let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
        formats::config::load(None, &set, &[]).expect("settings")
    };
    let there = load(&["dataset.name=folder", "dataset.root=a", "episode.num_views=3", "policies=[\"see\"]"]);
    let now = load(&["dataset.name=folder", "dataset.root=b", "table={views=9}"]);
    let lines = there.differences(&now);
    let views = "  there: episode.num_views = 3\n  now:   episode.num_views = 15\n";
    assert!(lines.starts_with(&format!("{views}  there: no table\n  now:   table = {{")), "{lines}");
    assert!(!lines.contains("see") && !lines.contains("root"), "{lines}");
    let elsewhere = load(&["dataset.name=folder", "dataset.root=c", "table={views=9}"]);
    let root = "  there: dataset.root = \"b\"\n  now:   dataset.root = \"c\"\n";
    assert_eq!(now.differences(&elsewhere), root, "it is the only one");
    assert_eq!(now.differences(&now), "");
}

#[test]
fn settings_of_views_without_a_meaning_are_refused() {
    let refused = |set: fn(&mut EvaluateConfig)| {
        let mut config = EvaluateConfig::default();
        set(&mut config);
        config.validate().expect_err("out of range").to_string()
    };
    assert!(refused(|c| c.candidates.tilts_deg.clear()).contains("candidates.tilts_deg"));
    assert!(
        refused(|c| c.volumetric.candidates.tilts_deg = vec![f64::NAN]).contains("volumetric.candidates.tilts_deg")
    );
    assert!(refused(|c| c.volumetric.min_overlap = 30.0).contains("volumetric.min_overlap"));
    assert!(refused(|c| c.volumetric.weight_center = -1.0).contains("volumetric.weight_center"));
    assert!(refused(|c| c.volumetric.novelty = f64::NAN).contains("volumetric.novelty"));
    assert!(refused(|c| c.volumetric.voxel_px = 0.0).contains("volumetric.voxel_px"));
    assert!(refused(|c| c.see.radius_m = -0.01).contains("see.radius_m = -0.01: expected a number of at least 0"));
    assert!(refused(|c| c.see.fill = 0.0).contains("see.fill"));
    assert!(refused(|c| c.see.updates_per_scan = 0).contains("see.updates_per_scan"));
}
