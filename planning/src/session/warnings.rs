//! What a user should know of the scans and of the answer.

use super::Session;
use crate::Seen;
use crate::answer::{Candidate, length};
use crate::constraints::Constraint;
use crate::scan::{FARTHEST_M, ScanReport};
use geometry::PointCloud;
use nalgebra::Point3;

/// A cloud is large for its unit beyond so many working distances, and small within such a share of one.
const TOO_LARGE: f64 = 10.0;
const TOO_SMALL: f64 = 0.01;
/// A scan that is smaller than this share of another is in another unit.
const ANOTHER_UNIT: f64 = 0.01;
/// A tolerance beyond this share of the cloud hides what a view adds.
const COARSE: f64 = 0.05;
/// Pixels this many tolerances apart leave gaps between what their points cover, even seen at right angles.
const GAPS: f64 = 1.7;
/// Notes of an answer.
const MOST_NOTES: usize = 20;

impl Session {
    /// What is odd about sizes and distances.
    pub(super) fn warnings(&self, next: Option<&Candidate>, candidates: &[Candidate]) -> Vec<String> {
        let mut warnings = self.notes();
        warnings.extend(self.doubts(next));
        warnings.extend(self.unfit());
        warnings.extend(self.waiting());
        let reports = || self.scans.iter().map(|s| &s.report);
        let total = |count: fn(&ScanReport) -> usize| reports().map(count).sum::<usize>();
        let (read, used, thinned) = (total(|r| r.read), total(|r| r.used), total(|r| r.thinned));
        if thinned * 10 > read {
            warnings.push(format!("thinned to {used} of {read} points before planning (max_points)"));
        }
        let duplicates = total(|r| r.duplicates);
        if duplicates * 10 > read {
            warnings.push(format!("dropped {duplicates} duplicates of {read} points"));
        }
        if reports().any(|r| r.normals_ignored) {
            warnings.push(
                "the given normals are too few or not perpendicular to the surface: normals were estimated instead"
                    .to_owned(),
            );
        }
        let (turned, estimated) = (total(|r| r.normals_turned), total(|r| r.normals_estimated));
        if turned * 10 > used {
            warnings.push(format!("{turned} of {used} given normals point away from the camera: flipped"));
        }
        if estimated > 0 {
            warnings.push(format!("{estimated} normals are missing and were estimated"));
        }
        let far: usize = total(|r| r.out_of_range);
        if far > 0 {
            warnings.push(format!("dropped {far} points farther away than {FARTHEST_M:.0e} m: markers for no return?"));
        }
        if self.config.support == crate::Support::Auto && self.support.is_none() {
            let nothing = "support = auto: no scan that was added with it shows a plane that the object stands on (within 30 degrees of level, on all sides of it): everything is treated as the object";
            warnings.push(nothing.to_owned());
        }
        let (beyond, mixed) = (total(|r| r.beyond_sensor), total(|r| r.mixed_pixels));
        if beyond > 0 {
            warnings.push(format!(
                "dropped {beyond} of {read} points outside the sensor's range (sensor.min_range_m, \
                 sensor.max_range_m)"
            ));
        }
        if mixed > 0 {
            warnings.push(format!("dropped {mixed} mixed pixels between two depths (sensor.drop_mixed_pixels)"));
        }
        let outliers = total(|r| r.outliers);
        if outliers > 0 {
            warnings.push(format!("dropped {outliers} points far from all others (outlier_factor)"));
        }
        let (low, high) = self.state.cloud.bounding_box();
        let diagonal = (high - low).norm();
        let odd = self.in_another_unit();
        let metres = self.scans.last().and_then(|s| s.reading.metres_per_unit);
        let farthest = self.config.working_distances().into_iter().fold(0.0, f64::max);
        let large = diagonal > TOO_LARGE * farthest;
        let too_large = large && metres.is_none_or(|m| m >= 1.0);
        let across = length(diagonal);
        let depth = self.scans.last().and_then(|s| s.past.last()).is_some_and(|p| matches!(p.seen, Seen::Depth { .. }));
        match metres {
            _ if odd.is_some() => warnings.extend(odd),
            None if depth && too_large => warnings.push(format!(
                "the cloud is {across} across, {:.0} times the working distance: are its depths and poses in metres?",
                diagonal / farthest
            )),
            _ if too_large => warnings.push(format!(
                "the cloud is {across} across, {:.0} times the working distance: are its numbers millimetres (--unit mm makes it \
                 {})?",
                diagonal / farthest,
                length(diagonal * 0.001)
            )),
            Some(m) if m < 1.0 && diagonal < TOO_SMALL * farthest => warnings.push(format!(
                "the cloud is {across} across: are its numbers metres (--unit m makes it {})?",
                length(diagonal / m)
            )),
            None if !depth && diagonal < 0.001 * farthest => {
                warnings.push(format!("the cloud is {across} across: are its numbers metres (--unit m)?"));
            }
            _ => {}
        }
        let tolerance = self.config.tolerance_m;
        if tolerance > COARSE * diagonal {
            warnings.push(format!(
                "tolerance_m of {} is coarse for a cloud {} across: views will seem to add nothing (try --set tolerance_m={:.1e})",
                length(tolerance),
                length(diagonal),
                0.01 * diagonal
            ));
        }
        let camera = &self.state.camera;
        let image = f64::from(camera.width) / camera.fx;
        let angle = image.min(f64::from(camera.height) / camera.fy);
        // The whole box in the image, seen from in front of its near side.
        let serves = 1.1 * diagonal / angle + 0.5 * diagonal;
        let unreached =
            candidates.iter().filter(|c| c.objections.iter().any(|o| o.constraint == Constraint::Reach)).count();
        if 2 * unreached > candidates.len() {
            warnings.push(format!(
                "the arm does not reach {unreached} of {} views: is it too far to the object for it at {} (--distance, working_distance_m), \
                 or does it stand elsewhere (robot.cell_from_base)?",
                candidates.len(),
                length(farthest)
            ));
        }
        let Some(best) = next.or(candidates.first()) else { return warnings };
        let distance = best.working_distance_m;
        let position = Point3::from(best.position_m);
        let nearest = self.state.cloud.points.iter().map(|p| (p - position).norm()).fold(f64::INFINITY, f64::min);
        if nearest < 0.5 * distance && !too_large {
            warnings.push(format!(
                "the camera would be {} from the measured surface, in or near the cloud, which is {} across: try a distance of {} (--distance {serves:.3})",
                length(nearest),
                length(diagonal),
                length(serves)
            ));
        } else if diagonal > distance * angle && !too_large && self.overflows(best) {
            warnings.push(format!(
                "the cloud is {} across and overflows the image at {}: try a distance of {} (--distance {serves:.3})",
                length(diagonal),
                length(distance),
                length(serves)
            ));
        }
        let pixel = camera.pixel_size(distance);
        if pixel > GAPS * tolerance {
            warnings.push(format!(
                "pixels are {} apart at {}, and a point covers surface within tolerance_m of {}: every scan leaves gaps, which no planned \
                 view fills (try --set tolerance_m={pixel:.1e}, or a shorter distance)",
                length(pixel),
                length(distance),
                length(tolerance)
            ));
        }
        warnings
    }

