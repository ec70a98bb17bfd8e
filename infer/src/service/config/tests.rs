use super::*;

#[test]
fn shipped_file_equals_the_defaults() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/service.toml"));
    let (shipped, _) = ServeConfig::load(Some(path), &[], &[]).expect("configs/service.toml parses");
    assert_eq!(shipped, ServeConfig::default(), "configs/service.toml must show the code's defaults");
    assert_eq!(shipped.service.check(), Ok(()), "the defaults must be usable");
}

#[test]
fn settings_of_the_service_are_told_from_those_of_sessions() {
    let set = ["service.scans=3", "seed=4", "ros2.wait_s=5"].map(str::to_owned);
    let (config, others) = ServeConfig::load(None, &set, &[]).expect("settings");
    assert_eq!((config.service.scans, config.ros2.wait_s), (3, 5.0));
    assert_eq!(others, ["seed=4"]);
    let wrong = ServeConfig::load(None, &["service.colour=1".to_owned()], &[]).expect_err("unknown");
    assert!(wrong.to_string().contains("colour"), "{wrong}");
    let late = ServiceConfig { deadline_ms: 200_000, ..Default::default() };
    assert_eq!(late.check().expect_err("too long").key, "service.deadline_ms");
}
