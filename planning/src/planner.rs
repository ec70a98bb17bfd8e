//! What a policy answers, and how it fails.

use crate::{ScanState, Stopped};
use geometry::View;
use rand_chacha::ChaCha8Rng;

/// A view with what its policy expects of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RankedView {
    /// The view.
    pub view: View,
    /// The policy's own score, larger is better.
    pub score: f64,
    /// Expected new surface as a share of the whole surface, where the policy predicts it.
    pub gain: Option<f64>,
    /// Expected overlap of the scan with the cloud, where the policy predicts it.
    pub overlap: Option<f64>,
    /// The overlap to count on where a least one is asked for: `overlap`, unless the policy knows what may lower it.
    pub cautious_overlap: Option<f64>,
    /// Its place in [`ScanState::given_views`]; `None` where views are not given. Two that differ in roll alone are the same `view`.
    pub given: Option<usize>,
}

impl RankedView {
    /// A view of which no more is said than its score.
    pub fn scored(view: View, score: f64) -> Self {
        Self { view, score, gain: None, overlap: None, cautious_overlap: None, given: None }
    }
}

/// A next-best-view policy.
///
/// ```
/// use planning::{PlanError, Planner, RankedView, ScanState};
/// use rand_chacha::ChaCha8Rng;
///
/// /// Looks from where the cloud's last camera stood, turned to the other side.
/// struct Opposite;
///
/// impl Planner for Opposite {
///     fn name(&self) -> &str {
///         "opposite"
///     }
///
///     fn rank_views(&mut self, state: &ScanState, _: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
///         let last = state.scans.last().ok_or_else(|| PlanError::lacks("opposite", "a camera"))?;
///         let (low, high) = state.cloud.bounding_box();
///         let target = nalgebra::center(&low, &high);
///         let away = target - nalgebra::Point3::from(last.world_from_camera.translation.vector);
///         let position = target + away.normalize() * state.working_distance;
///         let view = geometry::View { target, position };
///         Ok(vec![RankedView::scored(view, 1.0)])
///     }
/// }
/// ```
pub trait Planner {
    /// Name on the command line.
    fn name(&self) -> &str;

    /// Views in falling order of preference, at least one; given ones say which they are ([`RankedView::given`]). The first
    /// is taken by the episode loop; a robot's constraints may pass over some. What a planner remembers follows
    /// `state.scans`: the same shared scans again, and more, go on from there; others start afresh.
    ///
    /// # Errors
    /// Why there is no view: nothing to look at, something the planner needs and does not have, or a fault.
    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError>;

    /// Forget what was remembered of the current object: a new episode starts.
    fn reset(&mut self) {}
}

/// Why a policy has no view.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// The measured surface has no open edge.
    #[error("the measured surface has no boundary to look beyond: at its spacing it is closed")]
    NoBoundary,
    /// Nothing left among the views that the policy knows.
    #[error("planner {planner} has no view left: {why}")]
    NoView {
        /// Its name.
        planner: String,
        /// Why.
        why: String,
    },
    /// It cannot work with what is known of the scans.
    #[error("planner {planner} cannot work on these scans: {lacks}")]
    Lacks {
        /// Its name.
        planner: String,
        /// What it lacks.
        lacks: String,
    },
    /// It was stopped ([`ScanState::budget`]).
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// Its own fault.
    #[error("planner {planner} failed: {why}")]
    Failed {
        /// Its name.
        planner: String,
        /// What went wrong.
        why: String,
    },
}

impl PlanError {
    /// Whether the policy is merely at its end, rather than broken or misused.
    pub fn is_end(&self) -> bool {
        matches!(self, Self::NoBoundary | Self::NoView { .. })
    }

    /// [`PlanError::NoView`].
    pub fn no_view(planner: &str, why: impl Into<String>) -> Self {
        Self::NoView { planner: planner.to_owned(), why: why.into() }
    }

    /// [`PlanError::Lacks`].
    pub fn lacks(planner: &str, lacks: impl Into<String>) -> Self {
        Self::Lacks { planner: planner.to_owned(), lacks: lacks.into() }
    }

    /// [`PlanError::Failed`].
    pub fn failed(planner: &str, why: impl Into<String>) -> Self {
        Self::Failed { planner: planner.to_owned(), why: why.into() }
    }
}

/// The views if there are any, all with a finite score.
///
/// # Errors
/// `empty` where there is none, [`PlanError::Failed`] where a score is not a number.
pub fn checked(planner: &str, views: Vec<RankedView>, empty: PlanError) -> Result<Vec<RankedView>, PlanError> {
    if let Some(broken) = views.iter().find(|v| !v.score.is_finite()) {
        return Err(PlanError::failed(planner, format!("a view was scored {}", broken.score)));
    }
    if views.is_empty() { Err(empty) } else { Ok(views) }
}
