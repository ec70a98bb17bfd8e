//! Settings of an arm.

use super::{Arm, JointKind, Link, MOST_JOINTS};
use crate::config::ConfigError;
use crate::constraints::Box3;
use crate::pose::rigid;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// An arm with a camera on its flange.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobotConfig {
    /// Where its base stands in the cell, 4 x 4, row by row; absent: the cell's frame is the base's.
    pub cell_from_base: Option<[[f64; 4]; 4]>,
    /// The camera on the flange (hand-eye calibration), 4 x 4, row by row, metres.
    pub flange_from_camera: Option<[[f64; 4]; 4]>,
    /// The same the other way round.
    pub camera_from_flange: Option<[[f64; 4]; 4]>,
    /// Where it is now: one value per joint that moves, radians or metres; absent: in the middle of its limits.
    pub joints: Vec<f64>,
    /// Least distance of links and camera from measured and expected surface and from boxes, metres.
    pub clearance_m: f64,
    /// The camera's housing in its own frame: smallest and largest corner, metres.
    pub camera_body_m: Box3,
    /// Taken off a view's score for each radian (metre) that the joints travel, summed.
    pub travel_weight_per_rad: f64,
    /// Whether what is not measured yet counts where surface is expected there.
    pub avoid_unknown: bool,
    /// The arm, as `infer --robot` takes it from a URDF.
    pub arm: Arm,
}

impl Default for RobotConfig {
    fn default() -> Self {
        Self {
            cell_from_base: None,
            flange_from_camera: None,
            camera_from_flange: None,
            joints: Vec::new(),
            clearance_m: 0.01,
            camera_body_m: [[-0.05, -0.02, -0.04], [0.05, 0.02, 0.0]],
            travel_weight_per_rad: 0.0,
            avoid_unknown: true,
            arm: Arm::default(),
        }
    }
}

fn pose(rows: Option<&[[f64; 4]; 4]>) -> Isometry3<f64> {
    rows.and_then(|rows| rigid(rows).ok()).map_or_else(Isometry3::identity, |(pose, _)| pose)
}

impl RobotConfig {
    /// Where the base stands.
    pub fn cell_from_base(&self) -> Isometry3<f64> {
        pose(self.cell_from_base.as_ref())
    }

    /// The camera on the flange.
    pub fn flange_from_camera(&self) -> Isometry3<f64> {
        match &self.camera_from_flange {
            Some(inverse) => pose(Some(inverse)).inverse(),
            None => pose(self.flange_from_camera.as_ref()),
        }
    }

    /// The camera's housing as a link.
    pub(super) fn camera_link(&self) -> Link {
        Link { name: "the camera".to_owned(), balls_m: super::collision::balls_of_box(&self.camera_body_m) }
    }

    /// Refuses values without a meaning.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |key, found: String, expected| Err(ConfigError { key, found, expected });
        let moving: Vec<_> = self.arm.joints.iter().filter(|j| j.kind != JointKind::Fixed).collect();
        if moving.is_empty() || moving.len() > MOST_JOINTS {
            let found = format!("{} joints that move", moving.len());
            return wrong("robot.arm", found, "a serial arm of 1 to 8: --robot FILE --tool LINK");
        }
        for joint in &self.arm.joints {
            let [low, high] = joint.limits;
            let numbers = joint.xyz_m.iter().chain(&joint.rpy_rad).chain(&joint.axis).chain(&joint.limits);
            if !numbers.into_iter().all(|x| x.is_finite() && x.abs() < 1e4) || low > high {
                return wrong("robot.arm", format!("joint {:?}", joint.name), "finite numbers, limits smallest first");
            }
        }
        let links = std::iter::once(&self.arm.base).chain(self.arm.joints.iter().map(|j| &j.link));
        let balls: usize = links.clone().map(|link| link.balls_m.len()).sum();
        if balls > 5_000 || links.flat_map(|link| &link.balls_m).flatten().any(|x| !x.is_finite()) {
            return wrong("robot.arm", format!("{balls} balls"), "at most 5,000 finite ones");
        }
        let poses = [
            ("robot.cell_from_base", &self.cell_from_base),
            ("robot.flange_from_camera", &self.flange_from_camera),
            ("robot.camera_from_flange", &self.camera_from_flange),
        ];
        for (key, rows) in poses {
            if let Some(Err(found)) = rows.as_ref().map(rigid) {
                let found = found.replace("world_from_camera", "it");
                return wrong(key, found, "a rigid motion, 4 x 4, row by row, metres");
            }
        }
        match (&self.flange_from_camera, &self.camera_from_flange) {
            (None, None) => {
                return wrong(
                    "robot.flange_from_camera",
                    "nothing".to_owned(),
                    "the hand-eye calibration, in either direction",
                );
            }
            (Some(_), Some(_)) => {
                return wrong(
                    "robot.camera_from_flange",
                    "both".to_owned(),
                    "flange_from_camera or camera_from_flange",
                );
            }
            _ => {}
        }
        if !(self.joints.is_empty() || self.joints.len() == moving.len() && self.joints.iter().all(|x| x.is_finite())) {
            return wrong("robot.joints", format!("{} values", self.joints.len()), "one per joint that moves, or none");
        }
        for (key, value) in
            [("robot.clearance_m", self.clearance_m), ("robot.travel_weight_per_rad", self.travel_weight_per_rad)]
        {
            if !(value.is_finite() && value >= 0.0) {
                return wrong(key, value.to_string(), "zero or a positive number");
            }
        }
        let [low, high] = self.camera_body_m;
        if !(0..3).all(|k| low[k].is_finite() && high[k].is_finite() && low[k] <= high[k] && high[k] - low[k] < 2.0) {
            return wrong(
                "robot.camera_body_m",
                format!("{:?}", self.camera_body_m),
                "[[smallest x, y, z], [largest x, y, z]]",
            );
        }
        Ok(())
    }
}
