//! What is asked of a session.

use crate::Budget;
use nalgebra::Isometry3;
use std::fmt;
use std::sync::Arc;

/// What one request says beside the settings.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Where the camera is now, world frame, metres; else as the settings say, else where the last scan was taken.
    pub current_position_m: Option<[f64; 3]>,
    /// How long it may take.
    pub budget: Budget,
    /// What the arm can reach, where who asks knows.
    pub reach: Option<ReachCheck>,
}

/// Why the camera cannot go to a pose, if it cannot.
type WhyNot = dyn Fn(&Isometry3<f64>) -> Option<String> + Send + Sync;

/// Asked of each view that nothing else rules out.
#[derive(Clone)]
pub struct ReachCheck(Arc<WhyNot>);

impl ReachCheck {
    /// As `why_not` says of a pose (`world_from_camera`).
    pub fn new(why_not: impl Fn(&Isometry3<f64>) -> Option<String> + Send + Sync + 'static) -> Self {
        Self(Arc::new(why_not))
    }

    pub(super) fn why_not(&self, pose: &Isometry3<f64>) -> Option<String> {
        (self.0)(pose)
    }
}

impl fmt::Debug for ReachCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ReachCheck")
    }
}
