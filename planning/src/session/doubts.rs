//! What the scans contradict, and what was made of it.

use super::Session;
use crate::Support;
use crate::answer::{Candidate, length};
use crate::doubt;
use crate::scan::PreparedScan;
use crate::support::STANDING;
use geometry::PointCloud;
use nalgebra::{Isometry3, Point3};

impl Session {
    /// Holds each scan that was not yet against those before it.
    pub(super) fn compare_scans(&mut self) {
        for i in self.offsets.len()..self.scans.len() {
            let mut before = PointCloud::default();
            self.scans[..i].iter().for_each(|scan| before.merge(&scan.cloud));
            let scan = &self.scans[i];
            let offset = match i {
                0 => None,
                _ => doubt::offset(&before, &scan.cloud, self.config.tolerance_m, scan.spacing),
            };
            self.offsets.push(offset);
        }
    }

    /// A sentence for each doubt.
    pub(super) fn doubts(&self, next: Option<&Candidate>) -> Vec<String> {
        let mut doubts = Vec::new();
        for scan in &self.scans {
            let number = scan.number;
            if let Some(doubt) = &scan.doubt {
                doubts.push(format!(
                    "the camera position of scan {number} {}; it is ignored, and estimated from the points instead",
                    doubt.describe()
                ));
            }
        }
        for (i, scan) in self.scans.iter().enumerate() {
            let same = |before: &&PreparedScan| before.fingerprint == scan.fingerprint && !scan.cloud.is_empty();
            if let Some(same) = self.scans[..i].iter().find(same) {
                doubts.push(format!(
                    "scan {} has exactly the points of scan {}: was one file given twice, or did the camera not measure anew?",
                    scan.number, same.number
                ));
            }
        }
        for (scan, offset) in self.scans.iter().zip(&self.offsets) {
            let number = scan.number;
            if let Some(offset) = offset.filter(|o| o.is_misfit(self.config.tolerance_m)) {
                doubts.push(format!(
                    "scan {number} lies {} off the scans before it where both should be the same surface (their noise: \
                     {}): register it, or check its pose",
                    length(offset.apart_m),
                    length(offset.noise_m)
                ));
            }
        }
        for i in self.planners.scans_with_distrusted_misses() {
            let number = self.state.number(i);
            doubts.push(format!(
                "scan {number} has pixels without a return where other scans saw surface: its misses are not treated as free space (misses, --misses unknown)"
            ));
        }
        if let Some(next) = next
            && self.config.constraints.floor_height_m.is_none()
            && self.support.is_none()
        {
            let up = self.config.constraints.up();
            // As the object stands when the view is taken.
            let turned = self.config.turntable.as_ref().zip(next.table.as_ref());
            let cell_from_object =
                turned.map_or_else(Isometry3::identity, |(table, stop)| table.cell_from_object(stop.stop_deg));
            let height = |p: &Point3<f64>| (cell_from_object * p).coords.dot(&up);
            let points = &self.state.cloud.points;
            let lowest = points.iter().map(height).fold(f64::INFINITY, f64::min);
            let layer = 2.0 * self.config.tolerance_m.max(self.state.grid_size);
            let standing = points.iter().filter(|p| height(p) < lowest + layer).count() as f64;
            let camera = height(&Point3::from(next.position_m));
            if camera < lowest && standing > STANDING * points.len() as f64 {
                doubts.push(format!(
                    "the camera would be {} below the lowest measured points, a plane that the object seems to stand on: if so, set constraints.floor_height_m={lowest:.3}, or --support auto if the scans show it",
                    length(lowest - camera)
                ));
            }
        }
        doubts.extend(self.far_support());
        doubts
    }

    /// Of a given support that lies so far below all points that nothing stands on it.
    fn far_support(&self) -> Option<String> {
        let plane = self.support.filter(|_| matches!(self.config.support, Support::Plane(_)))?;
        let (low, high) = self.state.cloud.bounding_box();
        let lowest = self.state.cloud.points.iter().map(|p| plane.height(p)).fold(f64::INFINITY, f64::min);
        (lowest > (high - low).norm()).then(|| {
            format!(
                "the given support lies {} below the lowest measured point, and the cloud is only {} across: is the offset D of --support NX,NY,NZ,D right?",
                length(lowest),
                length((high - low).norm())
            )
        })
    }
}
