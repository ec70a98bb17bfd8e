//! What a scan could be registered by, predicted before it is taken: the known surface that a view would see again.

use super::visible::visible;
use super::{About, Frame, Icp, Information, Motion, PoseError, Registrability, RegistrationConfig};
use crate::ScanState;
use geometry::View;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Largest probability of failure that the planner accepts.
const ACCEPTED: f64 = 0.15;

/// What is expected of registering a view's scan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// How well the known surface that it sees again determines the motion that it determines least.
    pub lambda: f64,
    /// Probability that the scan ends more than a tolerance from where it should be.
    pub failure: f64,
    /// That motion, if anything is seen again.
    pub weakest: Option<Motion>,
}

impl Prediction {
    /// For people.
    pub fn describe(&self) -> String {
        let weakest = self.weakest.map_or(", nothing known is in view".to_owned(), |motion| format!(", may {motion}"));
        let named = if self.failure > ACCEPTED || self.weakest.is_none() { weakest } else { String::new() };
        format!("registration fails with {:.0} %{named}", 100.0 * self.failure)
    }
}

/// The surface of the session's cloud that a view measures from this pose of its camera.
pub fn seen_again(state: &ScanState, view: &View, world_from_camera: &Isometry3<f64>, frame: &Frame) -> Information {
    let mut information = Information::default();
    for (i, area) in visible(&state.cloud, state.grid_size, state, view, world_from_camera) {
        let n = &state.cloud.normals[i];
        let n: Vector3<f64> = n / n.norm();
        information.add(&(state.cloud.points[i] - frame.center), &n, area, frame.radius);
    }
    information
}

/// What the planner asks of a view, by the settings and the robot's error on this object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    rule: Registrability,
    /// Logit of failure at a lambda of 1, and how it falls with the logarithm of lambda.
    fit: [f64; 2],
    overlap: f64,
    /// Root mean square of how far the robot puts a scan's points off, metres.
    pub(crate) error_m: f64,
}

impl Demand {
    /// Logits of failure at a lambda of 1 where the error at the surface is 0.055 and 0.22 of the object's radius, and the slope:
    /// of good and of plain ICP. From 26 objects; docs/registration.md, 'Predicting failures'.
    const FITS: [[f64; 3]; 2] = [[-2.14, -0.18, 1.23], [1.1, 2.13, 1.21]];
    /// Below this one lambda is like another.
    const LEAST_LAMBDA: f64 = 0.05;
    /// Overlaps required with the same errors. Plain: a seventh of the scans fails there. Good: 0.12 less than where a seventh did before
    /// scans were adjusted together, best on 26 objects (docs/registration.md, 'Scans adjusted together').
    const OVERLAPS: [[f64; 2]; 2] = [[0.16, 0.32], [0.38, 0.56]];
    const ERRORS: [f64; 2] = [0.055, 0.22];

    /// What the settings ask of views on this state, with the object's frame as far as it is known; `None` where they ask nothing.
    pub fn on(state: &ScanState, config: &RegistrationConfig) -> Option<(Self, Frame)> {
        let asked = config.rule() != Registrability::Off && !state.cloud.is_empty();
        let frame = asked.then(|| Frame::around(&[&state.cloud]))?;
        Some((Self::new(config, &frame, state.working_distance), frame))
    }

    /// By the settings, for views at `distance` from an object in this frame.
    pub fn new(config: &RegistrationConfig, frame: &Frame, distance: f64) -> Self {
        let kind = usize::from(config.kind == Icp::Plain);
        let turn = config.pose_error_deg.to_radians();
        let lever = match config.pose_error_about {
            About::Camera => distance * distance,
            About::Object => 0.0,
        };
        let error_m = (3.0 * config.pose_error_m.powi(2) + 2.0 * turn * turn * (frame.radius.powi(2) + lever)).sqrt();
        let [small, large, slope] = Self::FITS[kind];
        let between = (error_m / frame.radius / Self::ERRORS[0]).ln() / (Self::ERRORS[1] / Self::ERRORS[0]).ln();
        let between = between.clamp(-0.5, 1.5);
        let at = |small: f64, large: f64| small + (large - small) * between;
        let [few, many] = Self::OVERLAPS[kind];
        Self { rule: config.rule(), fit: [at(small, large), slope], overlap: at(few, many), error_m }
    }

    /// Probability of failure at this lambda.
    pub fn failure(&self, lambda: f64) -> f64 {
        let logit = self.fit[0] - self.fit[1] * lambda.max(Self::LEAST_LAMBDA).ln();
        1.0 / (1.0 + (-logit).exp())
    }

    /// The lambda from which on views are accepted.
    pub fn least_lambda(&self) -> f64 {
        ((self.fit[0] - (ACCEPTED / (1.0 - ACCEPTED)).ln()) / self.fit[1]).exp()
    }

    /// The overlap from which on views are accepted.
    pub fn least_overlap(&self) -> f64 {
        self.overlap
    }

    /// Whether the overlap decides.
    pub fn needs_overlap(&self) -> bool {
        self.rule == Registrability::Overlap
    }

    /// Why a view is not to be taken; `None` where it may.
    pub fn objection(&self, overlap: Option<f64>, expected: &Prediction) -> Option<String> {
        match self.rule {
            Registrability::Off | Registrability::Auto => None,
            Registrability::Overlap => {
                let overlap = overlap?.max(0.0);
                (overlap < self.overlap)
                    .then(|| format!("overlap of at least {overlap:.2}, required {:.2}", self.overlap))
            }
            Registrability::Lambda => {
                let least = self.least_lambda();
                (expected.lambda < least)
                    .then(|| format!("{}, lambda {:.1}, required {least:.1}", expected.describe(), expected.lambda))
            }
        }
    }

    /// What is expected of a view that is none of those given.
    pub fn predict(&self, state: &ScanState, view: &View, frame: &Frame) -> Prediction {
        self.predict_from(state, view, &state.pose(view, None), frame)
    }

    /// What is expected of a view with its camera at this pose.
    pub fn predict_from(
        &self,
        state: &ScanState,
        view: &View,
        world_from_camera: &Isometry3<f64>,
        frame: &Frame,
    ) -> Prediction {
        let information = seen_again(state, view, world_from_camera, frame);
        let lambda = information.lambda(frame.radius);
        Prediction { lambda, failure: self.failure(lambda), weakest: information.weakest(frame) }
    }
}

impl RegistrationConfig {
    /// The robot's error, of a scan from here if that is known.
    pub fn error(&self, camera: Option<Point3<f64>>) -> PoseError {
        let about = match self.pose_error_about {
            About::Camera => camera,
            About::Object => None,
        };
        PoseError { sigma_m: self.pose_error_m, sigma_rad: self.pose_error_deg.to_radians(), about }
    }
}
