//! Settings of `infer`; `configs/infer.toml` shows each at its default with unit and source.

use crate::NoReturn;
use crate::accumulate::Accumulate;
use crate::constraints::{Box3, ConstraintsConfig};
use crate::pose::PoseConfig;
use crate::reach::RobotConfig;
use crate::registration::RegistrationConfig;
use crate::scan::{FARTHEST_M, SMALLEST_M};
use crate::sensor::SensorConfig;
use crate::support::Support;
use crate::turntable::TurntableConfig;
use geometry::PinholeCamera;
use geometry::camera::{INTRINSICS, check_intrinsics};
use serde::{Deserialize, Serialize};

/// Largest `max_points`.
pub const MAX_POINTS: usize = 200_000;
/// Points times working distances.
const MAX_POINTS_OF_ALL_STEPS: usize = 1_000_000;
/// Pixels of the next scan's camera.
const MAX_PIXELS: u64 = 1 << 25;

/// Everything that decides an answer.
///
/// ```
/// use planning::{ConstraintsConfig, SessionConfig};
///
/// let constraints = ConstraintsConfig { floor_height_m: Some(0.05), ..Default::default() };
/// let config = SessionConfig { working_distance_m: 0.5, constraints, ..Default::default() };
/// assert!(config.check().is_ok());
/// let wrong = SessionConfig { tolerance_m: -1.0, ..config };
/// assert_eq!(wrong.check().expect_err("refused").to_string(), "tolerance_m = -1.0: expected 1e-6 to 1e6 metres");
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SessionConfig {
    /// Seed of the named random streams.
    pub seed: u64,
    /// Which planner: `auto`, `volumetric`, `benbv-net` or `farthest`.
    pub planner: PlannerName,
    /// What views are ranked by.
    pub rank_by: RankBy,
    /// Distance from target to camera in metres (method, 'Setting': 1.2).
    pub working_distance_m: f64,
    /// Working distances to choose from, smallest and largest, in metres; replaces `working_distance_m`.
    pub working_distance_range_m: Option<[f64; 2]>,
    /// How many distances of the range are tried, both ends included.
    pub working_distance_steps: usize,
    /// Distance under which two points are the same surface, metres (method: 0.002).
    pub tolerance_m: f64,
    /// Only points in this box (smallest and largest corner, metres) are the object; all without it.
    pub region_m: Option<Box3>,
    /// How scans are merged.
    pub accumulate: Accumulate,
    /// Larger clouds are thinned to about this many points; 0 keeps all.
    pub max_points: usize,
    /// A scan with fewer usable points is refused.
    pub min_points: usize,
    /// Points farther from their neighbours than this many times the usual are dropped, unless they lie on a surface that is
    /// sampled more sparsely; 0 keeps all.
    pub outlier_factor: f64,
    /// Stop when the best view is expected to add less than this share of the whole surface, and the last two scans added less; 0: not before no
    /// view is left.
    pub stop_below: f64,
    /// The camera that takes the next scan.
    pub camera: CameraConfig,
    /// What that camera measures.
    pub sensor: SensorConfig,
    /// What pixels without a return mean in depth images.
    pub misses: NoReturn,
    /// Roll of the answered pose.
    pub pose: PoseConfig,
    /// What the object stands on: `none`, `auto` (found in the first scan that shows it), or a plane nx, ny, nz, d.
    pub support: Support,
    /// How far above it points are still taken for it, metres.
    pub support_margin_m: f64,
    /// An arm that carries the camera.
    pub robot: Option<RobotConfig>,
    /// A turntable that the object stands on.
    pub turntable: Option<TurntableConfig>,
    /// What the cell allows; everything is off by default.
    pub constraints: ConstraintsConfig,
    /// Whether scans are registered, and views chosen so that they can be.
    pub registration: RegistrationConfig,
}

