//! Settings of the registration of scans.

use crate::config::ConfigError;
use serde::{Deserialize, Serialize};

/// What is done with a new scan that may not lie where its pose says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Register {
    /// Nothing: the pose is believed.
    #[default]
    Off,
    /// It is registered, and the answer says what was found; nothing is moved.
    Check,
    /// It is moved onto the cloud, its camera with it, or refused where that is not safe.
    Refine,
}

/// How carefully ICP pairs points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Icp {
    /// Only points whose normals are alike, none at the rim of the cloud in the end.
    #[default]
    Good,
    /// The nearest point whatever it is, as plain point-to-plane ICP does.
    Plain,
}

/// The point about which the robot's errors of rotation turn a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum About {
    /// The camera: an arm that carries it.
    #[default]
    Camera,
    /// The object: a turntable, or a pose error that was measured there.
    Object,
}

/// What the planner holds a candidate against, so that its scan can be registered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Registrability {
    /// The expected overlap where scans are moved onto the cloud (`register = "refine"`), else nothing.
    #[default]
    Auto,
    /// Nothing.
    Off,
    /// The expected overlap.
    Overlap,
    /// How well the surface that it would see again determines every motion.
    Lambda,
}

/// What follows a scan that could not be registered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AfterAlarm {
    /// It is lost, and views are ranked as before.
    #[default]
    Ignore,
    /// It is kept aside and tried again after each merged scan, and a view that sees its surface and that of the cloud comes first.
    Bridge,
}

/// Settings of the registration of scans onto the cloud. `[registration]` in `configs/infer.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RegistrationConfig {
    /// What is done with a new scan.
    pub register: Register,
    /// How ICP pairs points.
    pub kind: Icp,
    /// Weigh the measurement against what the robot is known to be good for.
    pub prior: bool,
    /// Refuse results that are not safe.
    pub gate: bool,
    /// Standard deviation of the given pose, per axis, metres.
    pub pose_error_m: f64,
    /// The same of its rotation, degrees.
    pub pose_error_deg: f64,
    /// The point about which it turns.
    pub pose_error_about: About,
    /// What candidates are held against.
    pub registrability: Registrability,
    /// What follows a scan that could not be registered.
    pub after_alarm: AfterAlarm,
    /// Adjust all scans together after each that is merged (`register = "refine"`, `kind = "good"`): later ones may hold earlier ones better.
    pub adjust: bool,
}

impl Default for RegistrationConfig {
    /// Off; an arm good to 2 mm and 0.3 degrees.
    fn default() -> Self {
        Self {
            register: Register::Off,
            kind: Icp::Good,
            prior: true,
            gate: true,
            pose_error_m: 0.002,
            pose_error_deg: 0.3,
            pose_error_about: About::Camera,
            registrability: Registrability::Auto,
            after_alarm: AfterAlarm::Ignore,
            adjust: true,
        }
    }
}

impl RegistrationConfig {
    /// What candidates are held against, `Auto` decided.
    pub fn rule(&self) -> Registrability {
        match (self.registrability, self.register) {
            (Registrability::Auto, Register::Refine) => Registrability::Overlap,
            (Registrability::Auto, _) => Registrability::Off,
            (asked, _) => asked,
        }
    }

    /// Refuses values without a meaning.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |key, found: f64, expected| Err(ConfigError { key, found: found.to_string(), expected });
        if !(self.pose_error_m > 0.0 && self.pose_error_m.is_finite()) {
            let expected = "a length above 0 (register = \"off\" takes poses as exact)";
            return wrong("registration.pose_error_m", self.pose_error_m, expected);
        }
        if !(self.pose_error_deg > 0.0 && self.pose_error_deg <= 45.0) {
            let expected = "an angle above 0 and up to 45 (ICP needs an approximate start)";
            return wrong("registration.pose_error_deg", self.pose_error_deg, expected);
        }
        Ok(())
    }
}
