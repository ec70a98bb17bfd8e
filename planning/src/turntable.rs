//! A turntable: where the object stands at each angle, and which stop suits a view.
//!
//! The object's frame is that of the plans: the cell's, with the table at 0 degrees. The cell's frame is that of the arm and of
//! calibrated cameras; it stays where it is when the table turns.

use crate::config::ConfigError;
use crate::pose::rigid;
use crate::{Scan, SessionConfig};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Most stops.
const MOST_STOPS: usize = 720;

/// A turntable, in the cell's frame.
///
/// ```
/// use planning::TurntableConfig;
///
/// let table = TurntableConfig { range_deg: Some([0.0, 360.0]), step_deg: 45.0, ..Default::default() };
/// assert_eq!(table.stops().len(), 8, "a full turn ends where it began");
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TurntableConfig {
    /// A point on its axis, metres.
    pub axis_point_m: [f64; 3],
    /// The direction of its axis; angles count counter-clockwise seen against it.
    pub axis_direction: [f64; 3],
    /// Angles where it stops, degrees.
    pub stops_deg: Vec<f64>,
    /// Stops from the first of these angles to the second instead, `step_deg` apart.
    pub range_deg: Option<[f64; 2]>,
    /// Between two stops of the range, degrees.
    pub step_deg: f64,
    /// Pose of a camera that stands still, 4 x 4, row by row; absent: the camera moves (an arm, a hand).
    pub cell_from_camera: Option<[[f64; 4]; 4]>,
}

impl Default for TurntableConfig {
    fn default() -> Self {
        Self {
            axis_point_m: [0.0; 3],
            axis_direction: [0.0, 0.0, 1.0],
            stops_deg: Vec::new(),
            range_deg: None,
            step_deg: 30.0,
            cell_from_camera: None,
        }
    }
}

impl TurntableConfig {
    /// The stops, degrees.
    pub fn stops(&self) -> Vec<f64> {
        match self.range_deg {
            None => self.stops_deg.clone(),
            Some([from, to]) => {
                let steps = ((to - from) / self.step_deg + 1e-9).floor() as usize;
                // A full turn ends where it began.
                let closed = ((to - from) - 360.0).abs() < 1e-9 && steps as f64 * self.step_deg > 360.0 - 1e-6;
                (0..steps + usize::from(!closed)).map(|i| from + i as f64 * self.step_deg).collect()
            }
        }
    }

    /// The object's motion from angle 0 to this one, in the cell's frame.
    pub fn cell_from_object(&self, angle_deg: f64) -> Isometry3<f64> {
        let axis = Unit::new_normalize(Vector3::from(self.axis_direction));
        let turn = UnitQuaternion::from_axis_angle(&axis, angle_deg.to_radians());
        let point = Point3::from(self.axis_point_m);
        Isometry3::from_parts((point.coords - turn * point.coords).into(), turn)
    }

    /// Poses of the camera in the object's frame at all stops (the stop first, then the pose): of the camera that stands still, or of
    /// these poses in the cell's frame. Empty where the camera moves freely.
    pub fn views(&self, poses: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
        let fixed = self.fixed_camera();
        let poses = fixed.as_ref().map_or(poses, std::slice::from_ref);
        let at = |stop: f64| self.cell_from_object(stop).inverse();
        self.stops().into_iter().flat_map(|stop| poses.iter().map(move |pose| at(stop) * pose)).collect()
    }

    /// The camera that stands still, in the cell's frame.
    pub fn fixed_camera(&self) -> Option<Isometry3<f64>> {
        self.cell_from_camera.as_ref().and_then(|rows| rigid(rows).ok()).map(|(pose, _)| pose)
    }

    /// Refuses values without a meaning.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |key, found: String, expected| Err(ConfigError { key, found, expected });
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite() && x.abs() < 1e6);
        if !finite(&self.axis_point_m) {
            return wrong("turntable.axis_point_m", format!("{:?}", self.axis_point_m), "x, y, z in metres");
        }
        if !finite(&self.axis_direction) || Vector3::from(self.axis_direction).norm() < 1e-9 {
            return wrong(
                "turntable.axis_direction",
                format!("{:?}", self.axis_direction),
                "a direction that is not zero",
            );
        }
        if !finite(&self.stops_deg) {
            return wrong("turntable.stops_deg", format!("{:?}", self.stops_deg), "angles in degrees");
        }
        if let Some(range) = self.range_deg {
            if !self.stops_deg.is_empty() {
                return wrong("turntable.range_deg", format!("{range:?}"), "either stops_deg or range_deg");
            }
            if !(finite(&range) && range[1] > range[0] && range[1] - range[0] <= 360.0 + 1e-9) {
                return wrong(
                    "turntable.range_deg",
                    format!("{range:?}"),
                    "[smallest, largest], 360 degrees apart at most",
                );
            }
            if !(self.step_deg.is_finite() && self.step_deg >= 0.5) {
                return wrong("turntable.step_deg", self.step_deg.to_string(), "0.5 degrees or more");
            }
        }
        let stops = self.stops().len();
        if stops == 0 || stops > MOST_STOPS {
            return wrong(
                "turntable.stops_deg",
                format!("{stops} stops"),
                "1 to 720: stops_deg, or range_deg with step_deg",
            );
        }
        match self.cell_from_camera.as_ref().map(rigid) {
            Some(Err(found)) => {
                let found = found.replace("world_from_camera", "it");
                wrong("turntable.cell_from_camera", found, "a rigid motion, 4 x 4, row by row, metres")
            }
            _ => Ok(()),
        }
    }
}

impl SessionConfig {
    /// Up in the cell as the object has it with the table at this angle, degrees. Without a table both are one.
    pub(crate) fn up_in_object(&self, table_deg: f64) -> Vector3<f64> {
        let up = self.constraints.up();
        self.turntable.as_ref().map_or(up, |table| table.cell_from_object(table_deg).inverse_transform_vector(&up))
    }
}

/// The smaller of the two turns from one angle to the other, degrees.
pub(crate) fn turn_between_deg(a: f64, b: f64) -> f64 {
    (a - b).rem_euclid(360.0).min((b - a).rem_euclid(360.0))
}

/// Where the table stops for a view, and where the camera stands then.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TableStop {
    /// The table's angle, degrees.
    pub stop_deg: f64,
    /// The camera's pose in the cell's frame, which does not turn.
    pub cell_from_camera: crate::pose::Pose,
}

impl Scan {
    /// The same scan in a frame that is `to_from_own` away from its own.
    pub fn moved(mut self, to_from_own: &Isometry3<f64>) -> Self {
        match &mut self {
            Self::Cloud { cloud, from } => {
                *cloud = cloud.transformed(to_from_own);
                *from = from.map(|p| to_from_own * p);
            }
            Self::Lines { cloud, path } => {
                *cloud = cloud.transformed(to_from_own);
                *path = path.map(|p| to_from_own * p);
            }
            Self::Depth { world_from_camera, .. } => *world_from_camera = to_from_own * *world_from_camera,
        }
        self
    }
}

#[cfg(test)]
mod tests;
