//! What is missing of the surface, and which of it the camera may see.

use super::Session;
use super::placing::Cell;
use crate::answer::{Answer, Candidate};
use crate::config::PlannerName;
use crate::constraints::ConstraintsConfig;
use crate::stop::Missing;
use crate::{Allowed, ExpectedPoint, Surface};
use geometry::View;
use nalgebra::Isometry3;

impl Session {
    /// Points of the surface that was expected where nothing is known, when this answer was given; none where its planner does
    /// not make that out. World frame, about a voxel apart.
    pub fn expected_surface(&self, answer: &Answer) -> Vec<ExpectedPoint> {
        let volumetric = answer.planner == PlannerName::Volumetric.as_str();
        if volumetric { self.planners.expected_surface(PlannerName::Volumetric) } else { Vec::new() }
    }

    /// What the planner that has just answered finds missing, and the surface with it; `None` where it does not make that out.
    pub(super) fn missing(
        &self,
        planner: PlannerName,
        candidates: &[Candidate],
        mut cell: Cell,
    ) -> Option<(Missing, Surface)> {
        let surface = self.planners.surface(planner)?;
        let pose = |c: &Candidate| match c.given {
            Some(i) => self.given_views[i],
            None => View { target: c.target_m.into(), position: c.position_m.into() }.world_from_camera(),
        };
        let allowed: Vec<(usize, Isometry3<f64>)> =
            candidates.iter().filter(|c| c.objections.is_empty()).map(|c| (c.rank, pose(c))).collect();
        // Where the camera may go in the end, not with the next move.
        cell.limits = ConstraintsConfig { max_travel_m: None, visited_radius_m: None, ..cell.limits };
        // Thousands of views: an arm is asked about the candidates alone.
        cell.arm = None;
        let others =
            |view: &View| cell.places(view, &cell.pose(view, None), None, None).iter().any(|p| p.objections.is_empty());
        let any_other = self.given_views.is_empty();
        let allowed = Allowed { candidates: &allowed, others: any_other.then_some(&others) };
        Some(Missing::of(self.planners.holes(planner, &self.state, &allowed), &surface))
    }
}