impl Default for SessionConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            planner: PlannerName::Auto,
            rank_by: RankBy::Score,
            working_distance_m: 1.2,
            working_distance_range_m: None,
            working_distance_steps: 3,
            tolerance_m: 0.002,
            region_m: None,
            accumulate: Accumulate::Thinned,
            max_points: 10_000,
            min_points: 30,
            outlier_factor: 6.0,
            stop_below: 0.0,
            camera: CameraConfig::default(),
            sensor: SensorConfig::default(),
            misses: NoReturn::Unknown,
            pose: PoseConfig::default(),
            support: Support::None,
            support_margin_m: 0.004,
            robot: None,
            turntable: None,
            constraints: ConstraintsConfig::default(),
            registration: RegistrationConfig::default(),
        }
    }
}

impl SessionConfig {
    /// Refuses values that no answer can be made with.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let length = |key: &'static str, metres: f64| match (SMALLEST_M..=FARTHEST_M).contains(&metres) {
            true => Ok(()),
            false => Err(ConfigError { key, found: format!("{metres:?}"), expected: "1e-6 to 1e6 metres" }),
        };
        length("working_distance_m", self.working_distance_m)?;
        length("tolerance_m", self.tolerance_m)?;
        if let Some([low, high]) = self.working_distance_range_m {
            length("working_distance_range_m", low)?;
            length("working_distance_range_m", high)?;
            if high < low {
                let found = format!("[{low}, {high}]");
                return Err(ConfigError { key: "working_distance_range_m", found, expected: "[smallest, largest]" });
            }
        }
        if self.accumulate == Accumulate::Matched {
            let found = "matched".to_owned();
            return Err(ConfigError { key: "accumulate", found, expected: "thinned or averaged" });
        }
        if !(1..=20).contains(&self.working_distance_steps) {
            let found = self.working_distance_steps.to_string();
            return Err(ConfigError { key: "working_distance_steps", found, expected: "1 to 20" });
        }
        if !(self.max_points == 0 || (100..=MAX_POINTS).contains(&self.max_points)) {
            let found = self.max_points.to_string();
            return Err(ConfigError { key: "max_points", found, expected: "100 to 200,000, or 0 to keep all" });
        }
        let is_box = |[low, high]: &Box3| (0..3).all(|i| low[i] < high[i] && (high[i] - low[i]).is_finite());
        if let Some([low, high]) = self.region_m.filter(|region| !is_box(region)) {
            let found = format!("[{low:?}, {high:?}]");
            return Err(ConfigError { key: "region_m", found, expected: "[[smallest x, y, z], [largest x, y, z]]" });
        }
        if !(self.outlier_factor.is_finite() && self.outlier_factor >= 0.0) {
            let found = self.outlier_factor.to_string();
            return Err(ConfigError { key: "outlier_factor", found, expected: "zero or a positive number" });
        }
        if !(0.0..=1.0).contains(&self.stop_below) {
            let found = self.stop_below.to_string();
            return Err(ConfigError { key: "stop_below", found, expected: "a share from 0 to 1" });
        }
        if !self.pose.extra_roll_deg.is_finite() {
            let found = self.pose.extra_roll_deg.to_string();
            return Err(ConfigError { key: "pose.extra_roll_deg", found, expected: "a number of degrees" });
        }
        if !(self.support_margin_m.is_finite() && self.support_margin_m >= 0.0) {
            let found = self.support_margin_m.to_string();
            return Err(ConfigError {
                key: "support_margin_m",
                found,
                expected: "zero or a positive number of metres",
            });
        }
        self.check_work()?;
        self.camera.check()?;
        self.registration.check()?;
        self.sensor.check(&self.working_distances())?;
        self.support.check()?;
        self.check_arm()?;
        self.turntable.as_ref().map_or(Ok(()), TurntableConfig::check)?;
        self.constraints.check()
    }

    /// Refuses an arm that moves a camera which stands still.
    fn check_arm(&self) -> Result<(), ConfigError> {
        let Some(robot) = &self.robot else { return Ok(()) };
        if self.turntable.as_ref().is_some_and(|t| t.cell_from_camera.is_some()) {
            let found = "a fixed camera and an arm".to_owned();
            return Err(ConfigError { key: "turntable.cell_from_camera", found, expected: "one of them" });
        }
        robot.check()
    }

    /// Refuses what multiplies to more work than a decision can be waited for.
    fn check_work(&self) -> Result<(), ConfigError> {
        let steps = self.working_distances().len();
        let points = if self.max_points == 0 { MAX_POINTS } else { self.max_points };
        if steps > 1 && steps * points > MAX_POINTS_OF_ALL_STEPS {
            let found = format!("{steps} with max_points = {}", self.max_points);
            let expected = "at most 1,000,000 points in all steps: fewer steps, or a smaller max_points";
            return Err(ConfigError { key: "working_distance_steps", found, expected });
        }
        Ok(())
    }

    /// Distances to plan at: one, or evenly spaced over the range.
    pub fn working_distances(&self) -> Vec<f64> {
        match self.working_distance_range_m {
            None => vec![self.working_distance_m],
            Some([low, high]) if low == high || self.working_distance_steps == 1 => vec![0.5 * (low + high)],
            Some([low, high]) => {
                let last = self.working_distance_steps - 1;
                (0..=last).map(|i| low + (high - low) * i as f64 / last as f64).collect()
            }
        }
    }
}

