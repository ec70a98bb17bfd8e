//! Views that are given, and the turntable that they, and scans, turn on.

use super::{Session, SessionError};
use crate::{Plane, Planner, Reach, Reading, Scan, SessionConfig, Support, support};
use nalgebra::Isometry3;
use std::borrow::Cow;
use std::sync::Arc;

impl Session {
    /// Chooses from these poses (`world_from_camera`) alone from now on: taught poses, or, with a turntable, poses in the cell, each at
    /// every stop. Each is scored like a candidate, none is invented, and those that were scanned from already are ruled out.
    /// Empty: views at the boundary of the cloud again, or, of a camera that stands still, those of its stops.
    pub fn set_given_views(&mut self, poses: Vec<Isometry3<f64>>) {
        self.taught = poses.into();
        self.place_views();
        self.ranking = None;
        // What was expected for other views would be where the next expectation starts from.
        self.planners.reset();
    }

    /// The given views in the object's frame, and the arm, as the settings have them.
    pub(super) fn place_views(&mut self) {
        self.given_views = match &self.config.turntable {
            Some(table) => table.views(&self.taught).into(),
            None => Arc::clone(&self.taught),
        };
        self.state.given_views = Arc::clone(&self.given_views);
        self.reach = self.config.robot.as_ref().map(|robot| Arc::new(Reach::new(robot)));
    }

    /// What the object stands on, where it is looked for and this scan shows it.
    pub(super) fn find_support(&self, scan: &Scan) -> Option<Plane> {
        if self.config.support != Support::Auto {
            return None;
        }
        let points = match scan {
            Scan::Cloud { cloud, .. } | Scan::Lines { cloud, .. } => Cow::Borrowed(&cloud.points),
            Scan::Depth { camera, depth, world_from_camera, .. } => {
                Cow::Owned(depth.to_points(camera, world_from_camera))
            }
        };
        let tolerance = self.config.tolerance_m.max(0.5 * self.config.support_margin_m);
        support::find(&points, &self.config.constraints.up(), tolerance, self.config.seed)
    }

    /// What the object stands on, as far as it is known.
    pub fn support(&self) -> Option<Plane> {
        self.support
    }

    /// The table's angle at the last scan that has one, degrees.
    pub(super) fn table_deg(&self) -> f64 {
        let scans = self.scans.iter().chain(&self.aside);
        let last = scans.filter(|scan| scan.reading.table_angle_deg.is_some()).max_by_key(|scan| scan.number);
        last.and_then(|scan| scan.reading.table_angle_deg).unwrap_or(0.0)
    }

    /// Where the object's frame is in the cell's at that angle.
    pub(super) fn cell_from_object(&self) -> Isometry3<f64> {
        let table = self.config.turntable.as_ref();
        table.map_or_else(Isometry3::identity, |table| table.cell_from_object(self.table_deg()))
    }

    /// A scan in the object's frame, which was in the cell's where it tells an angle of the table.
    pub(super) fn on_table(&self, scan: Scan, reading: &Reading) -> Result<Scan, SessionError> {
        match (&self.config.turntable, reading.table_angle_deg) {
            (_, None) => Ok(scan),
            (None, Some(angle)) => Err(SessionError::NoTurntable(angle)),
            (Some(table), Some(angle)) => Ok(scan.moved(&table.cell_from_object(angle).inverse())),
        }
    }
}

/// What the object stands on, where the settings say it.
pub(super) fn given_support(config: &SessionConfig) -> Option<Plane> {
    match config.support {
        Support::Plane(plane) => Some(plane),
        Support::None | Support::Auto => None,
    }
}
