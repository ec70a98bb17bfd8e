//! Episodes whose scans have to be registered: how far off they are given, and how each was registered.

mod following;

use crate::pose_error::disturbance;
use crate::world::Shot;
use following::Merged;
use formats::config::SettingError;
use geometry::rng::stream;
use geometry::{Neighborhoods, PointCloud, View, estimate_normals, orient_normals_toward};
use nalgebra::{Isometry3, Point3};
use planning::accumulate::averaged;
use planning::registration::registrability::Demand;
use planning::registration::{
    About, AfterAlarm, Frame, Icp, Model, Moving, Register, Registrability, RegistrationConfig, Unsafe, overlap_of,
};
use planning::{Accumulate, ScanState};

/// Neighbours of a normal, as in a session.
const NORMAL_NEIGHBORS: usize = 20;

/// Settings: every scan but the first is given a pose that is off, and registered onto the cloud of those before it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeRegistration {
    /// Standard deviation per axis of the pose given, metres.
    pub sigma_t_m: f64,
    /// The same of its rotation, about the object's centre, degrees.
    pub sigma_theta_deg: f64,
    /// How ICP pairs points, `good` or `plain`.
    pub kind: Icp,
    /// Weigh the measurement against the errors above.
    pub prior: bool,
    /// Leave out scans whose place is not sure; they cost their view. Else all are merged as ICP leaves them.
    pub gate: bool,
    /// What views are held against before they are taken, whatever the policy: `off`, `overlap` or `lambda`.
    pub registrability: Registrability,
    /// What follows a scan that is left out, whatever the policy: `ignore`, or `bridge` to keep it, try it again, and take a view that
    /// connects it.
    pub after_alarm: AfterAlarm,
    /// Adjust all scans together after each that is merged, whatever the policy; with good ICP only.
    pub adjust: bool,
}

impl Default for EpisodeRegistration {
    fn default() -> Self {
        Self {
            sigma_t_m: 0.002,
            sigma_theta_deg: 0.3,
            kind: Icp::Good,
            prior: true,
            gate: true,
            registrability: Registrability::Off,
            after_alarm: AfterAlarm::Ignore,
            adjust: true,
        }
    }
}

impl EpisodeRegistration {
    /// The same for a session, whose robot knows how accurate it is.
    pub(crate) fn session(&self) -> RegistrationConfig {
        RegistrationConfig {
            register: Register::Refine,
            kind: self.kind,
            prior: self.prior,
            gate: self.gate,
            pose_error_m: self.sigma_t_m,
            pose_error_deg: self.sigma_theta_deg,
            pose_error_about: About::Object,
            registrability: self.registrability,
            after_alarm: self.after_alarm,
            adjust: self.adjust,
        }
    }

    /// Refuses values that cannot be meant.
    ///
    /// # Errors
    /// The key, what was found, and what was expected.
    pub fn validate(&self) -> Result<(), SettingError> {
        if !(self.sigma_t_m > 0.0 && self.sigma_t_m.is_finite()) {
            return Err(SettingError::new("episode.registration.sigma_t_m", self.sigma_t_m, "a length above 0"));
        }
        if !(self.sigma_theta_deg > 0.0 && self.sigma_theta_deg <= 45.0) {
            let key = "episode.registration.sigma_theta_deg";
            return Err(SettingError::new(key, self.sigma_theta_deg, "an angle above 0 and up to 45"));
        }
        Ok(())
    }
}

/// Errors of the poses given, by episode and view: the same for every policy.
pub(crate) struct Displacements {
    config: EpisodeRegistration,
    key: u64,
    scans: usize,
}

impl Displacements {
    pub fn new(config: EpisodeRegistration, key: u64) -> Self {
        Self { config, key, scans: 0 }
    }

    /// The scan that comes is the first and defines the frame.
    pub fn restart(&mut self) {
        self.scans = 0;
    }

    /// From where the next scan is to where its pose puts it.
    pub fn next(&mut self) -> Isometry3<f64> {
        let index = self.scans;
        self.scans += 1;
        match index {
            0 => Isometry3::identity(),
            _ => {
                let mut rng = stream(self.key, &format!("registration/{index}"));
                disturbance(self.config.sigma_t_m, self.config.sigma_theta_deg, &mut rng)
            }
        }
    }
}

