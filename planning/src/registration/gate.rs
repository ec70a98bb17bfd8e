//! Which results are not safe to use.

use super::Motion;
use super::icp::Fit;
use super::prior::Prior;
use crate::answer::length;
use serde::{Deserialize, Serialize};

/// Larger corrections than this many times what the robot's accuracy explains are wrong ones.
const FARTHEST: f64 = 2.2;
/// Tolerances that the expected error may be: later scans still mend it.
const UNSURE: f64 = 0.6;

/// Why a registration must not be used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Unsafe {
    /// Hardly anything to register by.
    #[error(
        "too little of it lies near the cloud with a similar normal ({pairs} points): take a view that overlaps more"
    )]
    TooFewPairs {
        /// Pairs of the last step.
        pairs: usize,
    },
    /// The correction is larger than the robot's error can be.
    #[error(
        "it fits best {} away, and the robot's accuracy explains {} at most: check the pose, or registration.pose_error_m and \
         pose_error_deg", length(*shift_m), length(*allowed_m)
    )]
    TooFar {
        /// How far, metres.
        shift_m: f64,
        /// How far it may be.
        allowed_m: f64,
    },
    /// The overlap does not say where it lies.
    #[error(
        "the surface it sees again leaves an uncertainty of {}, but {} is allowed{}: take a view that sees more of the known surface, from more sides",
        length(*expected_m), length(*allowed_m), weakest.map_or(String::new(), |motion| format!(" (it may {motion})"))
    )]
    Uncertain {
        /// Root mean square error that is expected, metres.
        expected_m: f64,
        /// What it may be.
        allowed_m: f64,
        /// The motion that is determined least.
        weakest: Option<Motion>,
    },
}

/// Why this result is not safe; `None` where nothing speaks against it.
pub(super) fn judge(
    fit: &Fit,
    shift_m: f64,
    expected_m: f64,
    prior: &Prior,
    tolerance: f64,
    weakest: &Option<Motion>,
) -> Option<Unsafe> {
    let (farthest, unsure) = (FARTHEST * prior.rms, UNSURE * tolerance);
    if !fit.finished {
        return Some(Unsafe::TooFewPairs { pairs: fit.pairs });
    }
    if shift_m > farthest {
        return Some(Unsafe::TooFar { shift_m, allowed_m: farthest });
    }
    (expected_m > unsure).then_some(Unsafe::Uncertain { expected_m, allowed_m: unsure, weakest: *weakest })
}
