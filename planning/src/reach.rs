//! Whether an arm gets the camera to a view: forward and inverse kinematics, joint limits, collisions.
//!
//! Frames: `cell_from_base` places the arm, its last link is the flange, and the camera hangs on it by `flange_from_camera` (the
//! hand-eye calibration).

mod collision;
mod config;
mod inverse;

pub use collision::{Hindrance, Obstacles, balls_of_box, balls_of_cylinder, balls_of_mesh};
pub use config::RobotConfig;
pub use inverse::{Solution, Unreached};

use collision::{Balls, near_pairs};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Joints that move, at most.
pub const MOST_JOINTS: usize = 8;

/// How a joint moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointKind {
    /// It does not.
    #[default]
    Fixed,
    /// About its axis.
    Revolute,
    /// Along its axis.
    Prismatic,
}

/// A joint as URDF has it: its frame in that of the link before it, and how the link behind it moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Origin in the frame of the link before, metres.
    pub xyz_m: [f64; 3],
    /// Roll, pitch, yaw about the fixed axes x, y, z, radians.
    pub rpy_rad: [f64; 3],
    /// Axis in its own frame.
    pub axis: [f64; 3],
    /// Smallest and largest value, radians or metres.
    pub limits: [f64; 2],
    /// The link behind it.
    pub link: Link,
}

/// A link, as balls that hold its collision geometry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Its name.
    pub name: String,
    /// x, y, z and radius of each ball in its frame, metres.
    #[serde(default)]
    pub balls_m: Vec<[f64; 4]>,
}

/// A serial arm from its base to its flange.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arm {
    /// The link that does not move.
    pub base: Link,
    /// From the base on.
    pub joints: Vec<Joint>,
}

/// An arm made ready: fixed joints joined, what can collide known.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    config: RobotConfig,
    /// Of each joint that moves, its frame in the one before.
    origins: Vec<Isometry3<f64>>,
    axes: Vec<(JointKind, Unit<Vector3<f64>>)>,
    names: Vec<String>,
    limits: Vec<[f64; 2]>,
    cell_from_base: Isometry3<f64>,
    /// The camera in the frame of the last joint.
    last_from_camera: Isometry3<f64>,
    /// What moves with the base, and with each joint.
    balls: Vec<Balls>,
    /// Pairs of those that may collide.
    pairs: Vec<(usize, usize)>,
    /// Farthest that the camera can be from the first joint, metres.
    longest: f64,
}

/// Joint values, as many as move.
pub type Joints = [f64; MOST_JOINTS];

/// An arm at a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reached {
    /// Values by the names of the joints, radians or metres, in the order of the arm.
    pub joints: Vec<JointValue>,
    /// Sum of the joints' travel from where the arm is, radians and metres.
    pub travel: f64,
}

/// An arm's way through views, one after the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tour {
    /// Sum of the joints' travel from the first view that it takes to the last, radians and metres.
    pub travel: f64,
    /// Views that it cannot take; it stays where it is.
    pub unreached: usize,
}

/// A joint's value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointValue {
    /// The joint.
    pub name: String,
    /// Radians or metres.
    pub value: f64,
}

impl Reach {
    /// An arm made ready; `config` is checked already.
    pub fn new(config: &RobotConfig) -> Self {
        let mut reach = Self {
            config: config.clone(),
            origins: Vec::new(),
            axes: Vec::new(),
            names: Vec::new(),
            limits: Vec::new(),
            cell_from_base: config.cell_from_base(),
            last_from_camera: Isometry3::identity(),
            balls: vec![Balls::of(&config.arm.base, &Isometry3::identity())],
            pairs: Vec::new(),
            longest: 0.0,
        };
        // Where the next joint's frame is in that of the last joint that moves.
        let mut behind = Isometry3::identity();
        for joint in &config.arm.joints {
            let origin = joint.origin();
            if joint.kind == JointKind::Fixed {
                behind *= origin;
                let link = Balls::of(&joint.link, &behind);
                if let Some(last) = reach.balls.last_mut() {
                    last.join(link);
                }
                continue;
            }
            reach.origins.push(behind * origin);
            reach.axes.push((joint.kind, joint.axis()));
            reach.names.push(joint.name.clone());
            reach.limits.push(joint.limits);
            reach.balls.push(Balls::of(&joint.link, &Isometry3::identity()));
            behind = Isometry3::identity();
        }
        reach.last_from_camera = behind * config.flange_from_camera();
        reach.balls.push(Balls::of(&config.camera_link(), &reach.last_from_camera));
        let along = |k: usize| match reach.axes[k].0 {
            JointKind::Prismatic => reach.limits[k][0].abs().max(reach.limits[k][1].abs()),
            _ => 0.0,
        };
        let lengths = (1..reach.origins.len()).map(|k| reach.origins[k].translation.vector.norm() + along(k));
        reach.longest = lengths.sum::<f64>() + reach.last_from_camera.translation.vector.norm();
        reach.pairs = near_pairs(&reach);
        reach
    }

