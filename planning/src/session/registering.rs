//! Scans registered onto the cloud as they come, and views from which a scan could not be.

use super::checking::Considered;
use super::placing::Cell;
use super::{Session, SessionError};
use crate::answer::{ScanRegistration, length};
use crate::constraints::{Constraint, Objection};
use crate::registration::registrability::{Demand, Prediction};
use crate::registration::{Model, Moving, Register, Registered, Registrability, register};
use crate::scan::PreparedScan;
use crate::{PastScan, RankedView, Seen, overlap};
use geometry::View;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// Share of the working distance within which a view repeats one whose scan could not be registered: some 10 degrees.
const REPEATS: f64 = 0.17;
/// Tolerances from which on a correction is worth a warning.
const WORTH_TELLING: f64 = 0.5;

impl Session {
    /// Registers a scan, where that is asked for, and moves it where it is to be moved. Answers whether it can be merged; else it
    /// waits.
    ///
    /// # Errors
    /// It is to be moved, where to is not sure, and such scans do not wait: its place is remembered until the cloud changes.
    pub(super) fn register(&mut self, scan: &mut PreparedScan) -> Result<bool, SessionError> {
        self.hold_against_cloud(scan);
        let found = scan.report.registration.as_ref().filter(|_| self.config.registration.register == Register::Refine);
        match found.and_then(|found| found.refused.clone()) {
            None => Ok(true),
            Some(_) if self.keeps_aside() => Ok(false),
            Some(why) => {
                self.unregistered.extend(scan.camera_position());
                Err(SessionError::Unregistered { why })
            }
        }
    }

    /// Where scans were taken that were rejected, in the object's frame: what no scan of the session tells, for who keeps it.
    pub fn rejected_from(&self) -> &[Point3<f64>] {
        &self.unregistered
    }

    /// Rules out views from these places, and from no other rejected scan's, until another scan is merged.
    pub fn set_rejected_from(&mut self, places: Vec<Point3<f64>>) {
        self.unregistered = places;
    }

    /// Registers a scan, where that is asked for, and moves it where that is asked for and safe.
    pub(super) fn hold_against_cloud(&self, scan: &mut PreparedScan) {
        let config = &self.config.registration;
        if config.register == Register::Off || self.state.cloud.is_empty() || scan.cloud.is_empty() {
            return;
        }
        let camera = scan.camera_position();
        let model = Model::of(&self.state, config.kind);
        let moving = Moving { cloud: &scan.cloud, footprint_m2: footprint(scan) };
        let found = register(moving, &model, &config.error(camera), config);
        if config.register == Register::Refine && found.refused.is_none() {
            scan.move_by(&found.correction);
        }
        scan.report.registration = Some(Box::new(found));
    }

    /// The view to take of these, best first: a bridge to a scan that waits, or the first that the settings take for registrable; where
    /// none is, the one that is most. The first where nothing is asked. Whether it is a bridge stands beside it.
    pub fn first_registrable<'v>(
        &self,
        views: impl Iterator<Item = &'v RankedView> + Clone,
    ) -> Option<(&'v RankedView, bool)> {
        let unregistered = self.unregistered();
        let new = || views.clone().filter(|v| !repeats(&v.view, &unregistered));
        let posed = |v: &RankedView| (v.view, self.state.pose(&v.view, v.given));
        let bridge = self.bridging().and_then(|bridging| bridging.choose(new().map(posed)));
        match bridge.and_then(|(at, _)| new().nth(at)) {
            Some(bridge) => Some((bridge, true)),
            None => self.most_registrable(new()).or_else(|| views.clone().next()).map(|v| (v, false)),
        }
    }

    fn most_registrable<'v>(&self, mut views: impl Iterator<Item = &'v RankedView>) -> Option<&'v RankedView> {
        let Some((demand, frame)) = Demand::on(&self.state, &self.config.registration) else { return views.next() };
        let usual = overlap::usual_scan(&self.state.cloud, self.scans.len());
        let mut most: Option<(f64, &RankedView)> = None;
        for ranked in views {
            let pose = self.state.pose(&ranked.view, ranked.given);
            let known = || overlap::estimate(&self.state, &ranked.view, &pose, usual);
            let least = demand.needs_overlap().then(|| ranked.overlap.unwrap_or_else(known));
            let least = least.map(|o| o - overlap::margin(self.scans.len()));
            let expected = demand.predict_from(&self.state, &ranked.view, &pose, &frame);
            if demand.objection(least, &expected).is_none() {
                return Some(ranked);
            }
            let value = least.unwrap_or(expected.lambda);
            if most.is_none_or(|(best, _)| value > best) {
                most = Some((value, ranked));
            }
        }
        most.map(|(_, ranked)| ranked)
    }

    /// What registering the scans found.
    pub(super) fn registrations(&self) -> Vec<ScanRegistration> {
        let found = self.scans.iter().filter_map(|scan| {
            let found = Registered::clone(scan.report.registration.as_ref()?);
            Some(ScanRegistration { scan: scan.number, moved: scan.moved, found })
        });
        found.collect()
    }

    /// A sentence for each scan that lies elsewhere than its pose says, or whose place is not sure.
    pub(super) fn unfit(&self) -> Vec<String> {
        let tolerance = self.config.tolerance_m;
        let tell = |ScanRegistration { scan, moved, found }: ScanRegistration| match (&found.refused, moved) {
            (Some(why), false) => Some(format!("scan {scan} was not registered: {why}")),
            _ if found.shift_m < WORTH_TELLING * tolerance => None,
            (_, false) if !found.converged => Some(format!(
                "scan {scan} could not be checked against the cloud: its registration did not converge, with {:.0} % of it on known \
                 surface",
                100.0 * found.fitness
            )),
            (_, false) => Some(format!(
                "scan {scan} fits best {} and {:.2} degrees from where its pose puts it: check the pose, or register \
                 (--register refine)",
                length(found.shift_m),
                found.turn_deg
            )),
            (_, true) => Some(format!(
                "scan {scan} was moved by {} and {:.2} degrees onto the cloud",
                length(found.shift_m),
                found.turn_deg
            )),
        };
        self.registrations().into_iter().filter_map(tell).collect()
    }
}