    /// Whether the image of a view does not hold the cloud: more than a hundredth of its points.
    pub(super) fn overflows(&self, view: &Candidate) -> bool {
        let (camera, points) = (&self.state.camera, &self.state.cloud.points);
        let camera_from_world = self.camera_at(view).inverse();
        let outside = |p: &&Point3<f64>| {
            let local = camera_from_world * **p;
            let pixel = camera.project(&local);
            let within = |x: f64, size: u32| x >= -0.5 && x < f64::from(size) - 0.5;
            !(local.z > 0.0 && within(pixel.x, camera.width) && within(pixel.y, camera.height))
        };
        100 * points.iter().filter(outside).count() > points.len()
    }

    /// Of a scan so much smaller than another that its numbers must be in another unit.
    fn in_another_unit(&self) -> Option<String> {
        let across = |cloud: &PointCloud| {
            let (low, high) = cloud.bounding_box();
            (high - low).norm()
        };
        let sizes = || self.scans.iter().map(|scan| (across(&scan.cloud), scan.number));
        let (small, number) = sizes().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let (large, other) = sizes().max_by(|a, b| a.0.total_cmp(&b.0))?;
        (small < ANOTHER_UNIT * large).then(|| {
            format!(
                "scan {number} is {} across, and scan {other} {}: is one of them in another unit (--unit, for each command of a session)?",
                length(small),
                length(large)
            )
        })
    }

    /// What there is to say of the files that the scans were.
    fn notes(&self) -> Vec<String> {
        let all = self.scans.iter().flat_map(|s| s.reading.notes.iter().map(move |note| (s.number, note)));
        let numbered = |(i, note): (usize, &String)| match self.scans.len() {
            1 => note.clone(),
            _ => format!("scan {i}: {note}"),
        };
        let mut notes: Vec<String> = all.map(numbered).collect();
        let left = notes.len().saturating_sub(MOST_NOTES);
        if left > 0 {
            notes.truncate(MOST_NOTES);
            notes.push(format!("and {left} more such notes about the scans"));
        }
        notes
    }
}
