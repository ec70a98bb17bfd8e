//! One scan of a sequence: its cloud, its camera, and its image if there is one.

use super::{Described, DescribedScan};
use crate::camera::{INTRINSICS, check_intrinsics};
use crate::cloud::read_cloud;
use crate::depth::{read_depth, told_unit};
use crate::poses::FilePose;
use crate::{FormatError, Place};
use geometry::{DepthImage, PinholeCamera};
use nalgebra::{Isometry3, Point3};
use planning::pose::rigid;
use planning::scan::FARTHEST_M;
use std::path::Path;

/// Largest difference between two given positions of the same camera, metres.
const SAME_POSITION_M: f64 = 1e-3;
/// Depth at which an image has a point may differ by this share.
const SAME_DEPTH: f64 = 0.05;

/// What is expected where a scan contradicts its camera, without an image and with one.
const EXPECTED: [&str; 2] = [
    "the pose that it was taken from: world_from_camera, +Z forward, metres, not its inverse",
    "the pose that it was taken from (world_from_camera, +Z forward, metres, not its inverse), and depth_unit_m as the \
     unit of the image",
];

/// A camera by its pose, or by its position alone.
#[derive(Clone, Copy)]
pub(super) enum Camera {
    Posed(Isometry3<f64>),
    At(Point3<f64>),
}

/// A scan in the world's frame.
pub(super) struct Raw {
    pub points: Vec<Point3<f64>>,
    pub camera: Camera,
    pub image: Option<(PinholeCamera, DepthImage)>,
    /// How far the rotation of its pose was off one.
    pub off: f64,
    /// What a user should know of how its files were read.
    pub notes: Vec<String>,
}

/// Reads the scans of a described sequence.
pub(super) struct Reader<'a> {
    pub path: &'a Path,
    pub folder: &'a Path,
    pub described: &'a Described,
    /// The pose of each camera, from a file of them; `None` for a scan that the file does not have and that tells its own.
    pub poses: Option<Vec<Option<FilePose>>>,
    /// Where the frame of each cloud lies.
    pub places: Option<Vec<FilePose>>,
}

impl Reader<'_> {
    pub fn read(&self, index: usize) -> Result<Raw, FormatError> {
        let scan = &self.described.scans[index];
        let wrong = |(found, expected): (String, &str)| {
            let place = Place::Part(format!("scan {index} ({})", scan.cloud));
            FormatError::syntax(self.path, place, found, expected)
        };
        let place = self.places.as_ref().map(|places| places[index].world_from_camera);
        let filed = self.poses.as_ref().and_then(|poses| poses[index].as_ref());
        let in_scan = place.zip(self.described.camera_in_scan_m).map(|(place, p)| (place * Point3::from(p)).into());
        let (camera, off) = camera(scan, filed, scan.camera_position_m.or(in_scan)).map_err(wrong)?;
        let mut notes = Vec::new();
        let mut points = self.points(&scan.cloud, &mut notes)?;
        if let Some(place) = place {
            points.iter_mut().for_each(|p| *p = place * *p);
        }
        let Camera::Posed(pose) = camera else {
            return match scan.depth {
                Some(_) => Err(wrong(("depth without a pose".to_owned(), "world_from_camera (4 x 4, row by row)"))),
                None => Ok(Raw { points, camera, image: None, off, notes }),
            };
        };
        let image = match (&scan.depth, scan.intrinsics.or(filed.and_then(|p| p.intrinsics))) {
            (None, _) => None,
            (Some(_), None) => return Err(wrong(("depth without intrinsics".to_owned(), "fx, fy, cx, cy"))),
            (Some(file), Some(given)) => {
                let [fx, fy, cx, cy] = check_intrinsics(given).map_err(|found| wrong((found, INTRINSICS)))?;
                let depth = self.depth(file, filed.and_then(|p| p.metres_per_unit), &mut notes)?;
                let known = filed.filter(|_| scan.intrinsics.is_none()).and_then(|p| p.size);
                if let Some([width, height]) = known.filter(|size| *size != depth.size) {
                    let found = format!("{} x {} pixels in {file}", depth.size[0], depth.size[1]);
                    return Err(wrong((found, &format!("{width} x {height}, as the file of poses has the camera"))));
                }
                Some((PinholeCamera { width: depth.size[0], height: depth.size[1], fx, fy, cx, cy }, depth))
            }
        };
        belongs(&pose, image.as_ref(), &points).map_err(wrong)?;
        Ok(Raw { points, camera, image, off, notes })
    }

    /// The points of a cloud, metres.
    fn points(&self, cloud: &str, notes: &mut Vec<String>) -> Result<Vec<Point3<f64>>, FormatError> {
        let file = read_cloud(&self.folder.join(cloud))?;
        notes.extend(file.notes.iter().map(|note| format!("{cloud}: {note}")));
        if let Some(unit) = file.unknown_unit {
            let expected = "metres, or another unit that is known: convert the cloud, or rename its columns";
            let place = Place::Part("names of the columns".to_owned());
            return Err(FormatError::syntax(&self.folder.join(cloud), place, format!("the unit {unit:?}"), expected));
        }
        let mut points = file.cloud.points;
        if let Some(unit) = file.metres_per_unit.filter(|unit| *unit != 1.0) {
            notes.push(format!("{cloud}: read in units of {unit} m, as its columns say"));
            points.iter_mut().for_each(|p| p.coords *= unit);
        }
        let all = points.len();
        points.retain(|p| p.coords.amax() <= FARTHEST_M);
        match all - points.len() {
            0 => {}
            far if far == all => {
                let (path, found) =
                    (self.folder.join(cloud), format!("no point within {FARTHEST_M:.0e} m of the origin"));
                return Err(FormatError::Empty {
                    path,
                    found,
                    expected: "points near the origin: of coordinates of a survey subtract an offset first, and the same from cameras",
                });
            }
            far => notes.push(format!(
                "{cloud}: dropped {far} points farther away than {FARTHEST_M:.0e} m: markers for no return?"
            )),
        }
        Ok(points)
    }

    /// A depth image, metres; `told` is its unit by the file of poses.
    fn depth(&self, image: &str, told: Option<f64>, notes: &mut Vec<String>) -> Result<DepthImage, FormatError> {
        let (path, given) = (self.folder.join(image), self.described.depth_unit_m);
        let file = read_depth(&path, given.or(told))?;
        let odd = told_unit(&path, given, told, "depth_unit_m");
        notes.extend(file.notes.into_iter().chain(odd).map(|note| format!("{image}: {note}")));
        Ok(file.image)
    }
}

