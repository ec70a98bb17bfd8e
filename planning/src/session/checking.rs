//! The caller's own check, such as a motion planner's: asked of the views that nothing else rules out.

use super::{Placed, SessionError};
use crate::Budget;
use crate::answer::Candidate;
use crate::constraints::Objection;
use crate::pose::Pose;
use crate::reach::{JointValue, Reach};
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// A view that the caller is asked about: where the camera would stand, in the frame that does not turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AskedView {
    /// The camera's pose in the cell; without a turntable that is `world_from_camera`.
    pub cell_from_camera: Pose,
    /// Where the turntable stops for it, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_stop_deg: Option<f64>,
    /// The flange's pose in the arm's base, where the settings have an arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub base_from_flange: Option<Pose>,
    /// Joint values that get it there, where the settings have an arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<JointValue>>,
}

/// What the caller says of a view.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// It can be taken, and this is taken off its score.
    Reachable {
        /// Zero or more, in units of the score.
        cost: f64,
    },
    /// It cannot.
    Unreachable {
        /// Why, for people.
        reason: String,
    },
}

/// One verdict per view, in their order; or why there are none.
type Check = dyn Fn(&[AskedView], &Budget) -> Result<Vec<Verdict>, String> + Send + Sync;

/// The caller's own check.
#[derive(Clone)]
pub struct ViewCheck(Arc<Check>);

impl ViewCheck {
    /// As `check` says of all views of one question. It ends when the budget does.
    pub fn new(check: impl Fn(&[AskedView], &Budget) -> Result<Vec<Verdict>, String> + Send + Sync + 'static) -> Self {
        Self(Arc::new(check))
    }

    fn ask(&self, views: &[AskedView], budget: &Budget) -> Result<Vec<Verdict>, SessionError> {
        let verdicts = (self.0)(views, budget);
        // What is not asked to the end is not allowed, whether the best so far will do or not.
        budget.allows(false)?;
        let verdicts = verdicts.map_err(SessionError::Check)?;
        if verdicts.len() != views.len() {
            let message = format!("{} answers for {} views: one is expected for each", verdicts.len(), views.len());
            return Err(SessionError::Check(message));
        }
        let odd = |v: &&Verdict| matches!(v, Verdict::Reachable { cost } if !(cost.is_finite() && *cost >= 0.0));
        match verdicts.iter().find(odd) {
            Some(Verdict::Reachable { cost }) => {
                Err(SessionError::Check(format!("a cost of {cost}: expected zero or a positive number")))
            }
            _ => Ok(verdicts),
        }
    }

    /// Asks of all views that nothing speaks against, in one question; of those refused that a turntable can bring round to another
    /// stop again, stop by stop.
    pub(super) fn judge(
        &self,
        views: &mut [Considered],
        reach: Option<&Reach>,
        budget: &Budget,
    ) -> Result<(), SessionError> {
        let mut open: Vec<&mut Considered> = views.iter_mut().filter(|view| view.is_open()).collect();
        while !open.is_empty() {
            let asked: Vec<AskedView> = open.iter().map(|view| view.asked(reach)).collect();
            let verdicts = self.ask(&asked, budget)?;
            open = open.into_iter().zip(verdicts).filter_map(|(view, verdict)| view.judged(verdict)).collect();
        }
        Ok(())
    }
}

/// A view of the planner among the places that it can be taken from.
pub(super) struct Considered {
    /// As it is answered, the place aside.
    pub candidate: Candidate,
    /// The one to take first; after it, of a view that nothing speaks against, the other stops of a turntable that allow it.
    pub places: Vec<Placed>,
    /// The place that is asked about.
    pub at: usize,
    /// Why the first place was refused.
    pub refused: Option<String>,
}

impl Considered {
    /// Whether nothing speaks against it so far.
    pub fn is_open(&self) -> bool {
        self.places.first().is_some_and(|place| place.objections.is_empty())
    }

    fn asked(&self, reach: Option<&Reach>) -> AskedView {
        let place = &self.places[self.at];
        let cell_from_camera = place.cell_from_object * place.world_from_camera;
        AskedView {
            cell_from_camera: Pose::from(&cell_from_camera),
            table_stop_deg: place.table.as_ref().map(|table| table.stop_deg),
            base_from_flange: reach.map(|reach| Pose::from(&reach.base_from_flange(&cell_from_camera))),
            joints: place.reached.as_ref().map(|reached| reached.joints.clone()),
        }
    }

    /// Itself where another place is to be asked about.
    fn judged(&mut self, verdict: Verdict) -> Option<&mut Self> {
        match verdict {
            Verdict::Reachable { cost } => {
                self.places[self.at].cost += cost;
                None
            }
            Verdict::Unreachable { reason } => {
                let first = self.refused.get_or_insert(reason).clone();
                self.at += 1;
                if self.at < self.places.len() {
                    return Some(self);
                }
                self.at = 0;
                self.places[0].objections.push(Objection::of_caller(first));
                None
            }
        }
    }

    /// The candidate at its place.
    pub fn candidate(mut self) -> Candidate {
        let place = self.places.swap_remove(self.at);
        Candidate {
            score: self.candidate.planner_score - place.cost,
            world_from_camera: Pose::from(&place.world_from_camera),
            table: place.table,
            reached: place.reached,
            objections: place.objections,
            ..self.candidate
        }
    }
}

impl fmt::Debug for ViewCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ViewCheck")
    }
}

#[cfg(test)]
mod tests;