/// A setting out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{key} = {found}: expected {expected}")]
pub struct ConfigError {
    /// The key, as written in the file.
    pub key: &'static str,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub expected: &'static str,
}

/// What the views of a session are ranked by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RankBy {
    /// The planner's score, which weighs coverage and overlap.
    #[default]
    Score,
    /// The expected gain alone, where the planner predicts it: for scans that need no overlap, since their poses are exact.
    Gain,
}

/// A planner's name on the command line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlannerName {
    /// The best that the evidence allows.
    #[default]
    Auto,
    /// Free space carved by past depth images, and the surface expected behind it.
    Volumetric,
    /// The paper's network.
    BenbvNet,
    /// The boundary candidate seen from the direction farthest from all past cameras.
    Farthest,
}

impl PlannerName {
    /// The name as the user writes it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Volumetric => "volumetric",
            Self::BenbvNet => "benbv-net",
            Self::Farthest => "farthest",
        }
    }
}

/// The next scan's camera: image size and vertical field of view, or exact intrinsics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraConfig {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Vertical field of view in degrees.
    pub fov_y_deg: f64,
    /// fx, fy, cx, cy in pixels; replaces the field of view.
    pub intrinsics: Option<[f64; 4]>,
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self { width: 1280, height: 720, fov_y_deg: 70.0, intrinsics: None }
    }
}

impl CameraConfig {
    /// The camera.
    pub fn camera(&self) -> PinholeCamera {
        match self.intrinsics {
            Some([fx, fy, cx, cy]) => PinholeCamera { width: self.width, height: self.height, fx, fy, cx, cy },
            None => PinholeCamera::from_fov_y(self.width, self.height, self.fov_y_deg.to_radians()),
        }
    }

    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=16_384).contains(&self.width) || !(1..=16_384).contains(&self.height) {
            let found = format!("{} x {}", self.width, self.height);
            return Err(ConfigError { key: "camera.width, camera.height", found, expected: "1 to 16,384 pixels" });
        }
        if u64::from(self.width) * u64::from(self.height) > MAX_PIXELS {
            let found = format!("{} x {}", self.width, self.height);
            let expected = "at most 33,554,432 pixels in all";
            return Err(ConfigError { key: "camera.width, camera.height", found, expected });
        }
        if !(self.fov_y_deg > 0.0 && self.fov_y_deg < 180.0) {
            let found = self.fov_y_deg.to_string();
            return Err(ConfigError { key: "camera.fov_y_deg", found, expected: "between 0 and 180" });
        }
        let checked = self.intrinsics.map(check_intrinsics).transpose();
        checked.map(drop).map_err(|found| ConfigError { key: "camera.intrinsics", found, expected: INTRINSICS })
    }
}

#[cfg(test)]
mod tests;
