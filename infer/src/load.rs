//! From files to scans, and back: everything of the program that touches bytes goes through `formats`.

mod organised;
mod origin;
mod poses;
mod told;

pub use origin::Origin;
pub(crate) use poses::off_rotation;
pub use poses::{PoseFile, poses, read_pose, rigid};
pub(crate) use told::Told;

use crate::request::Unit;
use anyhow::{Context, Result, bail};
use formats::FormatError;
use formats::camera::{CameraFile, INTRINSICS, check_intrinsics};
use formats::cloud::{CloudFile, parse_cloud, read_cloud};
use formats::depth::{DepthFile, parse_depth, read_depth, told_unit};
use formats::poses::FilePose;
use geometry::{Lens, PinholeCamera, Undistorted, undistort_depth};
use nalgebra::{Isometry3, Point3};
use organised::Organised;
use planning::{NoReturn, Reading, Scan};
use std::path::Path;

/// A scan, and what there is to say of how it was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The scan.
    pub scan: Scan,
    /// Guesses and losses, and the unit.
    pub reading: Reading,
}

/// A cloud from a file: a depth image where the file is organised and its pixels prove a pinhole camera, which the file's own pose places
/// where the points are in the camera's frame. Without `unit`, the unit that the file names holds, or metres. `from`, the camera's position
/// in the unit of the cloud, if it is known.
pub fn cloud(path: &Path, unit: Option<Unit>, from: Option<Origin>) -> Result<Loaded> {
    Ok(from_cloud_file(in_known_unit(path, read_cloud(path)?, unit)?, unit).seen_from(from, unit))
}

/// Largest file that a request may name, bytes: one that a session keeps, in base64, is read again under the largest `service.body_mib`.
const NAMED: u64 = 760 << 20;

/// A file that a request names: a regular one, no device or pipe.
pub fn named_bytes(path: &Path) -> Result<Vec<u8>> {
    let about = std::fs::metadata(path).with_context(|| format!("{path:?}: cannot be read"))?;
    if !about.is_file() {
        bail!("{path:?}: not a regular file");
    }
    if about.len() > NAMED {
        bail!("{path:?}: {} MiB, at most {} are read", about.len() >> 20, NAMED >> 20);
    }
    std::fs::read(path).with_context(|| format!("{path:?}: cannot be read"))
}

/// [`cloud`] of such a file. Who asks need not be allowed to see it: what is in it shows in no error.
pub fn named_cloud(path: &Path, bytes: &[u8], unit: Option<Unit>, from: Option<Origin>) -> Result<Loaded> {
    match parse_cloud(path, bytes) {
        Ok(file) if file.unknown_unit.is_some() && unit.is_none() => {
            bail!("{path:?}: the unit that its columns name is not known: give the unit, m or mm")
        }
        Ok(file) => Ok(from_cloud_file(file, unit).seen_from(from, unit)),
        Err(error @ FormatError::UnknownType { .. }) => Err(error.into()),
        Err(_) => {
            bail!("{path:?}: not a valid file of the type that its extension says (infer --scan FILE reports where)")
        }
    }
}

/// [`cloud`] from bytes; the extension of the name determines the format.
pub fn cloud_bytes(name: &str, bytes: &[u8], unit: Option<Unit>, from: Option<Origin>) -> Result<Loaded> {
    let file = in_known_unit(name.as_ref(), parse_cloud(name.as_ref(), bytes)?, unit)?;
    Ok(from_cloud_file(file, unit).seen_from(from, unit))
}

/// Refuses a unit that nobody knows, unless another is given.
fn in_known_unit(path: &Path, file: CloudFile, unit: Option<Unit>) -> Result<CloudFile> {
    if let (Some(found), None) = (&file.unknown_unit, unit) {
        bail!("{path:?}: the unit [{found}] of its columns is not known: give --unit (unit in a request), m or mm");
    }
    Ok(file)
}

fn from_cloud_file(file: CloudFile, unit: Option<Unit>) -> Loaded {
    let (file, mut reading) = in_metres(file, unit);
    let Some(seen) = Organised::of(&file) else {
        let from = file.viewpoint.map(|pose| Point3::from(pose.translation.vector));
        return Loaded { scan: Scan::Cloud { cloud: file.cloud, from }, reading };
    };
    let placed = file.viewpoint.filter(|_| seen.in_sensor_frame());
    if placed.is_some() {
        let why = "its pixels prove a camera at the origin of its points";
        reading.notes.push(format!("{why}: its VIEWPOINT was taken for the pose of that camera"));
    }
    let world_from_camera = placed.unwrap_or(seen.pose);
    Loaded { scan: seen.scan(world_from_camera), reading }
}

