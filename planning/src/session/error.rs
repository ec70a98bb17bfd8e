//! Why a session has no answer.

use crate::config::ConfigError;
use crate::doubt::PositionDoubt;
use crate::planners::auto::ChooseError;
use crate::registration::Unsafe;
use crate::scan::{Reading, Refusal, ScanReport};
use crate::{PlanError, Stopped};

/// Why no answer can be given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// A setting is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The planner asked for cannot work.
    #[error(transparent)]
    Choose(#[from] ChooseError),
    /// Nothing to plan on.
    #[error("there is no scan yet: add one first")]
    NoScan,
    /// A scan with too few usable points.
    #[error("too few points to plan on: {}, at least {least} are needed{}", report.describe(), way_in(report))]
    TooFewPoints {
        /// What was done with them.
        report: Box<ScanReport>,
        /// The setting `min_points`.
        least: usize,
    },
    /// A cloud of no size.
    #[error(
        "the cloud is {across_m:.1e} m across, smaller than a micrometre: {}",
        if *in_millimetres { "are its numbers metres (--unit m)?" } else { "are its numbers of a larger unit than metres?" }
    )]
    TooSmall {
        /// Diagonal of its box, metres.
        across_m: f64,
        /// Whether its numbers were taken for less than metres.
        in_millimetres: bool,
    },
    /// A scan that is to be moved onto the cloud, and cannot be.
    #[error(
        "the scan cannot be registered and is not used: {why}; or registration.register = \"check\" accepts it as it is"
    )]
    Unregistered {
        /// Why.
        why: Unsafe,
    },
    /// An angle of a table that there is none of.
    #[error("table angle of {0} degrees, but no turntable: give its axis and stops under [turntable] in the settings")]
    NoTurntable(f64),
    /// The planner has no view for a reason that is no end.
    #[error(transparent)]
    Plan(PlanError),
    /// It took too long, or nobody waits any longer; the session is as it was.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// Who was to say where the camera gets to did not.
    #[error("no view is answered, for they could not be checked: {0}")]
    Check(String),
    /// Travel is limited or weighed, from nowhere.
    #[error(
        "max_travel_m and travel_weight_per_m need the camera's position: set constraints.current_position_m, \
         or give the position that the last scan was taken from (--from x,y,z)"
    )]
    NoCurrentPosition,
    /// The same, where the position that was given is not believed.
    #[error(
        "max_travel_m and travel_weight_per_m need the camera's position, and that of scan {number} is not believed: it {}; correct it, or set \
         constraints.current_position_m", why.describe()
    )]
    DoubtedPosition {
        /// The scan.
        number: usize,
        /// Why.
        why: PositionDoubt,
    },
}

/// How points come near enough, where most are too far away.
fn way_in(report: &ScanReport) -> &'static str {
    if 2 * report.out_of_range <= report.read {
        return "";
    }
    "; of coordinates of a survey (easting, northing) subtract an offset first, and the same from camera positions"
}

impl From<PlanError> for SessionError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Stopped(stopped) => Self::Stopped(stopped),
            other => Self::Plan(other),
        }
    }
}

impl SessionError {
    /// A scan that cannot be planned on.
    pub(super) fn refused(refusal: Refusal, least: usize, reading: &Reading) -> Self {
        match refusal {
            Refusal::TooFew(report) => Self::TooFewPoints { report: Box::new(report), least },
            Refusal::TooSmall(across_m) => {
                Self::TooSmall { across_m, in_millimetres: reading.metres_per_unit.is_some_and(|m| m < 1.0) }
            }
            Refusal::Stopped(stopped) => Self::Stopped(stopped),
        }
    }
}

#[cfg(test)]
mod tests;
