//! What can be changed while the node runs, as ROS parameters; all else is a setting of its start.

use crate::Ros2Config;
use ros2_client::{Node, NodeOptions, ParameterValue};

pub(super) fn declare(options: NodeOptions, config: &Ros2Config) -> NodeOptions {
    let start = config.clone();
    options
        .declare_parameter("base_frame", ParameterValue::String(config.base_frame.clone()))
        .declare_parameter("sensor_frame", ParameterValue::String(config.sensor_frame.clone()))
        .declare_parameter("wait_s", ParameterValue::Double(config.wait_s))
        .declare_parameter("max_age_s", ParameterValue::Double(config.max_age_s))
        .declare_parameter("config", ParameterValue::String(String::new()))
        .parameter_validator(Box::new(move |name, value| validate(&start, name, value)))
}

/// Refuses what would not do.
fn validate(start: &Ros2Config, name: &str, value: &ParameterValue) -> Result<(), String> {
    let mut changed = start.clone();
    match (name, value) {
        ("base_frame", ParameterValue::String(frame)) if *frame != start.base_frame => {
            return Err("base_frame: the scans so far are in it; start the node with another".to_owned());
        }
        ("config", ParameterValue::String(text)) if !text.trim().is_empty() => {
            return Ros2Config::check_changes(text);
        }
        ("wait_s", ParameterValue::Double(seconds)) => changed.wait_s = *seconds,
        ("max_age_s", ParameterValue::Double(seconds)) => changed.max_age_s = *seconds,
        _ => {}
    }
    changed.check().map_err(|e| e.to_string())
}

/// The settings as they are now, and what shall change of the session's.
pub(super) fn current(node: &Node, config: &Ros2Config) -> (Ros2Config, String) {
    let mut now = config.clone();
    let mut changes = String::new();
    if let Some(ParameterValue::String(frame)) = node.get_parameter("sensor_frame") {
        now.sensor_frame = frame;
    }
    if let Some(ParameterValue::Double(seconds)) = node.get_parameter("wait_s") {
        now.wait_s = seconds;
    }
    if let Some(ParameterValue::Double(seconds)) = node.get_parameter("max_age_s") {
        now.max_age_s = seconds;
    }
    if let Some(ParameterValue::String(text)) = node.get_parameter("config") {
        changes = text;
    }
    (now, changes)
}
