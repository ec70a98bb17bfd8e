//! What a real cell allows: constraints that rule views out, and the cost of travel.

use crate::config::ConfigError;
use crate::{RankedView, SensorConfig};
use geometry::View;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A box with edges along the axes: smallest and largest corner, metres.
pub type Box3 = [[f64; 3]; 2];

/// Where no clearance is set.
const CLEARANCE_M: f64 = 0.05;

/// Limits on the camera, each off by default but the clearance. In the cell (`visited_m`: the object's frame), metres, degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ConstraintsConfig {
    /// The direction that is up: for the floor, the tilt and upright images.
    pub up: [f64; 3],
    /// The camera must be inside this box.
    pub workspace_m: Option<Box3>,
    /// The camera must be above the plane at this height along `up`.
    pub floor_height_m: Option<f64>,
    /// The camera must be outside each of these boxes.
    pub keep_out_m: Vec<Box3>,
    /// Smallest tilt: how far the camera looks down; 0 is level, 90 straight down, negative upwards.
    pub min_tilt_deg: Option<f64>,
    /// Largest tilt.
    pub max_tilt_deg: Option<f64>,
    /// Where the camera is now; without it, where the last scan was taken from.
    pub current_position_m: Option<[f64; 3]>,
    /// Farthest from the current position, in a straight line.
    pub max_travel_m: Option<f64>,
    /// Taken off a view's score for each metre from the current position.
    pub travel_weight_per_m: f64,
    /// Least share of the next scan that must be surface already seen, for registration; 0 asks for none.
    pub min_overlap: f64,
    /// Positions done already, besides those of the scans.
    pub visited_m: Vec<[f64; 3]>,
    /// A camera this near to a position done already is a repetition.
    pub visited_radius_m: Option<f64>,
    /// Least distance from the camera to any measured point; the camera must not be inside the measured surface either.
    /// Absent: 0.05, and a quarter of the working distance at most; 0 asks for none.
    pub clearance_m: Option<f64>,
}

impl Default for ConstraintsConfig {
    fn default() -> Self {
        Self {
            up: [0.0, 0.0, 1.0],
            workspace_m: None,
            floor_height_m: None,
            keep_out_m: Vec::new(),
            min_tilt_deg: None,
            max_tilt_deg: None,
            current_position_m: None,
            max_travel_m: None,
            travel_weight_per_m: 0.0,
            min_overlap: 0.0,
            visited_m: Vec::new(),
            visited_radius_m: None,
            clearance_m: None,
        }
    }
}

impl ConstraintsConfig {
    /// The up direction, of unit length (checked by [`Self::check`]).
    pub fn up(&self) -> Vector3<f64> {
        Vector3::from(self.up).try_normalize(0.0).unwrap_or_else(Vector3::z)
    }