/// The outcome of a scan.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ViewRegistration {
    /// Root mean square distance of its points, as given, from where they are, metres.
    pub given_m: f64,
    /// The same as registered; absent where the scan was not merged.
    pub left_m: Option<f64>,
    /// Whether that is more than the tolerance.
    pub failed: bool,
    /// As `left_m`, but as adjusted since with the scans that came later; absent where that did not move it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adjusted_m: Option<f64>,
    /// Whether that is more than the tolerance; absent with it, and in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adjusted_failed: Option<bool>,
    /// Why it was not merged.
    pub refused: Option<Refused>,
    /// From where it is to where it was put: as registered where it was merged, else as given.
    #[serde(default)]
    pub placed_from_true: Isometry3<f64>,
    /// Share of the scan that overlaps what was merged before with like normals, all in its true place.
    pub like_overlap: f64,
    /// Lambda of that overlap.
    pub lambda: f64,
    /// Lambda as predicted from the cloud before the scan.
    pub expected_lambda: f64,
    /// Probability that it ends off by more than the tolerance, as predicted with it.
    pub expected_failure: f64,
    /// Next views taken until it was merged, where it had to wait.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub waited: usize,
    /// Whether the view was taken to connect a scan that waits.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub bridge: bool,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl ViewRegistration {
    /// Whether the scan is merged and still off by more than the tolerance at the end of the episode; `None` where the record does not say.
    pub fn failed_in_the_end(&self) -> Option<bool> {
        match self.adjusted_m {
            Some(_) => self.adjusted_failed,
            None => Some(self.failed),
        }
    }

    /// The scan was merged after this correction of its pose, off by so much.
    fn merged(&mut self, correction: &Isometry3<f64>, left_m: f64, tolerance: f64) {
        (self.left_m, self.failed) = (Some(left_m), left_m > tolerance);
        self.placed_from_true = correction * self.placed_from_true;
    }
}

/// Why a scan was not merged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refused {
    /// It shows nothing.
    Empty,
    /// Too little overlap for ICP.
    TooFewPairs,
    /// ICP went farther than the robot can be off.
    TooFar,
    /// The overlap leaves too much doubt.
    Uncertain,
}

impl From<&Unsafe> for Refused {
    fn from(why: &Unsafe) -> Self {
        match why {
            Unsafe::TooFewPairs { .. } => Self::TooFewPairs,
            Unsafe::TooFar { .. } => Self::TooFar,
            Unsafe::Uncertain { .. } => Self::Uncertain,
        }
    }
}

/// The outcomes of an episode's scans.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RegistrationOutcome {
    /// One per next view.
    pub views: Vec<ViewRegistration>,
    /// Root mean square distance of all merged points from where they are, metres.
    pub left_m: f64,
    /// Share of them that are off by more than the tolerance.
    pub off_share: f64,
}

/// The scans in their true places, beside the session that does not know them.
#[derive(Default)]
pub(crate) struct Placed {
    /// What was merged, in its true place.
    truth: PointCloud,
    /// What was merged and is off by less than the tolerance, where it was merged.
    pub sound: PointCloud,
    squared: f64,
    off: usize,
    points: usize,
    views: Vec<ViewRegistration>,
    next: PointCloud,
    waiting: Vec<Waiting>,
    /// What was merged, in that order.
    scans: Vec<Merged>,
}

/// A scan that was left out, and may be merged later.
struct Waiting {
    /// Its number in the session, and its next view from 0.
    number: usize,
    view: usize,
    /// Its points as given, and in their true places.
    given: Vec<Point3<f64>>,
    truth: PointCloud,
}

impl Placed {
    /// A next view's scan before it is added: what there is to register it by, and what the planner could know of that. Answers
    /// with its overlap.
    pub fn look(&mut self, view: &View, shot: &Shot, state: &ScanState, config: &RegistrationConfig) -> Option<f64> {
        let frame = Frame::around(&[&state.cloud]);
        let expected = Demand::new(config, &frame, state.working_distance).predict(state, view, &frame);
        let points = shot.true_points();
        self.next = PointCloud {
            normals: estimate_normals(&points, &Neighborhoods::of(&points, NORMAL_NEIGHBORS), NORMAL_NEIGHBORS),
            points,
        };
        let camera = Point3::from(shot.actual.translation.vector);
        orient_normals_toward(&mut self.next, &camera);
        let depth = (camera - frame.center).norm();
        let moving =
            Moving { cloud: &self.next, footprint_m2: depth * depth / (shot.camera.fx * shot.camera.fy).max(1.0) };
        let model = Model::new(&self.truth, vec![false; self.truth.len()], state.grid_size, state.tolerance);
        let found = overlap_of(&moving, &model);
        let squared: f64 = shot.points.iter().zip(&self.next.points).map(|(a, b)| (a - b).norm_squared()).sum();
        self.views.push(ViewRegistration {
            given_m: (squared / shot.points.len().max(1) as f64).sqrt(),
            left_m: None,
            adjusted_m: None,
            adjusted_failed: None,
            failed: false,
            refused: shot.points.is_empty().then_some(Refused::Empty),
            placed_from_true: shot.world_from_camera * shot.actual.inverse(),
            like_overlap: found.like_normals,
            lambda: found.lambda,
            expected_lambda: expected.lambda,
            expected_failure: expected.failure,
            waited: 0,
            bridge: false,
        });
        (!shot.points.is_empty()).then_some(found.share)
    }