/// A file as it was read, in metres.
fn in_metres(mut file: CloudFile, unit: Option<Unit>) -> (CloudFile, Reading) {
    let mut notes = std::mem::take(&mut file.notes);
    let metres = unit.map(Unit::metres).or(file.metres_per_unit).unwrap_or(1.0);
    match (unit, file.metres_per_unit) {
        (Some(_), Some(named)) if named != metres => {
            notes.push(format!(
                "its columns name a unit of {named} m, but it was read in units of {metres} m as requested (--unit)"
            ));
        }
        (None, Some(named)) if named != 1.0 => notes.push(format!("read in units of {named} m, as its columns say")),
        _ => {}
    }
    if metres != 1.0 {
        file.cloud.points.iter_mut().for_each(|p| p.coords *= metres);
        if let Some(viewpoint) = &mut file.viewpoint {
            viewpoint.translation.vector *= metres;
        }
    }
    notes.extend(leave_out_camera(&mut file));
    (file, Reading { notes, metres_per_unit: Some(metres), table_angle_deg: None })
}

/// Leaves out the points of an organised cloud that lie where its sensor was: (0, 0, 0) of pixels without a return, moved
/// with the rest.
fn leave_out_camera(file: &mut CloudFile) -> Option<String> {
    let (Some(grid), Some(viewpoint)) = (&mut file.grid, file.viewpoint) else { return None };
    let camera = Point3::from(viewpoint.translation.vector);
    let near = 1e-6 * (1.0 + camera.coords.norm());
    let kept: Vec<usize> = (0..file.cloud.len()).filter(|&i| (file.cloud.points[i] - camera).norm() > near).collect();
    let left_out = file.cloud.len() - kept.len();
    if left_out > 0 {
        grid.pixels = kept.iter().map(|&i| grid.pixels[i]).collect();
        file.cloud = planning::thin::select(&file.cloud, &kept);
    }
    (left_out > 0).then(|| format!("{left_out} points at the sensor's position are treated as pixels without a return"))
}

impl Loaded {
    /// The same, its notes naming the file.
    pub(crate) fn named(mut self, path: &Path) -> Self {
        self.reading.notes.iter_mut().for_each(|note| *note = format!("{path:?}: {note}"));
        self
    }

    /// With the camera's position, in metres unless a unit is given: one that the file names is that of its columns alone. Said
    /// where an organised cloud proves another position.
    fn seen_from(mut self, given: Option<Origin>, unit: Option<Unit>) -> Self {
        let Some(origin) = given else { return self };
        let metres = unit.map_or(1.0, Unit::metres);
        let given = origin.middle(metres);
        match &mut self.scan {
            Scan::Cloud { cloud, from } => {
                self.reading.notes.extend(replace_position(from, given));
                if let Some(path) = origin.path(metres) {
                    self.scan = Scan::Lines { cloud: std::mem::take(cloud), path };
                }
            }
            Scan::Lines { .. } => {}
            Scan::Depth { world_from_camera, .. } => {
                let proven = Point3::from(world_from_camera.translation.vector);
                if (proven - given).norm() > 1e-3 {
                    self.reading.notes.push(format!(
                        "an organised cloud whose pixels prove a camera at {}: the given position, {}, is ignored",
                        triple(&proven),
                        triple(&given)
                    ));
                }
            }
        }
        self
    }
}

/// Takes the camera's position given in place of the one that the file tells; said where they are not the same.
fn replace_position(from: &mut Option<Point3<f64>>, given: Point3<f64>) -> Option<String> {
    let told = from.replace(given).filter(|told| (told - given).norm() > 1e-3)?;
    Some(format!("the file has its camera at {} m: the position given was used instead", triple(&told)))
}

fn triple(p: &Point3<f64>) -> String {
    format!("({:.3}, {:.3}, {:.3})", p.x, p.y, p.z)
}

/// The camera of a depth image as it is calibrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCamera {
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// Its distortion.
    pub lens: Lens,
    /// Columns and rows that it was calibrated for, if that is known.
    pub size: Option<[u32; 2]>,
    /// Metres per unit of its images, if a file says so.
    pub metres_per_unit: Option<f64>,
}

/// The camera of the depth images as the command line has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GivenCamera {
    /// A calibration (`--camera`): of all images.
    File(DepthCamera),
    /// fx, fy, cx, cy in pixels (`--intrinsics`).
    Intrinsics([f64; 4]),
}

