//! The view that comes first after a scan could not be registered: one that is itself sure to be, and sees what is to hold that scan.

use super::Session;
use crate::RankedView;
use crate::answer::Candidate;
use crate::registration::registrability::{Demand, seen_again};
use crate::registration::visible::visible;
use crate::registration::{Frame, Information};
use crate::scan::PreparedScan;
use geometry::{NeighborGrid, PointCloud, View};
use nalgebra::{Isometry3, Point3, Vector3};

/// Largest probability of failure of a view that is to mend another.
const SURE: f64 = 0.05;
/// Where on the way from the nearest camera to that of the scan views are looked for beside the planner's.
const BETWEEN: [f64; 3] = [0.25, 0.5, 0.75];

/// A scan that waits, and what is to hold it.
struct Span {
    number: usize,
    /// What it sees of the cloud.
    held: Information,
    /// What it sees beyond the cloud.
    beyond: PointCloud,
    spacing: f64,
}

/// What views are held against after an alarm.
pub(super) struct Bridging<'a> {
    session: &'a Session,
    demand: Demand,
    frame: Frame,
    spans: Vec<Span>,
}

impl Session {
    /// Views between the camera of a scan that waits and the nearest of those merged; none where none waits.
    pub fn between(&self) -> Vec<RankedView> {
        let cameras: Vec<Point3<f64>> = self.scans.iter().filter_map(PreparedScan::camera_position).collect();
        let target = Frame::around(&[&self.state.cloud]).center;
        let direction = |p: &Point3<f64>| (p - target).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let mut views = Vec::new();
        for to in self.alarms().filter_map(PreparedScan::camera_position) {
            let to = direction(&to);
            let near = cameras.iter().map(direction).max_by(|a, b| a.dot(&to).total_cmp(&b.dot(&to)));
            let Some(from) = near.filter(|_| self.state.given_views.is_empty()) else { continue };
            views.extend(BETWEEN.iter().map(|share| {
                let way = from.slerp(&to, *share);
                RankedView::scored(View { target, position: target + way * self.state.working_distance }, 0.0)
            }));
        }
        views
    }

    /// Marks the candidate to take first after an alarm.
    pub(super) fn mark_bridge(&self, candidates: &mut [Candidate]) {
        let Some(bridging) = self.bridging() else { return };
        candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
        let open = |c: &&Candidate| c.objections.is_empty();
        let views = candidates.iter().filter(open).map(|c| (c.view(), self.camera_at(c)));
        let Some((at, scan)) = bridging.choose(views) else { return };
        if let Some(bridge) = candidates.iter_mut().filter(|c| c.objections.is_empty()).nth(at) {
            bridge.bridges_to = Some(scan);
        }
    }

    /// What a bridge is judged by; `None` where no scan waits.
    pub(super) fn bridging(&self) -> Option<Bridging<'_>> {
        self.alarms().next()?;
        let frame = Frame::around(&[&self.state.cloud]);
        let config = &self.config.registration;
        let demand = Demand::new(config, &frame, self.state.working_distance);
        let off = demand.error_m.max(self.state.tolerance);
        let grid = NeighborGrid::new(&self.state.cloud.points, off);
        let spans = self.alarms().filter_map(|scan| {
            let pose = scan.past.first()?.world_from_camera;
            let position = Point3::from(pose.translation.vector);
            let ahead = pose * Vector3::z();
            let view = View { target: position + ahead * self.state.working_distance, position };
            let known = |p: &Point3<f64>| grid.any_within(p, off);
            let open = (0..scan.cloud.len()).filter(|&i| !known(&scan.cloud.points[i]));
            let (points, normals) = open.map(|i| (scan.cloud.points[i], scan.cloud.normals[i])).unzip();
            let held = seen_again(&self.state, &view, &self.state.pose(&view, None), &frame);
            Some(Span { number: scan.number, held, beyond: PointCloud { points, normals }, spacing: scan.spacing })
        });
        Some(Bridging { session: self, demand, frame, spans: spans.collect() })
    }
}

impl Bridging<'_> {
    /// Of these views with the poses of their cameras, best first, the one to take, with the number of the scan that it is for: the
    /// first that holds that scan, or else the one that helps it most. `None` where none is sure to be registered itself, or none helps.
    pub fn choose(&self, views: impl Iterator<Item = (View, Isometry3<f64>)>) -> Option<(usize, usize)> {
        let mut most: Option<(f64, usize, usize)> = None;
        for (i, (view, pose)) in views.enumerate() {
            let Some((number, before, after)) = self.value(&view, &pose) else { continue };
            if after >= self.demand.least_lambda() {
                return Some((i, number));
            }
            if after > before && most.is_none_or(|(best, _, _)| after > best) {
                most = Some((after, i, number));
            }
        }
        most.map(|(_, i, number)| (i, number))
    }

    /// The scan that a view holds best, and its lambda without and with it; `None` for a view that may itself not be registered.
    fn value(&self, view: &View, pose: &Isometry3<f64>) -> Option<(usize, f64, f64)> {
        let state = &self.session.state;
        let own = self.demand.predict_from(state, view, pose, &self.frame);
        if own.failure > SURE {
            return None;
        }
        let after = |span: &Span| {
            let mut held = span.held.clone();
            for (i, area) in visible(&span.beyond, span.spacing, state, view, pose) {
                let (p, n) = (&span.beyond.points[i], &span.beyond.normals[i]);
                held.add(&(p - self.frame.center), &n.normalize(), area, self.frame.radius);
            }
            (span.number, span.held.lambda(self.frame.radius), held.lambda(self.frame.radius))
        };
        self.spans.iter().map(after).max_by(|a, b| a.2.total_cmp(&b.2))
    }
}
