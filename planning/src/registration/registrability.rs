//! What a scan could be registered by, predicted before it is taken: the known surface that a view would see again.

use super::{About, Frame, Icp, Information, Motion, PoseError, Registrability, RegistrationConfig};
use crate::ScanState;
use geometry::View;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Spacings of the cloud that a cell is wide in which points hide each other: hardly any cell of a seen surface is empty.
const CELL: f64 = 1.5;
/// Cells of the table at most.
const MOST_CELLS: f64 = 4e6;
/// Cosine between normal and line of sight from which on a point is seen.
const FACING: f64 = 0.1;
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

/// The surface of the cloud that a view sees: the nearest point of each cell of an image about as fine as the cloud, if
/// nothing in the cells beside it hides it. A cell counts its area at the point's depth, square to the line of sight.
pub fn seen_again(state: &ScanState, view: &View, frame: &Frame) -> Information {
    let (cloud, camera) = (&state.cloud, &state.camera);
    let mut information = Information::default();
    if !view.is_valid() || !cloud.has_normals() {
        return information;
    }
    let camera_from_world = view.world_from_camera().inverse();
    let distance = (view.position - view.target).norm();
    let image = f64::from(camera.width) / camera.fx * f64::from(camera.height) / camera.fy;
    let width = (CELL * state.grid_size / distance).max((image / MOST_CELLS).sqrt());
    // Point, cell and depth of what faces the camera in its image.
    let mut seen: Vec<(u32, [i64; 2], f64)> = Vec::new();
    let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
    for (i, (p, n)) in cloud.points.iter().zip(&cloud.normals).enumerate() {
        let to_camera = view.position - p;
        if to_camera.dot(n) <= FACING * n.norm() * to_camera.norm() {
            continue;
        }
        let local = camera_from_world * p;
        if local.z <= 0.0 {
            continue;
        }
        let pixel = camera.project(&local);
        let inside =
            (0.0..f64::from(camera.width)).contains(&pixel.x) && (0.0..f64::from(camera.height)).contains(&pixel.y);
        if inside {
            let cell = [local.x, local.y].map(|x| (x / local.z / width).floor() as i64);
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(cell[k]), high[k].max(cell[k]));
            }
            seen.push((i as u32, cell, local.z));
        }
    }
    if seen.is_empty() {
        return information;
    }
    // One cell more on each side, for the cells beside.
    let [columns, rows] = [0, 1].map(|k| (high[k] - low[k] + 3) as usize);
    let index = |cell: &[i64; 2]| (cell[1] - low[1] + 1) as usize * columns + (cell[0] - low[0] + 1) as usize;
    let mut front = vec![(f64::INFINITY, u32::MAX); columns * rows];
    for (i, cell, z) in &seen {
        let nearest = &mut front[index(cell)];
        if *z < nearest.0 {
            *nearest = (*z, *i);
        }
    }
    for (i, cell, z) in &seen {
        let at = index(cell);
        if front[at].1 != *i {
            continue;
        }
        let beside = [
            at - columns - 1,
            at - columns,
            at - columns + 1,
            at - 1,
            at + 1,
            at + columns - 1,
            at + columns,
            at + columns + 1,
        ];
        // Surface at this slant comes nearer by so much in a cell or two.
        let n = &cloud.normals[*i as usize];
        let to_camera = view.position - cloud.points[*i as usize];
        let cosine = to_camera.dot(n) / (n.norm() * to_camera.norm());
        let slack = 2.0 * width * z / cosine;
        let hiding = beside.iter().filter(|&&b| front[b].0 < z - slack).count();
        if hiding >= 4 {
            continue;
        }
        let n: Vector3<f64> = n / n.norm();
        information.add(&(cloud.points[*i as usize] - frame.center), &n, (width * z).powi(2), frame.radius);
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
}

impl Demand {
    /// Logits of failure at a lambda of 1 where the error at the surface is 0.055 and 0.22 of the object's radius, and the slope:
    /// of good and of plain ICP. From 26 objects; docs/registration.md, 'Predicting failures'.
    const FITS: [[f64; 3]; 2] = [[-0.05, 0.68, 1.5], [1.1, 2.13, 1.21]];
    /// Overlaps at which a seventh of the scans fails, with the same errors.
    const OVERLAPS: [[f64; 2]; 2] = [[0.28, 0.44], [0.38, 0.56]];
    const ERRORS: [f64; 2] = [0.055, 0.22];

    /// What the settings ask of views on this state, with the object's frame as far as it is known; `None` where they ask nothing.
    pub fn on(state: &ScanState, config: &RegistrationConfig) -> Option<(Self, Frame)> {
        let asked = config.registrability != Registrability::Off && !state.cloud.is_empty();
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
        let error = (3.0 * config.pose_error_m.powi(2) + 2.0 * turn * turn * (frame.radius.powi(2) + lever)).sqrt();
        let [small, large, slope] = Self::FITS[kind];
        let between = (error / frame.radius / Self::ERRORS[0]).ln() / (Self::ERRORS[1] / Self::ERRORS[0]).ln();
        let between = between.clamp(-0.5, 1.5);
        let at = |small: f64, large: f64| small + (large - small) * between;
        let [few, many] = Self::OVERLAPS[kind];
        Self { rule: config.registrability, fit: [at(small, large), slope], overlap: at(few, many) }
    }

    /// Probability of failure at this lambda.
    pub fn failure(&self, lambda: f64) -> f64 {
        let logit = self.fit[0] - self.fit[1] * lambda.max(1e-3).ln();
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
            Registrability::Off => None,
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

    /// What is expected of a view.
    pub fn predict(&self, state: &ScanState, view: &View, frame: &Frame) -> Prediction {
        let information = seen_again(state, view, frame);
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
