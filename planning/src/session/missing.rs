//! What is missing of the surface, and which of it the camera may see.

use super::Session;
use super::placing::Cell;
use crate::answer::{Answer, Candidate};
use crate::config::PlannerName;
use crate::constraints::ConstraintsConfig;
use crate::stop::Missing;
use crate::{Allowed, ExpectedPoint, Surface};
use geometry::View;
use nalgebra::{Isometry3, Point3, Vector3};

/// Surface met at less than this cosine counts as if it were met at it.
const GRAZING: f64 = 0.1;

impl Session {
    /// Points of the surface that was expected where nothing is known, when this answer was given; none where its planner does
    /// not make that out or had no time to. World frame, about a voxel apart.
    pub fn expected_surface(&self, answer: &Answer) -> Vec<ExpectedPoint> {
        let volumetric = answer.complete && answer.planner == PlannerName::Volumetric.as_str();
        if volumetric { self.planners.expected_surface(PlannerName::Volumetric) } else { Vec::new() }
    }

    /// What the planner that has just answered finds missing, and the surface with it; `None` where it does not make that out. Also where
    /// one look shows that it is too little: then the candidates have no gain either, and the reason is given.
    pub(super) fn missing(
        &self,
        planner: PlannerName,
        candidates: &mut [Candidate],
        cell: Cell,
    ) -> (Option<(Missing, Surface)>, Option<String>) {
        let found = self.made_out(planner, candidates, cell);
        let doubt =
            found.as_ref().and_then(|(missing, _)| Some(Self::too_little(self.underestimated(missing)?, missing)));
        if doubt.is_some() {
            candidates.iter_mut().for_each(|c| c.expected_gain = None);
        }
        (found.filter(|_| doubt.is_none()), doubt)
    }

    fn made_out(&self, planner: PlannerName, candidates: &[Candidate], mut cell: Cell) -> Option<(Missing, Surface)> {
        let surface = self.planners.surface(planner)?;
        let allowed: Vec<(usize, Isometry3<f64>)> =
            candidates.iter().filter(|c| c.objections.is_empty()).map(|c| (c.rank, self.camera_at(c))).collect();
        // Where the camera may go in the end, not with the next move.
        cell.limits = ConstraintsConfig { max_travel_m: None, visited_radius_m: None, ..cell.limits };
        // Thousands of views: an arm is asked about the candidates alone.
        cell.arm = None;
        let others = |view: &View| cell.places(view, None, None).iter().any(|p| p.objections.is_empty());
        let any_other = self.given_views.is_empty();
        let allowed = Allowed { candidates: &allowed, others: any_other.then_some(&others) };
        Some(Missing::of(self.planners.holes(planner, &self.state, &allowed), &surface))
    }

    /// The least share that is missing, where that is more than `missing` allows.
    fn underestimated(&self, missing: &Missing) -> Option<f64> {
        let [scan] = &self.scans[..] else { return None };
        // A line scanner looks from many places, and a table closes what stands on it.
        if scan.past.len() != 1 || self.state.support.is_some() {
            return None;
        }
        let (eye, cloud) = (scan.camera_position()?, &self.state.cloud);
        let open = open_share(&cloud.points, &cloud.normals, &eye);
        (open > missing.between[1] + missing.out_of_reach_share).then_some(open)
    }

    /// What is said of it.
    fn too_little(open: f64, missing: &Missing) -> String {
        format!(
            "at least {:.0} % of the surface is missing, since what the scan shows does not close, and the planner makes out {:.0} % at most: \
             gains are not predicted from this scan alone; take another",
            100.0 * open,
            100.0 * (missing.between[1] + missing.out_of_reach_share)
        )
    }
}

/// Least share of a closed surface that one look has not measured. The outward area vectors of a closed surface sum to zero, so that
/// what is left has at least the area of the sum of those measured. Points are taken to be as many per pixel; where they are as many per area
/// the share is smaller.
fn open_share(points: &[Point3<f64>], normals: &[Vector3<f64>], eye: &Point3<f64>) -> f64 {
    let (mut sum, mut area) = (Vector3::zeros(), 0.0);
    for (p, n) in points.iter().zip(normals) {
        let (ray, Some(normal)) = (eye - p, n.try_normalize(0.0)) else { continue };
        let cosine = normal.dot(&ray) / ray.norm();
        let patch = ray.norm_squared() / cosine.abs().max(GRAZING);
        sum += patch * normal;
        area += patch;
    }
    sum.norm() / (sum.norm() + area).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests;
