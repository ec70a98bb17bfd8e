//! What a user should know of the scans and of the answer.

use super::Session;
use crate::answer::{Candidate, length};
use crate::scan::FARTHEST_M;
use nalgebra::Point3;

impl Session {
    /// What is odd about sizes and distances.
    pub(super) fn warnings(&self, next: Option<&Candidate>, candidates: &[Candidate]) -> Vec<String> {
        let mut warnings = self.doubts(next);
        let reports = || self.scans.iter().map(|s| &s.report);
        let (read, used): (usize, usize) = reports().fold((0, 0), |(r, u), x| (r + x.read, u + x.used));
        if reports().map(|r| r.thinned).sum::<usize>() * 10 > read {
            warnings.push(format!("thinned to {used} of {read} points before planning (max_points)"));
        }
        let far: usize = reports().map(|r| r.out_of_range).sum();
        if far > 0 {
            warnings.push(format!("left out {far} points farther away than {FARTHEST_M:.0e} m: marks for no return?"));
        }
        let outliers: usize = reports().map(|r| r.outliers).sum();
        if outliers > 0 {
            warnings.push(format!("dropped {outliers} points far from all others (outlier_factor)"));
        }
        let (low, high) = self.state.cloud.bounding_box();
        let diagonal = (high - low).norm();
        if diagonal > 50.0 {
            warnings.push(format!("the cloud is {} across: is it in millimetres (--unit mm)?", length(diagonal)));
        } else if diagonal < 0.002 {
            warnings.push(format!("the cloud is {} across: is it in metres (--unit m)?", length(diagonal)));
        }
        let camera = &self.state.camera;
        let image = f64::from(camera.width) / camera.fx;
        let angle = image.min(f64::from(camera.height) / camera.fy);
        // The whole box in the image, seen from in front of its near side.
        let serves = 1.1 * diagonal / angle + 0.5 * diagonal;
        let Some(best) = next.or(candidates.first()) else { return warnings };
        let distance = best.working_distance_m;
        let position = Point3::from(best.position_m);
        let nearest = self.state.cloud.points.iter().map(|p| (p - position).norm()).fold(f64::INFINITY, f64::min);
        if nearest < 0.5 * distance {
            warnings.push(format!(
                "the camera would stand {} from the measured surface, in or near the cloud, which is {} across: \
                 a distance of {} would serve (--distance {serves:.3})",
                length(nearest),
                length(diagonal),
                length(serves)
            ));
        } else if diagonal > distance * angle {
            warnings.push(format!(
                "the cloud is {} across and overflows the image at {}: a distance of {} would serve (--distance {serves:.3})",
                length(diagonal),
                length(distance),
                length(serves)
            ));
        }
        warnings
    }
}