/// The camera of a scan, told by itself or by a file, and how far its rotation was off one; what is found instead, and
/// expected.
fn camera(
    scan: &DescribedScan,
    filed: Option<&FilePose>,
    position: Option<[f64; 3]>,
) -> Result<(Camera, f64), (String, &'static str)> {
    let position = position.map(Point3::from);
    if let Some(position) = position.filter(|p| p.iter().any(|x| !x.is_finite())) {
        return Err((format!("camera position {position}"), "x, y, z in metres"));
    }
    let pose = match &scan.world_from_camera {
        Some(rows) => Some(rigid(rows).map_err(|found| (found, "a rigid motion"))?),
        None => filed.map(|p| (p.world_from_camera, p.off)),
    };
    match (pose, position) {
        (None, None) => Err((
            "neither of both".to_owned(),
            "its camera: camera_position_m, world_from_camera (4 x 4, row by row), or a file of poses",
        )),
        (None, Some(position)) => Ok((Camera::At(position), 0.0)),
        (Some((pose, off)), None) => Ok((Camera::Posed(pose), off)),
        (Some((pose, off)), Some(position)) => match (pose.translation.vector - position.coords).norm() {
            apart if apart <= SAME_POSITION_M => Ok((Camera::Posed(pose), off)),
            apart => Err((
                format!("camera_position_m {apart:.3} m away from the position of its pose"),
                "the same position in both, or only one of them",
            )),
        },
    }
}

/// Whether a camera may have taken a scan: most points lie ahead of it, and, where the image is known, most of those in it
/// are as far away as it says; what is found instead, and expected.
fn belongs(
    pose: &Isometry3<f64>,
    image: Option<&(PinholeCamera, DepthImage)>,
    points: &[Point3<f64>],
) -> Result<(), (String, &'static str)> {
    let percent = |count: usize| 100 * count / points.len().max(1);
    let local: Vec<Point3<f64>> = points.iter().map(|p| pose.inverse() * p).filter(|p| p.z > 0.0).collect();
    if 2 * local.len() < points.len() {
        return Err((format!("{} % of its points ahead of its camera", percent(local.len())), EXPECTED[0]));
    }
    let Some((camera, depth)) = image else { return Ok(()) };
    let agrees = |p: &&Point3<f64>| {
        let pixel = camera.project(p);
        let (column, row) = (pixel.x.round(), pixel.y.round());
        let inside = (0.0..f64::from(camera.width)).contains(&column) && (0.0..f64::from(camera.height)).contains(&row);
        let seen = inside.then(|| depth.at(column as u32, row as u32)).flatten();
        seen.is_some_and(|z| (f64::from(z) - p.z).abs() <= SAME_DEPTH * p.z)
    };
    let agreeing = local.iter().filter(agrees).count();
    match 2 * agreeing < points.len() {
        true => Err((format!("{} % of its points where its depth image has them", percent(agreeing)), EXPECTED[1])),
        false => Ok(()),
    }
}
