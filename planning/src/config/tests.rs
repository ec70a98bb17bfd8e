use super::*;

#[test]
fn shares_are_from_0_to_1() {
    for stop_below in [2.0, -0.1, f64::NAN] {
        let text = SessionConfig { stop_below, ..SessionConfig::default() }.check().expect_err("no share").to_string();
        assert!(text.contains("stop_below = ") && text.contains("share from 0 to 1"), "{text}");
    }
    SessionConfig { stop_below: 1.0, ..SessionConfig::default() }.check().expect("a share");
}

#[test]
fn shipped_file_equals_the_defaults() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/infer.toml"))
        .expect("configs/infer.toml is part of the repository");
    let shipped: SessionConfig = toml::from_str(&text).expect("configs/infer.toml parses");
    assert_eq!(shipped, SessionConfig::default(), "configs/infer.toml must show the code's defaults");
    assert_eq!(shipped.check(), Ok(()), "the defaults must be usable");
}

#[test]
fn values_out_of_range_are_named() {
    let wrong = |set: fn(&mut SessionConfig)| {
        let mut config = SessionConfig::default();
        set(&mut config);
        config.check().expect_err("out of range").key
    };
    assert_eq!(wrong(|c| c.working_distance_m = 0.0), "working_distance_m", "zero distance");
    assert_eq!(wrong(|c| c.working_distance_m = 1e300), "working_distance_m", "no place is so far away");
    assert_eq!(wrong(|c| c.tolerance_m = f64::NAN), "tolerance_m", "NaN");
    assert_eq!(wrong(|c| c.working_distance_range_m = Some([1.0, 0.5])), "working_distance_range_m", "reversed");
    assert_eq!(wrong(|c| c.max_points = 3), "max_points", "too few points");
    assert_eq!(wrong(|c| c.pose.extra_roll_deg = f64::NAN), "pose.extra_roll_deg", "no angle");
    assert_eq!(wrong(|c| c.region_m = Some([[0.0; 3], [1.0, 1.0, f64::INFINITY]])), "region_m", "endless");
    assert_eq!(wrong(|c| (c.camera.width, c.camera.height) = (16_384, 16_384)), "camera.width, camera.height");
    let wide = |c: &mut SessionConfig| {
        (c.working_distance_range_m, c.working_distance_steps, c.max_points) = (Some([0.5, 1.5]), 20, 200_000);
    };
    assert_eq!(wrong(wide), "working_distance_steps", "20 decisions on 200,000 points");
    assert_eq!(wrong(|c| c.constraints.visited_m = vec![[0.0; 3]; 10_001]), "constraints.visited_m");
    assert_eq!(wrong(|c| c.constraints.keep_out_m = vec![[[0.0; 3]; 2]; 1_001]), "constraints.keep_out_m");
    assert_eq!(wrong(|c| c.camera.fov_y_deg = 180.0), "camera.fov_y_deg", "half space");
    assert_eq!(wrong(|c| c.constraints.up = [0.0; 3]), "constraints.up", "no direction");
}

#[test]
fn distances_span_the_range() {
    let config = SessionConfig { working_distance_range_m: Some([0.6, 1.2]), ..Default::default() };
    assert_eq!(config.working_distances(), vec![0.6, 0.6 + 0.6 / 2.0, 1.2], "ends included");
    assert_eq!(SessionConfig::default().working_distances(), vec![1.2], "one distance by default");
}
