//! Settings of the node; `configs/service.toml` shows each at its default.

use formats::config::{SettingError, overlaid};
use planning::SessionConfig;
use serde::{Deserialize, Serialize};
use std::net::IpAddr;
use std::time::Duration;

/// Settings of the node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2Config {
    /// Namespace and name of the node; its topics and services stand below.
    pub node: String,
    /// The frame that the object stands still in: scans are brought into it, poses are answered in it.
    pub base_frame: String,
    /// Frame of the camera, where that is not the frame that its messages name.
    pub sensor_frame: String,
    /// `PointCloud2`; either this or `depth_topic`.
    pub cloud_topic: String,
    /// `Image` of depth.
    pub depth_topic: String,
    /// `CameraInfo` of it; empty: `camera_info` beside it.
    pub camera_info_topic: String,
    /// Depth images are undistorted already.
    pub rectified: bool,
    /// Of scans.
    pub reliability: Reliability,
    /// How services of the others are laid out.
    pub services: Services,
    /// How long `plan` waits for a scan, and for its transform, seconds.
    pub wait_s: f64,
    /// A scan that came longer ago is not taken, seconds.
    pub max_age_s: f64,
    /// How long transforms are kept, seconds.
    pub tf_kept_s: f64,
    /// Of the socket, MiB: what the system gives at most.
    pub receive_buffer_mib: usize,
    /// Addresses of the network interfaces to use; all if empty.
    pub interfaces: Vec<IpAddr>,
    /// Instead of `ROS_DOMAIN_ID`.
    pub domain_id: Option<u16>,
}

/// Whether lost parts of a scan are sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reliability {
    /// No; takes scans of every publisher.
    BestEffort,
    /// Yes; takes no scans of publishers that send best effort.
    Reliable,
}

/// How services are laid out over DDS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Services {
    /// `rmw_fastrtps`, ROS 2's default.
    FastRtps,
    /// `rmw_cyclonedds`.
    CycloneDds,
}

impl Default for Ros2Config {
    fn default() -> Self {
        Self {
            node: "/nbv".to_owned(),
            base_frame: String::new(),
            sensor_frame: String::new(),
            cloud_topic: String::new(),
            depth_topic: String::new(),
            camera_info_topic: String::new(),
            rectified: false,
            reliability: Reliability::BestEffort,
            services: Services::FastRtps,
            wait_s: 2.0,
            max_age_s: 30.0,
            tf_kept_s: 60.0,
            receive_buffer_mib: 8,
            interfaces: Vec::new(),
            domain_id: None,
        }
    }
}

/// Names of ROS: letters, digits and underscores between slashes, no digit first.
fn is_name(name: &str) -> bool {
    let is_part = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    name.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_part))
}

impl Ros2Config {
    /// Refuses what no node can do.
    ///
    /// # Errors
    /// The first key that is wrong, with what it must be.
    pub fn check(&self) -> Result<(), SettingError> {
        if !is_name(&self.node) {
            return Err(SettingError::new("ros2.node", &self.node, "a name such as /nbv or /cell1/nbv"));
        }
        if self.base_frame.is_empty() {
            let expected = "the frame that the object stands still in: --ros2 base_link";
            return Err(SettingError::new("ros2.base_frame", "\"\"", expected));
        }
        let topics = [
            ("ros2.cloud_topic", &self.cloud_topic),
            ("ros2.depth_topic", &self.depth_topic),
            ("ros2.camera_info_topic", &self.camera_info_topic),
        ];
        for (key, name) in topics {
            if !name.is_empty() && !is_name(name) {
                return Err(SettingError::new(key, name, "a whole name such as /camera/points"));
            }
        }
        if self.cloud_topic.is_empty() == self.depth_topic.is_empty() {
            let found = if self.cloud_topic.is_empty() { "none of both" } else { "both" };
            let expected = "one topic of scans: --set ros2.cloud_topic=/camera/points, or ros2.depth_topic";
            return Err(SettingError::new("ros2.cloud_topic, ros2.depth_topic", found, expected));
        }
        let times = [
            ("ros2.wait_s", self.wait_s, 0.0..=600.0, "0 to 600"),
            ("ros2.max_age_s", self.max_age_s, 0.001..=86_400.0, "0.001 to 86,400"),
            ("ros2.tf_kept_s", self.tf_kept_s, 1.0..=3600.0, "1 to 3,600"),
        ];
        for (key, found, allowed, expected) in times {
            if !allowed.contains(&found) {
                return Err(SettingError::new(key, found, expected));
            }
        }
        if !(1..=1024).contains(&self.receive_buffer_mib) {
            return Err(SettingError::new("ros2.receive_buffer_mib", self.receive_buffer_mib, "1 to 1,024"));
        }
        if self.domain_id.is_some_and(|id| id > MOST_DOMAIN) {
            let found = self.domain_id.unwrap_or_default();
            return Err(SettingError::new("ros2.domain_id", found, "0 to 232"));
        }
        Ok(())
    }

    /// Refuses changes of a session's settings that are no JSON, or have a name or type wrong. What is in range depends on its other
    /// settings: `plan` refuses what is not.
    ///
    /// # Errors
    /// Where, and what is expected.
    pub fn check_changes(text: &str) -> Result<(), String> {
        let changes = serde_json::from_str(text).map_err(|e| format!("config: not JSON: {e}"))?;
        overlaid(&SessionConfig::default(), changes, "config").map(drop)
    }

    /// The topic of scans.
    pub fn scan_topic(&self) -> &str {
        if self.depth_topic.is_empty() { &self.cloud_topic } else { &self.depth_topic }
    }

    /// The topic of the depth image's camera.
    pub fn info_topic(&self) -> String {
        match (self.camera_info_topic.as_str(), self.depth_topic.rsplit_once('/')) {
            ("", Some((folder, _))) => format!("{folder}/camera_info"),
            (given, _) => given.to_owned(),
        }
    }

    /// Namespace and name.
    pub fn node_name(&self) -> (&str, &str) {
        match self.node.rsplit_once('/') {
            Some(("", name)) => ("/", name),
            Some((namespace, name)) => (namespace, name),
            None => ("/", &self.node),
        }
    }

    /// The domain: the setting, else `environment` (`ROS_DOMAIN_ID`), else 0.
    ///
    /// # Errors
    /// It is no domain.
    pub fn domain(&self, environment: Option<&str>) -> Result<u16, SettingError> {
        match (self.domain_id, environment.map(str::trim)) {
            (Some(id), _) => Ok(id),
            (None, None | Some("")) => Ok(0),
            (None, Some(text)) => text
                .parse()
                .ok()
                .filter(|id| *id <= MOST_DOMAIN)
                .ok_or_else(|| SettingError::new("ROS_DOMAIN_ID", text, "0 to 232")),
        }
    }

    /// [`Ros2Config::wait_s`].
    pub fn wait(&self) -> Duration {
        Duration::from_secs_f64(self.wait_s)
    }
}

/// Above, ports run out.
const MOST_DOMAIN: u16 = 232;

#[cfg(test)]
mod tests;