    /// Refuses values without a meaning.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |key, found: String, expected| Err(ConfigError { key, found, expected });
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
        if !finite(&self.up) || Vector3::from(self.up).norm() < 1e-9 {
            return wrong("constraints.up", format!("{:?}", self.up), "a direction that is not zero");
        }
        let boxes = self.workspace_m.iter().map(|b| ("constraints.workspace_m", b));
        for (key, corners) in boxes.chain(self.keep_out_m.iter().map(|b| ("constraints.keep_out_m", b))) {
            if !finite(corners.as_flattened()) || (0..3).any(|i| corners[0][i] > corners[1][i]) {
                return wrong(key, format!("{corners:?}"), "[[smallest x, y, z], [largest x, y, z]]");
            }
        }
        for (key, value) in [
            ("constraints.floor_height_m", self.floor_height_m),
            ("constraints.min_tilt_deg", self.min_tilt_deg),
            ("constraints.max_tilt_deg", self.max_tilt_deg),
        ] {
            if value.is_some_and(|x| !x.is_finite()) {
                return wrong(key, format!("{value:?}"), "a finite number");
            }
        }
        for (key, value) in [
            ("constraints.max_travel_m", self.max_travel_m),
            ("constraints.visited_radius_m", self.visited_radius_m),
            ("constraints.clearance_m", self.clearance_m),
            ("constraints.travel_weight_per_m", Some(self.travel_weight_per_m)),
        ] {
            if value.is_some_and(|x| !(x.is_finite() && x >= 0.0)) {
                return wrong(key, format!("{value:?}"), "zero or a positive number");
            }
        }
        if !(0.0..=1.0).contains(&self.min_overlap) {
            return wrong("constraints.min_overlap", self.min_overlap.to_string(), "a share from 0 to 1");
        }
        if self.keep_out_m.len() > 1_000 {
            return wrong("constraints.keep_out_m", format!("{} boxes", self.keep_out_m.len()), "at most 1,000");
        }
        if self.visited_m.len() > 10_000 {
            return wrong("constraints.visited_m", format!("{} positions", self.visited_m.len()), "at most 10,000");
        }
        let positions = self.current_position_m.iter().chain(&self.visited_m);
        for position in positions {
            if !finite(position) {
                return wrong("constraints: position", format!("{position:?}"), "finite coordinates");
            }
        }
        Ok(())
    }

    /// Whether a limit or cost needs to know where the camera is now.
    pub fn needs_current_position(&self) -> bool {
        self.max_travel_m.is_some() || self.travel_weight_per_m > 0.0
    }

    /// Every constraint that rules the view out, each with what was found and allowed; empty if it may be taken. `overlap` is the
    /// least that can be expected.
    pub fn objections(&self, view: &View, overlap: Option<f64>, known: &Surroundings) -> Vec<Objection> {
        self.objections_in_cell(view, view, overlap, known)
    }

    /// [`ConstraintsConfig::objections`] where the object is turned: `in_cell` is the view where the camera stands, `view` where it stands
    /// as the object sees it.
    pub fn objections_in_cell(
        &self,
        view: &View,
        in_cell: &View,
        overlap: Option<f64>,
        known: &Surroundings,
    ) -> Vec<Objection> {
        let camera = &in_cell.position;
        let up = self.up();
        let mut objections = Vec::new();
        let mut object = |constraint, reason| objections.push(Objection { constraint, reason });
        if let Some(workspace) = self.workspace_m.filter(|b| !contains(b, camera)) {
            object(Constraint::Workspace, format!("camera {} is outside {}", show(camera), show_box(&workspace)));
        }
        if let Some(floor) = self.floor_height_m {
            let height = camera.coords.dot(&up);
            if height <= floor {
                object(Constraint::Floor, format!("camera at height {height:.3} m, floor at {floor:.3} m"));
            }
        }
        if let Some(keep_out) = self.keep_out_m.iter().find(|b| contains(b, camera)) {
            object(Constraint::KeepOut, format!("camera {} is inside {}", show(camera), show_box(keep_out)));
        }
        let tilt = in_cell.direction().dot(&up).clamp(-1.0, 1.0).asin().to_degrees();
        if self.min_tilt_deg.is_some_and(|least| tilt < least) || self.max_tilt_deg.is_some_and(|most| tilt > most) {
            let limit = |bound: Option<f64>| bound.map_or("any".to_owned(), |x| format!("{x:.0}"));
            let (least, most) = (limit(self.min_tilt_deg), limit(self.max_tilt_deg));
            object(Constraint::Tilt, format!("looks down by {tilt:.0} degrees, allowed {least} to {most}"));
        }
        if let (Some(most), Some(current)) = (self.max_travel_m, known.current) {
            let travel = (camera - current).norm();
            if travel > most {
                object(Constraint::Travel, format!("{travel:.3} m from the current position, allowed {most:.3} m"));
            }
        }
        if let Some(overlap) = overlap.filter(|o| self.min_overlap > 0.0 && *o < self.min_overlap) {
            let overlap = overlap.max(0.0);
            object(Constraint::Overlap, format!("overlap of at least {overlap:.2}, required {:.2}", self.min_overlap));
        }
        if let Some(radius) = self.visited_radius_m {
            let nearest = known.visited.iter().map(|p| (p - view.position).norm()).fold(f64::INFINITY, f64::min);
            if nearest < radius {
                object(Constraint::Visited, format!("{nearest:.3} m from a visited position"));
            }
        }
        let clearance = self.clearance(view);
        if clearance > 0.0 && known.may_touch(&view.position, clearance) {
            let (distance, winding) = known.near(&view.position);
            if distance < clearance {
                object(Constraint::Clearance, format!("{distance:.3} m from the measured surface"));
            } else if winding > 0.5 {
                object(Constraint::Clearance, "inside the measured surface".to_owned());
            }
        }
        objections
    }

    /// How far from what was measured a view's camera must be, metres.
    pub fn clearance(&self, view: &View) -> f64 {
        self.clearance_m.unwrap_or_else(|| CLEARANCE_M.min(0.25 * (view.position - view.target).norm()))
    }

    /// What travel takes off the view's score.
    pub fn travel_cost(&self, view: &View, known: &Surroundings) -> f64 {
        known.current.map_or(0.0, |current| self.travel_weight_per_m * (view.position - current).norm())
    }
}

/// What the constraints are held against.
#[derive(Clone, Debug, Default)]
pub struct Surroundings<'a> {
    /// The measured points.
    pub points: &'a [Point3<f64>],
    /// Their normals towards the outside, any length; empty if unknown.
    pub normals: &'a [Vector3<f64>],
    /// Mean distance of neighbouring points.
    pub spacing: f64,
    /// The box around the points.
    pub bounds: [Point3<f64>; 2],
    /// Where the camera is now, in the cell.
    pub current: Option<Point3<f64>>,
    /// Positions done already.
    pub visited: Vec<Point3<f64>>,
}