impl From<CameraFile> for DepthCamera {
    fn from(CameraFile { size, intrinsics, lens, metres_per_unit }: CameraFile) -> Self {
        Self { intrinsics, lens, size, metres_per_unit }
    }
}

/// The pinhole camera of a depth image, its distortion aside.
fn pinhole(file: &DepthFile, camera: &DepthCamera) -> Result<PinholeCamera> {
    if let Some([width, height]) = camera.size.filter(|size| *size != file.image.size) {
        let [columns, rows] = file.image.size;
        bail!(
            "{columns} x {rows} pixels, but the camera was calibrated for {width} x {height}: give the calibration of this size"
        );
    }
    let wrong = |found| anyhow::anyhow!("intrinsics: found {found}, expected {INTRINSICS}");
    let [fx, fy, cx, cy] = check_intrinsics(camera.intrinsics).map_err(wrong)?;
    Ok(PinholeCamera { width: file.image.size[0], height: file.image.size[1], fx, fy, cx, cy })
}

/// A depth image, and what is odd about its camera.
pub fn from_depth_file(
    file: DepthFile,
    camera: &DepthCamera,
    world_from_camera: Isometry3<f64>,
    misses: NoReturn,
) -> Result<Loaded> {
    let lens = camera.lens;
    let camera = pinhole(&file, camera)?;
    let mut notes = file.notes;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let off = |center: f64, size: f64| (center / size - 0.5).abs();
    let point = format!("({}, {}) of an image of {width} x {height} pixels", camera.cx, camera.cy);
    if off(camera.cx, width).max(off(camera.cy, height)) > 0.5 {
        notes.push(format!("the principal point {point} is outside the image: intrinsics for another resolution?"));
    } else if off(camera.cx, width).max(off(camera.cy, height)) > 0.2
        && off(camera.cx, width).min(off(camera.cy, height)) > 0.1
    {
        notes.push(format!(
            "the principal point {point} is far from the middle of the image: intrinsics for another resolution?"
        ));
    }
    let Undistorted { camera, image: depth, left_out } = match lens.is_pinhole() {
        true => Undistorted { camera, image: file.image, left_out: 0 },
        false => undistort_depth(&file.image, &camera, &lens),
    };
    if left_out > 0 {
        notes.push(format!(
            "dropped {left_out} pixels that look more than 75 degrees off the axis, or beyond the validity of the lens model"
        ));
    }
    let reading = Reading { notes, metres_per_unit: None, table_angle_deg: None };
    Ok(Loaded { scan: Scan::Depth { camera, depth, world_from_camera, misses }, reading })
}

/// A depth image in bytes; the extension of the name determines the format.
pub fn depth_bytes(name: &str, bytes: &[u8], metres_per_unit: Option<f64>) -> Result<DepthFile> {
    check_unit("metres_per_unit", metres_per_unit)?;
    Ok(parse_depth(name.as_ref(), bytes, metres_per_unit)?)
}

fn check_unit(name: &str, metres_per_unit: Option<f64>) -> Result<()> {
    match metres_per_unit {
        Some(unit) if !(unit > 0.0 && unit.is_finite()) => {
            bail!("{name}: expected metres per unit such as 0.001, found {unit}")
        }
        _ => Ok(()),
    }
}

/// A depth image from a file, with its pose as given on the command line. Without `metres_per_unit`, the unit that the file of the pose
/// or of the camera says holds, or the usual one.
pub fn depth(
    path: &Path,
    metres_per_unit: Option<f64>,
    pose: &str,
    given: Option<GivenCamera>,
    misses: NoReturn,
) -> Result<Loaded> {
    check_unit("--depth-unit", metres_per_unit)?;
    let filed = poses::file_pose("--pose", pose)?;
    let camera = camera_of(path, &filed, given)?;
    let file = read_depth(path, metres_per_unit.or(camera.metres_per_unit))?;
    let mut loaded =
        from_depth_file(file, &camera, filed.world_from_camera, misses).with_context(|| format!("{path:?}"))?;
    loaded.reading.notes.extend(told_unit(path, metres_per_unit, camera.metres_per_unit, "--depth-unit"));
    loaded.reading.notes.extend(other_intrinsics(&filed, &camera));
    loaded.reading.notes.extend(off_rotation(filed.off));
    Ok(loaded)
}

/// Said where the intrinsics used are not those of the file of the pose.
fn other_intrinsics(filed: &FilePose, camera: &DepthCamera) -> Option<String> {
    let (told, used) = (filed.intrinsics?, camera.intrinsics);
    // Rounding is no difference.
    let differ = told.iter().zip(&used).any(|(told, used)| (told - used).abs() > 0.1);
    differ.then(|| format!("the pose file has the intrinsics {told:?}, but {used:?} were used as --intrinsics says"))
}

