use super::*;
use serde::Deserialize;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Camera {
    width: u32,
    fov_y_deg: f64,
}
impl Default for Camera {
    fn default() -> Self {
        Self { width: 1280, fov_y_deg: 70.0 }
    }
}
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Config {
    seed: u64,
    camera: Camera,
    name: String,
    list: Option<PathBuf>,
}

fn message(result: Result<Config, ConfigError>) -> String {
    result.expect_err("this must be refused").to_string()
}

#[test]
fn later_layers_win() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.toml");
    std::fs::write(&file, "seed = 3\nname = \"file\"\n[camera]\nwidth = 10\nfov_y_deg = 50.0\n").unwrap();
    let set = ["camera.width=20".to_owned(), "name=plain-word".to_owned(), "list=/a/b".to_owned()];
    let flags: Vec<Flag> =
        [Flag::given("--seed", "seed", Some(9)), Flag::given("--width", "camera.width", None::<i64>)]
            .into_iter()
            .flatten()
            .collect();
    let config: Config = load(Some(&file), &set, &flags).unwrap();
    let camera = Camera { width: 20, fov_y_deg: 50.0 };
    assert_eq!(config, Config { seed: 9, camera, name: "plain-word".into(), list: Some("/a/b".into()) });
    let again: Config = toml::from_str(&to_toml(&config).unwrap()).unwrap();
    assert_eq!(again, config, "the stored configuration must say the same");
}

#[test]
fn unknown_keys_and_wrong_types_name_their_origin() {
    let text = message(load(None, &["camera.widht=640".to_owned()], &[]));
    assert!(text.contains("--set \"camera.widht=640\"") && text.contains("unknown field `widht`"), "{text}");
    assert!(text.contains("`width` or `fov_y_deg`") && text.contains("camera"), "{text}");
    let text = message(load(None, &["seed=abc".to_owned()], &[]));
    assert!(text.contains("seed=abc") && text.contains("invalid type"), "{text}");
    let text = message(load(None, &["nonsense".to_owned()], &[]));
    assert!(text.contains("expected key=value"), "{text}");
    let text = message(load(None, &[], &[Flag::given("--width", "camera.width", Some(-1)).unwrap()]));
    assert!(text.contains("--width -1"), "{text}");

    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bad.toml");
    std::fs::write(&file, "seed = 3\n[camera]\nwide = 10\n").unwrap();
    let text = message(load(Some(&file), &[], &[]));
    assert!(text.contains("bad.toml") && text.contains("line 3") && text.contains("wide"), "{text}");
}

#[test]
fn stored_settings_know_when_they_were_changed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    let config = Config { seed: 8, name: "a name".into(), ..Config::default() };
    let good = to_stored(&config).unwrap();
    checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
        std::fs::write(&path, bad).unwrap();
        let marked = bad.windows(CHECKSUM.len()).any(|window| window == CHECKSUM);
        let read = load::<Config>(Some(&path), &[], &[]).map_err(|e| e.to_string())?;
        match marked {
            true => check_stored(&path).map_err(|e| e.to_string()),
            // The mark itself was hit: said as a warning, and the settings are sound.
            false => Err(format!("warned, {}", if read == config { "and sound" } else { panic!("{read:?}") })),
        }
    });
}

#[test]
fn the_hash_follows_the_settings() {
    let (a, b) = (Config::default(), Config { seed: 1, ..Config::default() });
    assert_eq!(hash(&a).unwrap(), hash(&a).unwrap());
    assert_ne!(hash(&a).unwrap(), hash(&b).unwrap());
    assert_eq!(hash(&a).unwrap().len(), 16);
}

#[test]
fn an_old_name_is_refused_with_the_new_one() {
    #[derive(Debug, Default, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Renamed {
        learning_rate: f64,
    }
    let error = load::<Renamed>(None, &["rate=0.1".to_owned()], &[]).expect_err("an old name").to_string();
    assert!(error.contains("--set") && error.contains("`rate` is called `learning_rate` now"), "{error}");
    // A setting that never had that name is only unknown.
    #[derive(Debug, Default, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Other {
        seed: u64,
    }
    let error = load::<Other>(None, &["rate=0.1".to_owned()], &[]).expect_err("unknown").to_string();
    assert!(!error.contains("called"), "{error}");
}

#[test]
fn json_is_laid_over_settings_table_by_table() {
    let base = Config::default();
    let over = |changes| overlaid(&base, changes, "config");
    assert_eq!(over(serde_json::json!({})), Ok(Config::default()));
    let wrong = |changes| over(changes).expect_err("refused");
    let unknown = wrong(serde_json::json!({ "no_such_key": 1 }));
    assert!(unknown.starts_with("config: unknown field `no_such_key`"), "{unknown}");
    assert_eq!(wrong(serde_json::json!([1])), "config: expected an object of settings");
}

#[test]
fn null_takes_away_what_is_optional_alone() {
    #[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Cell {
        table: Option<Camera>,
        camera: Camera,
    }
    let base = Cell { table: Some(Camera::default()), ..Cell::default() };
    let over = |base: &Cell, changes| overlaid(base, changes, "config");
    assert_eq!(over(&base, serde_json::json!({ "table": null })), Ok(Cell::default()));
    let again = over(&Cell::default(), serde_json::json!({ "table": { "width": 3 } })).unwrap();
    assert_eq!(again.table.map(|table| table.width), Some(3));
    let error = over(&base, serde_json::json!({ "table": null, "camera": null })).expect_err("not optional");
    assert!(error.starts_with("config: invalid type: null") && error.contains("config.camera"), "{error}");
}

#[test]
fn an_arm_laid_over_another_keeps_none_of_its_links() {
    let arm = |balls_m: &[[f64; 4]]| planning::reach::Arm {
        base: planning::reach::Link { name: "base".to_owned(), balls_m: balls_m.to_vec() },
        joints: Vec::new(),
    };
    let [before, after] = [arm(&[[0.0, 0.0, 0.1, 0.2]]), arm(&[])];
    let changes = serde_json::to_value(&after).expect("JSON");
    assert_eq!(overlaid(&before, changes, "robot.arm"), Ok(after));
}
