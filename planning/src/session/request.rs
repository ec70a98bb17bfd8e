//! What is asked of a session.

use super::ViewCheck;
use crate::Budget;

/// What one request says beside the settings.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Where the camera is now, in the cell, metres; else as the settings say, else where the last scan was taken.
    pub current_position_m: Option<[f64; 3]>,
    /// How long it may take.
    pub budget: Budget,
    /// Whether the camera gets there, where who asks knows: a motion planner.
    pub check: Option<ViewCheck>,
}