    /// The first scan: in its true place.
    pub fn begin(&mut self, points: Vec<Point3<f64>>, camera: &Point3<f64>, grid_size: f64) {
        *self = Self::default();
        self.next = PointCloud {
            normals: estimate_normals(&points, &Neighborhoods::of(&points, NORMAL_NEIGHBORS), NORMAL_NEIGHBORS),
            points,
        };
        orient_normals_toward(&mut self.next, camera);
        let points = self.next.points.clone();
        let truth = points.clone();
        self.merge(&points, grid_size, f64::INFINITY);
        self.scans.push(Merged { number: 1, view: None, given: points, truth, correction: Isometry3::identity() });
    }

    /// The scan that was looked at is merged, its points as given corrected so. Answers with where they are then.
    pub fn add(
        &mut self,
        number: usize,
        given: &[Point3<f64>],
        correction: &Isometry3<f64>,
        grid_size: f64,
        tolerance: f64,
    ) -> Vec<Point3<f64>> {
        let view = self.views.len().checked_sub(1);
        let truth = self.next.points.clone();
        self.scans.push(Merged { number, view, given: given.to_vec(), truth, correction: *correction });
        let registered: Vec<_> = given.iter().map(|p| correction * p).collect();
        let before = self.squared;
        let count = registered.len();
        self.merge(&registered, grid_size, tolerance);
        if let Some(view) = self.views.last_mut() {
            view.merged(correction, ((self.squared - before) / count.max(1) as f64).sqrt(), tolerance);
        }
        registered
    }

    /// The scan that was looked at is left out; `given` are its points, if it waits, under this number.
    pub fn refuse(&mut self, why: &Unsafe, waits: Option<(usize, Vec<Point3<f64>>)>) {
        if let Some(view) = self.views.last_mut() {
            view.refused = Some(why.into());
        }
        let view = self.views.len().saturating_sub(1);
        let truth = std::mem::take(&mut self.next);
        self.waiting.extend(waits.map(|(number, given)| Waiting { number, view, given, truth }));
    }

    /// Merges those that waited and were registered by now, as `correction` of their number says.
    pub fn take_in(&mut self, correction: impl Fn(usize) -> Option<Isometry3<f64>>, grid_size: f64, tolerance: f64) {
        for scan in std::mem::take(&mut self.waiting) {
            let Some(correction) = correction(scan.number) else {
                self.waiting.push(scan);
                continue;
            };
            let before = self.squared;
            let registered: Vec<_> = scan.given.iter().map(|p| correction * p).collect();
            let count = registered.len();
            self.next = scan.truth;
            let truth = self.next.points.clone();
            let (number, view) = (scan.number, Some(scan.view));
            self.scans.push(Merged { number, view, given: scan.given, truth, correction });
            self.merge(&registered, grid_size, tolerance);
            let left = ((self.squared - before) / count.max(1) as f64).sqrt();
            let waited = self.views.len() - 1 - scan.view;
            let view = &mut self.views[scan.view];
            (view.refused, view.waited) = (None, waited);
            view.merged(&correction, left, tolerance);
        }
    }

    /// The view that was looked at connects a scan that waits.
    pub fn bridges(&mut self) {
        self.views.last_mut().into_iter().for_each(|view| view.bridge = true);
    }

    fn merge(&mut self, registered: &[Point3<f64>], grid_size: f64, tolerance: f64) {
        let next = std::mem::take(&mut self.next);
        let mut sound = PointCloud::default();
        for (p, truth) in registered.iter().zip(&next.points) {
            let squared = (p - truth).norm_squared();
            self.squared += squared;
            self.points += 1;
            match squared < tolerance * tolerance {
                true => sound.points.push(*p),
                false => self.off += 1,
            }
        }
        let origin = Accumulate::Averaged.voxel_origin();
        self.sound = averaged(&self.sound, &sound, grid_size, origin);
        self.truth = averaged(&self.truth, &next, grid_size, origin);
    }

    /// The outcomes so far.
    pub fn outcome(&self) -> RegistrationOutcome {
        let points = self.points.max(1) as f64;
        RegistrationOutcome {
            views: self.views.clone(),
            left_m: (self.squared / points).sqrt(),
            off_share: self.off as f64 / points,
        }
    }
}

#[cfg(test)]
mod tests;