impl Cell<'_> {
    /// Where the rule on the overlap holds without being asked for and rules out all that is left: lifts it for the view with the
    /// largest overlap, and says so. `None` where there is no such view.
    pub(super) fn most_overlapping(&self, views: &mut [Considered]) -> Option<String> {
        let asked = self.config.registration.registrability;
        let (demand, _) = self.demand.as_ref().filter(|_| asked == Registrability::Auto)?;
        let only_rule = |c: &&mut Considered| {
            let view = View { target: c.candidate.target_m.into(), position: c.candidate.position_m.into() };
            let rule = |o: &Objection| o.constraint == Constraint::Registrability;
            c.places[0].objections.iter().all(rule) && !repeats(&view, &self.unregistered)
        };
        let overlap = |c: &Considered| c.candidate.expected_overlap.unwrap_or(0.0);
        let most = views.iter_mut().rev().filter(only_rule).max_by(|a, b| overlap(a).total_cmp(&overlap(b)))?;
        most.places[0].objections.clear();
        Some(format!(
            "no view shows as much known surface as this robot's accuracy asks for ({:.0} % of its scan, and {:.0} more since it may be \
             missed by that): the next view shows the most, {:.0} %, and its scan may not register",
            100.0 * demand.least_overlap(),
            100.0 * overlap::margin(self.scans),
            100.0 * overlap(most)
        ))
    }
}

/// Why the scan of a view could hardly be registered.
pub(super) fn unregistrable(
    view: &View,
    unregistered: &[Point3<f64>],
    overlap: Option<f64>,
    expected: Option<&Prediction>,
    demand: Option<&Demand>,
) -> Option<Objection> {
    let object = |reason| Some(Objection { constraint: Constraint::Registrability, reason });
    if repeats(view, unregistered) {
        return object("a scan from here could not be registered onto the current cloud".to_owned());
    }
    demand?.objection(overlap, expected?).and_then(object)
}

/// Whether a view is one of those whose scans could not be registered.
pub fn repeats(view: &View, unregistered: &[Point3<f64>]) -> bool {
    let near = REPEATS * (view.position - view.target).norm();
    unregistered.iter().any(|p| (p - view.position).norm() < near)
}

impl PreparedScan {
    /// Where the camera was by the pose that came with the scan, if that is known.
    pub(super) fn position_given(&self) -> Option<Point3<f64>> {
        let moved = self.report.registration.as_ref().filter(|_| self.moved);
        let position = self.camera_position()?;
        Some(moved.map_or(position, |found| found.correction.inverse() * position))
    }

    /// As it came, before it was moved onto the cloud.
    pub(super) fn unmoved(mut self) -> Self {
        if let Some(found) = self.report.registration.take_if(|_| self.moved) {
            let back = found.correction.inverse();
            self.move_by(&back);
            self.moved = false;
            self.adjusted.clear();
        }
        self
    }

    pub(super) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.moved = true;
        self.cloud = self.cloud.transformed(motion);
        self.stood_on.iter_mut().for_each(|p| *p = motion * *p);
        for past in &mut self.past {
            let mut moved = PastScan::clone(past);
            moved.world_from_camera = motion * moved.world_from_camera;
            if let Seen::Points(points) = &mut moved.seen {
                points.iter_mut().for_each(|p| *p = motion * *p);
            }
            *past = Arc::new(moved);
        }
    }
}

/// Area that a point of a scan stands for, square to the line of sight.
fn footprint(scan: &PreparedScan) -> f64 {
    let measured = scan.report.used + scan.report.thinned;
    let share = measured as f64 / scan.cloud.len().max(1) as f64;
    let mut images = scan.past.iter().filter_map(|past| match &past.seen {
        Seen::Depth { camera, .. } => Some((camera, past.world_from_camera)),
        Seen::Points(_) => None,
    });
    if let Some((camera, world_from_camera)) = images.next_back() {
        let (forward, from) = (world_from_camera * Vector3::z(), Point3::from(world_from_camera.translation.vector));
        let squared: f64 = scan.cloud.points.iter().map(|p| (p - from).dot(&forward).powi(2)).sum();
        return share * squared / scan.cloud.len().max(1) as f64 / (camera.fx * camera.fy);
    }
    let cosine = |from: Point3<f64>| {
        let each = scan.cloud.points.iter().zip(&scan.cloud.normals);
        let sum: f64 = each.map(|(p, n)| (from - p).normalize().dot(n).abs()).sum();
        sum / scan.cloud.len().max(1) as f64
    };
    scan.spacing * scan.spacing * scan.camera_position().map_or(1.0, cosine)
}

#[cfg(test)]
mod tests;