impl Surroundings<'_> {
    /// Whether `q` is in the box around the points or within this distance of it.
    fn may_touch(&self, q: &Point3<f64>, distance: f64) -> bool {
        let [low, high] = self.bounds;
        (0..3).all(|k| q[k] >= low[k] - distance && q[k] <= high[k] + distance)
    }

    /// Distance from `q` to the nearest point, and the winding number of the measured surface around `q`
    /// (Barill et al. 2018, equation 3, with an area of spacing squared per point): 1 inside a closed
    /// surface, 0 outside.
    fn near(&self, q: &Point3<f64>) -> (f64, f64) {
        let nearest = self.points.iter().map(|p| (p - q).norm_squared()).fold(f64::INFINITY, f64::min).sqrt();
        let area = self.spacing * self.spacing;
        let winding: f64 = self
            .points
            .iter()
            .zip(self.normals)
            .map(|(p, n)| {
                let d = p - q;
                let n = n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
                area * d.dot(&n) / d.norm().powi(3).max(1e-30)
            })
            .sum();
        (nearest, winding / (4.0 * std::f64::consts::PI))
    }
}

/// A kind of constraint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Constraint {
    /// Outside the workspace box.
    Workspace,
    /// Below the floor.
    Floor,
    /// Inside a keep-out box.
    KeepOut,
    /// Tilted too far.
    Tilt,
    /// Too far from the current position.
    Travel,
    /// Too little overlap expected.
    Overlap,
    /// Done already.
    Visited,
    /// In or too near the measured surface.
    Clearance,
    /// Its scan could hardly be registered.
    Registrability,
    /// The sensor would measure nothing from there.
    Sensor,
    /// Under what the object stands on.
    Support,
    /// The arm does not get there.
    Reach,
    /// It would touch something.
    Collision,
    /// The caller's own check says no.
    Caller,
}

impl Constraint {
    /// The setting to change.
    pub fn setting(self) -> &'static str {
        match self {
            Self::Workspace => "workspace_m",
            Self::Floor => "floor_height_m",
            Self::KeepOut => "keep_out_m",
            Self::Tilt => "min_tilt_deg / max_tilt_deg",
            Self::Travel => "max_travel_m",
            Self::Overlap => "min_overlap",
            Self::Visited => "visited_radius_m",
            Self::Clearance => "clearance_m",
            Self::Registrability => "registration.registrability",
            Self::Sensor => "sensor (range, incidence)",
            Self::Support => "support",
            Self::Reach => "robot (reach, joint limits)",
            Self::Collision => "robot (collision)",
            Self::Caller => "the caller's own check",
        }
    }
}

/// A constraint that rules a view out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Objection {
    /// Which.
    pub constraint: Constraint,
    /// What was found and what is allowed.
    pub reason: String,
}

impl Objection {
    /// A view from which the sensor measures nothing; `None` where it may measure something. What is expected to be seen, where
    /// that is predicted, decides; else the distance to what the view looks at.
    pub(crate) fn of_sensor(sensor: &SensorConfig, ranked: &RankedView, predicted: bool) -> Option<Self> {
        let [near, far] = sensor.range();
        let distance = (ranked.view.position - ranked.view.target).norm();
        // A bridging view is none of the planner's.
        let reason = match predicted && ranked.gain.is_some() {
            _ if !sensor.is_limited() => return None,
            true if ranked.overlap.is_none() && ranked.gain.is_some_and(|gain| gain <= 0.0) => {
                "no surface in its image within the sensor's range and angles".to_owned()
            }
            false if !sensor.reaches(distance) => {
                format!("{distance:.3} m from its target, but the sensor measures from {near:.3} to {far:.3} m")
            }
            _ => return None,
        };
        Some(Self { constraint: Constraint::Sensor, reason })
    }

    /// A pose that the caller's own check refuses.
    pub(crate) fn of_caller(reason: String) -> Self {
        Self { constraint: Constraint::Caller, reason }
    }

    /// A given view from which a scan was taken.
    pub(crate) fn scanned() -> Self {
        Self { constraint: Constraint::Visited, reason: "scanned from here already".to_owned() }
    }
}

/// How many candidates one constraint rules out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exclusion {
    /// Which.
    pub constraint: Constraint,
    /// Candidates it objects to.
    pub candidates: usize,
    /// Those that nothing else objects to: they come back when this constraint is lifted.
    pub alone: usize,
}

/// Counts objections by constraint, in the order of [`Constraint`].
pub fn count_exclusions<'a>(candidates: impl IntoIterator<Item = &'a [Objection]>) -> Vec<Exclusion> {
    let mut counts = std::collections::BTreeMap::<Constraint, (usize, usize)>::new();
    for objections in candidates {
        for objection in objections {
            let count = counts.entry(objection.constraint).or_default();
            count.0 += 1;
            count.1 += usize::from(objections.len() == 1);
        }
    }
    counts.into_iter().map(|(constraint, (candidates, alone))| Exclusion { constraint, candidates, alone }).collect()
}

fn contains(corners: &Box3, p: &Point3<f64>) -> bool {
    (0..3).all(|i| corners[0][i] <= p[i] && p[i] <= corners[1][i])
}

/// A point, for people.
pub(crate) fn show(p: &Point3<f64>) -> String {
    format!("({:.3}, {:.3}, {:.3})", p.x, p.y, p.z)
}

/// A box, for people.
pub(crate) fn show_box(corners: &Box3) -> String {
    format!("{} .. {}", show(&corners[0].into()), show(&corners[1].into()))
}

#[cfg(test)]
mod tests;