/// The pose of a depth image's camera, and the camera.
pub fn placed_camera(path: &Path, pose: &str, given: Option<GivenCamera>) -> Result<(Isometry3<f64>, DepthCamera)> {
    let filed = poses::file_pose("--pose", pose)?;
    Ok((filed.world_from_camera, camera_of(path, &filed, given)?))
}

/// The camera of a depth image: the file of the pose is of this image, that of the camera of all.
fn camera_of(path: &Path, filed: &FilePose, given: Option<GivenCamera>) -> Result<DepthCamera> {
    let plain = |intrinsics, size| DepthCamera { intrinsics, lens: Lens::Pinhole, size, metres_per_unit: None };
    let camera = match (given, filed.intrinsics) {
        (Some(GivenCamera::Intrinsics(intrinsics)), _) => plain(intrinsics, None),
        (Some(GivenCamera::File(camera)), None) => camera,
        (Some(GivenCamera::File(camera)), Some(intrinsics)) => {
            DepthCamera { intrinsics, size: filed.size.or(camera.size), ..camera }
        }
        (None, Some(intrinsics)) => plain(intrinsics, filed.size),
        (None, None) => bail!(
            "{path:?}: the camera is unknown: give --camera FILE, --intrinsics fx,fy,cx,cy, or \"intrinsics\" in the pose file"
        ),
    };
    let metres_per_unit = filed.metres_per_unit.or(camera.metres_per_unit);
    Ok(DepthCamera { metres_per_unit, ..camera })
}

/// A cloud from a file with the pose of its camera: most of it must lie ahead, or it is in the camera's own frame, which the pose places.
pub fn cloud_from(path: &Path, unit: Option<Unit>, pose: &str) -> Result<Loaded> {
    let FilePose { world_from_camera, off, .. } = poses::file_pose("--pose", pose)?;
    let file = in_known_unit(path, read_cloud(path)?, unit)?;
    let placed = placed(file, unit, &world_from_camera);
    let mut loaded = placed.map_err(|why| anyhow::anyhow!("--pose {pose}, {path:?}: {why}"))?;
    loaded.reading.notes.extend(off_rotation(off));
    Ok(loaded)
}

fn placed(file: CloudFile, unit: Option<Unit>, given: &Isometry3<f64>) -> Result<Loaded, String> {
    let (file, mut reading) = in_metres(file, unit);
    let position = |pose: &Isometry3<f64>| Point3::from(pose.translation.vector);
    let Some(seen) = Organised::of(&file) else {
        check_ahead(&file.cloud.points, given)?;
        let mut from = file.viewpoint.as_ref().map(position);
        reading.notes.extend(replace_position(&mut from, position(given)));
        return Ok(Loaded { scan: Scan::Cloud { cloud: file.cloud, from }, reading });
    };
    let told = file.viewpoint.filter(|told| {
        let off = told.inverse() * given;
        off.translation.vector.norm().max(off.rotation.angle()) > 1e-3
    });
    match told.as_ref().map(position) {
        Some(told) if seen.in_sensor_frame() => reading.notes.push(format!(
            "the file has another pose of its camera, at {} m (VIEWPOINT): the pose given was used instead",
            triple(&told)
        )),
        Some(told) => {
            let why = "its pixels prove that its points were seen from its VIEWPOINT";
            return Err(format!("{why}, at {} m: omit --pose, or move the points", triple(&told)));
        }
        None => {}
    }
    let world_from_camera = if seen.in_sensor_frame() { *given } else { seen.pose };
    Ok(Loaded { scan: seen.scan(world_from_camera), reading })
}

/// Refuses a camera that most of what it saw lies behind.
///
/// # Errors
/// Says how much lies ahead, and what may be wrong.
pub fn check_ahead(points: &[Point3<f64>], world_from_camera: &Isometry3<f64>) -> Result<(), String> {
    let camera_from_world = world_from_camera.inverse();
    let ahead = points.iter().filter(|p| (camera_from_world * **p).z > 0.0).count();
    let measured = points.iter().filter(|p| p.iter().all(|x| x.is_finite())).count();
    if 2 * ahead >= measured {
        return Ok(());
    }
    Err(format!(
        "{} % of the points lie ahead of this camera: is it camera_from_world, the inverse? Expected world_from_camera, +Z \
         forward, metres",
        100 * ahead / measured
    ))
}

#[cfg(test)]
mod to_pose {
    mod tests;
}

#[cfg(test)]
mod tests;