    /// Joints that move.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether none does.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Their limits.
    pub fn limits(&self) -> &[[f64; 2]] {
        &self.limits
    }

    /// Where the arm is, as far as the settings tell; else in the middle of its limits.
    pub fn home(&self) -> Joints {
        let mut home = [0.0; MOST_JOINTS];
        for (k, value) in home.iter_mut().enumerate().take(self.len()) {
            let [low, high] = self.limits[k];
            *value = self.config.joints.get(k).copied().unwrap_or(0.5 * (low + high));
        }
        home
    }

    /// Frames of the joints that move, in the cell, moved by these values.
    pub fn frames(&self, joints: &Joints) -> Vec<Isometry3<f64>> {
        let mut at = self.cell_from_base;
        let mut frames = Vec::with_capacity(self.len());
        for k in 0..self.len() {
            at = at * self.origins[k] * self.motion(k, joints[k]);
            frames.push(at);
        }
        frames
    }

    fn motion(&self, k: usize, value: f64) -> Isometry3<f64> {
        let (kind, axis) = &self.axes[k];
        match kind {
            JointKind::Prismatic => Translation3::from(axis.into_inner() * value).into(),
            _ => Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(axis, value)),
        }
    }

    /// The camera's pose in the cell at these values.
    pub fn camera(&self, joints: &Joints) -> Isometry3<f64> {
        self.frames(joints).last().copied().unwrap_or(self.cell_from_base) * self.last_from_camera
    }

    /// The flange in the arm's base where the camera is there in the cell.
    pub fn base_from_flange(&self, cell_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        self.cell_from_base.inverse() * cell_from_camera * self.config.flange_from_camera().inverse()
    }

    /// For an answer.
    pub fn reached(&self, joints: &Joints) -> Reached {
        let home = self.home();
        let value = |(k, name): (usize, &String)| JointValue { name: name.clone(), value: joints[k] };
        Reached { joints: self.names.iter().enumerate().map(value).collect(), travel: travel(&home, joints) }
    }

    /// What travel by joints takes off a view's score.
    pub fn cost(&self, reached: &Reached) -> f64 {
        self.config.travel_weight_per_rad * reached.travel
    }

    /// The arm's way to this pose of the camera in the cell without a collision; the object's frame is `cell_from_object` away from the
    /// cell's.
    ///
    /// # Errors
    /// Why there is none.
    pub fn to(
        &self,
        cell_from_camera: &Isometry3<f64>,
        obstacles: &Obstacles,
        cell_from_object: &Isometry3<f64>,
    ) -> Result<Reached, Hindrance> {
        let object_from_cell = cell_from_object.inverse();
        let mut hindered = None;
        for seed in 0..inverse::SEEDS {
            let Some(solution) = self.solve(cell_from_camera, seed) else { continue };
            match self.collides(&solution.joints, obstacles, &object_from_cell) {
                None => return Ok(self.reached(&solution.joints)),
                Some(found) => hindered = hindered.or(Some(found)),
            }
        }
        Err(hindered.unwrap_or_else(|| self.unreached(cell_from_camera).into()))
    }

    /// The way through these poses of the camera in the cell, each as by [`Self::to`] from where the arm is then.
    pub fn tour(
        &self,
        cell_from_cameras: impl IntoIterator<Item = Isometry3<f64>>,
        obstacles: &Obstacles,
        cell_from_object: &Isometry3<f64>,
    ) -> Tour {
        let (mut arm, mut tour, mut begun) = (self.clone(), Tour::default(), false);
        for pose in cell_from_cameras {
            let Ok(reached) = arm.to(&pose, obstacles, cell_from_object) else {
                tour.unreached += 1;
                continue;
            };
            tour.travel += if begun { reached.travel } else { 0.0 };
            begun = true;
            arm.config.joints = reached.joints.iter().map(|joint| joint.value).collect();
        }
        tour
    }
}

impl Joint {
    fn origin(&self) -> Isometry3<f64> {
        let [roll, pitch, yaw] = self.rpy_rad;
        Isometry3::from_parts(Vector3::from(self.xyz_m).into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }

    fn axis(&self) -> Unit<Vector3<f64>> {
        Unit::try_new(Vector3::from(self.axis), 1e-9).unwrap_or_else(Vector3::x_axis)
    }
}

/// Sum of what the joints travel.
fn travel(from: &Joints, to: &Joints) -> f64 {
    from.iter().zip(to).map(|(a, b)| (a - b).abs()).sum()
}

#[cfg(test)]
mod tests;
