//! What a planner says of a session's state, asked once for all requests.

use super::{Session, SessionError, decline};
use crate::config::{PlannerName, RankBy, SessionConfig};
use crate::planners::auto::AutoPlanner;
use crate::{PlanError, RankedView, ScanState};
use geometry::{BoundaryConfig, boundary_points, rng};

/// The views of a planner, best first for each working distance, and the boundary points of the cloud.
#[derive(Clone, Debug)]
pub(super) struct Ranking {
    pub(super) views: Vec<(RankedView, f64)>,
    pub(super) boundary: usize,
    /// Share of the cloud that the last scan alone measured, and the last two.
    pub(super) lately_added: [Option<f64>; 2],
    /// Whether time sufficed for all of them.
    pub(super) complete: bool,
}

impl Session {
    /// What the planner says of the state as it is.
    pub(super) fn ranked(&mut self, planner: PlannerName) -> Result<Ranking, SessionError> {
        if let Some(known) = self.ranking.take() {
            return Ok(known);
        }
        self.state.roll = self.roll();
        let mut ranking = rank(&mut self.planners, &mut self.state, &self.config, self.scans.len(), planner)?;
        let least = ranking.views.iter().map(|(v, _)| v.score).fold(f64::INFINITY, f64::min);
        let score = if least.is_finite() { least } else { 0.0 };
        let distance = self.state.working_distance;
        ranking.lately_added = decline::lately_added(&self.scans, &self.state);
        ranking.views.extend(self.between().into_iter().map(|v| (RankedView { score, ..v }, distance)));
        Ok(ranking)
    }
}

/// Asks a planner at every working distance.
///
/// # Errors
/// A planner that fails, has no view though the surface is open, or is stopped.
fn rank(
    planners: &mut AutoPlanner,
    state: &mut ScanState,
    config: &SessionConfig,
    num_scans: usize,
    planner: PlannerName,
) -> Result<Ranking, SessionError> {
    let mut views: Vec<(RankedView, f64)> = Vec::new();
    let mut distances = config.working_distances();
    if !state.given_views.is_empty() {
        distances.truncate(1);
    }
    for distance in distances {
        if state.budget.is_spent() {
            state.budget.allows(!views.is_empty())?;
            break;
        }
        // One stream for all distances: the candidates differ by the distance alone.
        let mut rng = rng::stream(config.seed, &format!("infer/view/{num_scans}"));
        state.working_distance = distance;
        match planners.rank(planner, state, &mut rng) {
            Ok(ranked) => views.extend(ranked.into_iter().map(|view| (view, distance))),
            Err(PlanError::NoBoundary) => {}
            Err(PlanError::Stopped(_)) if state.budget.allows(!views.is_empty()).is_ok() => break,
            Err(error) => return Err(error.into()),
        }
    }
    // Out of time as soon as all were scored counts as before: the two are not distinguished.
    let complete = !state.budget.is_spent();
    state.budget.allows(!views.is_empty())?;
    let boundary = BoundaryConfig::default();
    let near = state.neighborhoods(boundary.neighbors);
    let boundary = boundary_points(&state.cloud, &near, &boundary).len();
    if views.is_empty() && boundary > 0 && state.given_views.is_empty() {
        let why = format!("none of the {boundary} boundary points has a normal to look along");
        return Err(PlanError::no_view(planner.as_str(), why).into());
    }
    if config.rank_by == RankBy::Gain {
        views.iter_mut().for_each(|(view, _)| view.score = view.gain.unwrap_or(view.score));
    }
    Ok(Ranking { views, boundary, lately_added: [None; 2], complete })
}
