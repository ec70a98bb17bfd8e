//! Views that are given, and the turntable that they, and scans, turn on.

use super::{Session, SessionError};
use crate::{Plane, Planner, Reach, Reading, Scan, SessionConfig, Support, support};
use nalgebra::{Isometry3, Point3};
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

    /// What the object stands on, where these settings say it, or the first scan that shows it.
    pub(super) fn known_support(&self, config: &SessionConfig) -> Option<Plane> {
        match config.support {
            Support::Plane(plane) => Some(plane),
            Support::None => None,
            Support::Auto => {
                let showing = self.scans.iter().chain(&self.aside).filter(|scan| scan.shows_support.is_some());
                showing.min_by_key(|scan| scan.number).and_then(|scan| scan.shows_support)
            }
        }
    }

    /// What was measured that an arm may touch: the cloud, and what the object stands on.
    pub(super) fn touchable(&self) -> Cow<'_, [Point3<f64>]> {
        let mut points = self.stood_on();
        let cloud = &self.state.cloud.points;
        if points.is_empty() {
            return Cow::Borrowed(&cloud[..]);
        }
        points.extend(cloud);
        Cow::Owned(points)
    }

    /// What was measured of what the object stands on, thinned: object's frame.
    pub(super) fn stood_on(&self) -> Vec<Point3<f64>> {
        let points: Vec<Point3<f64>> = self.scans.iter().flat_map(|scan| scan.stood_on.iter().copied()).collect();
        support::obstacles(&points, self.config.seed)
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
