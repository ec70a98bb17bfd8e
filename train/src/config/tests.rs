use super::*;

#[test]
fn data_is_a_path_or_several() {
    let data = |set: &str| {
        let config = formats::config::load::<TrainConfig>(None, &[set.to_string()], &[]).expect("settings");
        config.data.iter().map(|p| p.display().to_string()).collect::<Vec<_>>()
    };
    assert_eq!(data("data=runs/data/a"), ["runs/data/a"]);
    assert_eq!(data(r#"data=["a", "b"]"#), ["a", "b"]);
    assert!(data("data=''").is_empty());
    let wrong = formats::config::load::<TrainConfig>(None, &["data=3".to_string()], &[]).expect_err("no path");
    assert!(wrong.to_string().contains("a path or a list of paths"), "{wrong}");
}

#[test]
fn settings_out_of_range_are_named() {
    TrainConfig::default().validate().expect("defaults are valid");
    type Spoil = fn(&mut TrainConfig);
    let cases: [(Spoil, &str); 10] = [
        (|c| c.loader.ready = 1_000_000_000_000, "setting loader.ready = 1000000000000: expected at most 1024"),
        (|c| c.batch = 0, "setting batch = 0: expected at least 1"),
        (|c| c.optimizer.learning_rate = f64::NAN, "optimizer.learning_rate"),
        (|c| c.validation.fraction = 1.0, "validation.fraction = 1: expected a share in (0, 1)"),
        (|c| c.augment.diagonal_fraction = [1.0, 0.5], "augment.diagonal_fraction"),
        (|c| c.network.heads = 3, "heads"),
        (|c| c.accumulation = 1000, "at most the batch, 128"),
        (|c| c.schedule.factor = 0.0, "schedule.factor"),
        (|c| c.pc_nbv.points = 16, "setting pc_nbv.points = 16: expected at least 17"),
        (|c| c.pc_nbv.gain_unit = 0.0, "setting pc_nbv.gain_unit = 0: expected a positive number"),
    ];
    for (change, expected) in cases {
        let mut config = TrainConfig::default();
        change(&mut config);
        let text = config.validate().expect_err(expected).to_string();
        assert!(text.contains(expected), "{text}");
    }
}
