use super::*;

fn good() -> Ros2Config {
    Ros2Config { base_frame: "base_link".to_owned(), cloud_topic: "/camera/points".to_owned(), ..Ros2Config::default() }
}

#[test]
fn names_and_topics_are_found() {
    let config = Ros2Config { node: "/cell1/nbv".to_owned(), ..good() };
    assert_eq!(config.check(), Ok(()));
    assert_eq!(config.node_name(), ("/cell1", "nbv"));
    assert_eq!(good().node_name(), ("/", "nbv"));
    let depth = Ros2Config { cloud_topic: String::new(), depth_topic: "/eye/depth/image_raw".to_owned(), ..good() };
    assert_eq!((depth.scan_topic(), depth.info_topic().as_str()), ("/eye/depth/image_raw", "/eye/depth/camera_info"));
    let named = Ros2Config { camera_info_topic: "/eye/info".to_owned(), ..depth };
    assert_eq!(named.info_topic(), "/eye/info");
}

#[test]
fn the_domain_is_the_setting_then_the_environment_then_0() {
    assert_eq!(good().domain(None), Ok(0));
    assert_eq!(good().domain(Some("7")), Ok(7));
    assert_eq!(Ros2Config { domain_id: Some(3), ..good() }.domain(Some("7")), Ok(3));
    let wrong = good().domain(Some("seven")).expect_err("no number");
    assert_eq!(wrong.to_string(), "ROS_DOMAIN_ID = seven: expected 0 to 232");
}

#[test]
fn what_no_node_can_do_is_refused_by_key() {
    type Change = fn(&mut Ros2Config);
    let cases: [(Change, &str); 8] = [
        (|c| c.base_frame.clear(), "ros2.base_frame"),
        (|c| c.node = "nbv".to_owned(), "ros2.node"),
        (|c| c.cloud_topic = "/1st/points".to_owned(), "ros2.cloud_topic"),
        (|c| c.cloud_topic.clear(), "ros2.cloud_topic, ros2.depth_topic"),
        (|c| c.depth_topic = "/depth".to_owned(), "ros2.cloud_topic, ros2.depth_topic"),
        (|c| c.wait_s = f64::NAN, "ros2.wait_s"),
        (|c| c.tf_kept_s = 0.0, "ros2.tf_kept_s"),
        (|c| c.domain_id = Some(233), "ros2.domain_id"),
    ];
    for (change, key) in cases {
        let mut config = good();
        change(&mut config);
        assert_eq!(config.check().expect_err("refused").key, key);
    }
}

#[test]
fn changes_of_settings_that_there_are_not_are_refused_at_once() {
    let good = r#"{"working_distance_m": 0.45, "constraints": {"floor_height_m": 0.0}}"#;
    assert_eq!(Ros2Config::check_changes(good), Ok(()));
    for (text, expected) in [
        ("{", "config: not JSON: "),
        ("[0.45]", "config: expected an object of settings"),
        (r#"{"working_distance": 0.45}"#, "config: unknown field `working_distance`"),
        (r#"{"constraints": {"floor": 0.0}}"#, "config: unknown field `floor`"),
        (r#"{"working_distance_m": "near"}"#, "config: invalid type: string \"near\", expected f64"),
    ] {
        let refused = Ros2Config::check_changes(text).expect_err(text);
        assert!(refused.starts_with(expected), "{text}: {refused}");
    }
}
