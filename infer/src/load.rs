//! From files to scans, and back: everything of the program that touches bytes goes through `formats`.

use crate::request::Unit;
use anyhow::{Context, Result, bail};
use formats::FormatError;
use formats::cloud::{CloudFile, Grid, parse_cloud, read_cloud};
use formats::depth::{parse_depth, read_depth};
use formats::poses::{FilePose, read_poses};
use geometry::{DepthImage, PinholeCamera};
use nalgebra::{Isometry3, Point3, Vector2};
use planning::Misses;
use planning::Scan;
use planning::pose::from_quaternion;
use serde::Serialize;
use std::path::Path;

/// Metres per step of a 16-bit depth image, where nothing else is said.
pub const DEPTH_UNIT: f64 = 0.001;

/// A cloud from a file: a depth image where the file is organised and its pixels prove a pinhole camera.
pub fn cloud(path: &Path, unit: Unit) -> Result<Scan> {
    Ok(from_cloud_file(read_cloud(path)?, unit))
}

/// Largest file that a request may name, bytes.
const NAMED: u64 = 1 << 30;

/// A file that a request names: a regular one, no device or pipe.
pub fn named_bytes(path: &Path) -> Result<Vec<u8>> {
    let shown = path.display();
    let about = std::fs::metadata(path).with_context(|| format!("{shown}: cannot be read"))?;
    if !about.is_file() {
        bail!("{shown}: not a regular file");
    }
    if about.len() > NAMED {
        bail!("{shown}: {} MiB, at most {} are read", about.len() >> 20, NAMED >> 20);
    }
    std::fs::read(path).with_context(|| format!("{shown}: cannot be read"))
}

/// [`cloud`] of such a file. Who asks need not be allowed to see it: what is in it shows in no error.
pub fn named_cloud(path: &Path, bytes: &[u8], unit: Unit) -> Result<Scan> {
    match parse_cloud(path, bytes) {
        Ok(file) => Ok(from_cloud_file(file, unit)),
        Err(error @ FormatError::UnknownType { .. }) => Err(error.into()),
        Err(_) => {
            bail!("{}: not a cloud as its ending says (infer --scan FILE tells where it is not)", path.display())
        }
    }
}

/// [`cloud`] from bytes; the name's ending tells the format.
pub fn cloud_bytes(name: &str, bytes: &[u8], unit: Unit) -> Result<Scan> {
    Ok(from_cloud_file(parse_cloud(name.as_ref(), bytes)?, unit))
}

fn from_cloud_file(mut file: CloudFile, unit: Unit) -> Scan {
    let metres = unit.metres();
    if metres != 1.0 {
        file.cloud.points.iter_mut().for_each(|p| p.coords *= metres);
        if let Some(viewpoint) = &mut file.viewpoint {
            viewpoint.translation.vector *= metres;
        }
    }
    let poses = file.viewpoint.into_iter().chain([Isometry3::identity()]);
    if let Some(grid) = &file.grid {
        for pose in poses {
            if let Some((camera, depth)) = depth_of_organised(&file.cloud.points, grid, &pose) {
                // Sensors that write organised clouds leave out what they failed on, too.
                return Scan::Depth { camera, depth, world_from_camera: pose, misses: Misses::Unknown };
            }
        }
    }
    let from = file.viewpoint.map(|pose| Point3::from(pose.translation.vector));
    Scan::Cloud { cloud: file.cloud, from }
}

/// The pinhole camera that maps every point of an organised cloud onto its pixel, seen from `world_from_camera`, and
/// the depth image; `None` where no such camera does within a pixel (a scanner with another geometry, or another
/// frame).
fn depth_of_organised(
    points: &[Point3<f64>],
    grid: &Grid,
    world_from_camera: &Isometry3<f64>,
) -> Option<(PinholeCamera, DepthImage)> {
    if points.len() < 100 || grid.width < 2 || grid.height < 2 {
        return None;
    }
    let camera_from_world = world_from_camera.inverse();
    let local: Vec<Point3<f64>> = points.iter().map(|p| camera_from_world * p).collect();
    if local.iter().any(|p| p.z <= 0.0) {
        return None;
    }
    let pixel = |i: usize| (grid.pixels[i] as usize % grid.width, grid.pixels[i] as usize / grid.width);
    let columns = (0..local.len()).map(|i| Vector2::new(local[i].x / local[i].z, pixel(i).0 as f64));
    let rows = (0..local.len()).map(|i| Vector2::new(local[i].y / local[i].z, pixel(i).1 as f64));
    let (fx, cx) = line_through(columns)?;
    let (fy, cy) = line_through(rows)?;
    let camera = PinholeCamera { width: grid.width as u32, height: grid.height as u32, fx, fy, cx, cy };
    let mut depth = vec![0.0; grid.width * grid.height];
    for (i, p) in local.iter().enumerate() {
        let (column, row) = pixel(i);
        let projected = camera.project(p);
        if (projected.x - column as f64).abs() > 1.0 || (projected.y - row as f64).abs() > 1.0 {
            return None;
        }
        depth[grid.pixels[i] as usize] = p.z as f32;
    }
    Some((camera, DepthImage { origin: [0, 0], size: [camera.width, camera.height], depth }))
}

/// Slope and intercept of y over x by least squares; `None` unless the slope is a positive number.
fn line_through(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<(f64, f64)> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<Vector2<f64>>() / count;
    let (xx, xy) = points.fold((0.0, 0.0), |(xx, xy), p| {
        let d = p - mean;
        (xx + d.x * d.x, xy + d.x * d.y)
    });
    let slope = xy / xx;
    (slope.is_finite() && slope > 0.0).then(|| (slope, mean.y - slope * mean.x))
}

/// A 16-bit PNG.
pub fn depth_png(bytes: &[u8], metres_per_unit: Option<f64>) -> Result<DepthImage> {
    Ok(parse_depth("depth.png".as_ref(), bytes, metres_per_unit.unwrap_or(DEPTH_UNIT))?)
}

/// An NPY image; `metres_per_unit` counts for integers.
pub fn depth_npy(bytes: &[u8], metres_per_unit: Option<f64>) -> Result<DepthImage> {
    Ok(parse_depth("depth.npy".as_ref(), bytes, metres_per_unit.unwrap_or(DEPTH_UNIT))?)
}

/// A pose file as it is written here; [`formats::poses`] reads it, and others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseFile {
    /// 4 x 4, row by row, metres.
    pub world_from_camera: [[f64; 4]; 4],
    /// fx, fy, cx, cy in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<[f64; 4]>,
}

/// A depth image from a file, with its pose as given on the command line.
pub fn depth(
    path: &Path,
    metres_per_unit: Option<f64>,
    pose: &str,
    intrinsics: Option<[f64; 4]>,
    misses: Misses,
) -> Result<Scan> {
    let (world_from_camera, known) = read_pose(pose)?;
    let Some([fx, fy, cx, cy]) = intrinsics.or(known) else {
        bail!(
            "{}: the camera is unknown: give --intrinsics fx,fy,cx,cy, or \"intrinsics\" in the pose file",
            path.display()
        );
    };
    if !(fx > 0.0 && fy > 0.0) {
        bail!("--intrinsics: fx and fy must be positive, found {fx} and {fy}");
    }
    let depth = read_depth(path, metres_per_unit.unwrap_or(DEPTH_UNIT))?;
    let camera = PinholeCamera { width: depth.size[0], height: depth.size[1], fx, fy, cx, cy };
    Ok(Scan::Depth { camera, depth, world_from_camera, misses })
}

/// A cloud from a file with the pose of its camera: most of it must lie ahead.
pub fn cloud_from(path: &Path, unit: Unit, pose: &str) -> Result<Scan> {
    let (world_from_camera, _) = read_pose(pose)?;
    let mut scan = cloud(path, unit)?;
    let Scan::Cloud { cloud, from } = &mut scan else {
        bail!("{}: its pixels tell where its camera was already: leave --pose {pose} away", path.display());
    };
    let camera_from_world = world_from_camera.inverse();
    let ahead = cloud.points.iter().filter(|p| (camera_from_world * **p).z > 0.0).count();
    if 2 * ahead < cloud.len() {
        bail!(
            "--pose {pose}: {} % of the points of {} lie ahead of this camera: is it camera_from_world, the inverse? \
             Expected world_from_camera, +Z forward, metres",
            100 * ahead / cloud.len().max(1),
            path.display()
        );
    }
    *from = Some(Point3::from(world_from_camera.translation.vector));
    Ok(scan)
}

/// A pose from tx,ty,tz,qx,qy,qz,qw, from a file with one, or, as FILE:NAME or FILE:INDEX, from one with several.
fn read_pose(text: &str) -> Result<(Isometry3<f64>, Option<[f64; 4]>)> {
    if let Ok([x, y, z, qx, qy, qz, qw]) = crate::args::numbers::<7>(text) {
        let pose = from_quaternion([qx, qy, qz, qw], [x, y, z]).map_err(anyhow::Error::msg);
        return Ok((pose.with_context(|| format!("--pose {text}"))?, None));
    }
    let (file, wanted) = match text.rsplit_once(':') {
        Some((file, wanted)) if !Path::new(text).exists() => (file, Some(wanted)),
        _ => (text, None),
    };
    if !Path::new(file).exists() {
        bail!("--pose {text}: neither tx,ty,tz,qx,qy,qz,qw nor a file that can be read");
    }
    let poses = known_poses(Path::new(file))?;
    let count = poses.len();
    let chosen = match wanted {
        None if count == 1 => poses.first(),
        None => {
            bail!("--pose {text}: found {count} poses, expected one: name it, {text}:NAME or {text}:0 to {}", count - 1)
        }
        Some(wanted) => {
            let named = poses.iter().find(|p| p.name.as_deref() == Some(wanted));
            named.or_else(|| poses.get(wanted.parse::<usize>().ok()?))
        }
    };
    let pose = chosen.with_context(|| format!("--pose {text}: no such pose among the {count} of {file}"))?;
    Ok((pose.world_from_camera, pose.intrinsics))
}

/// The poses of cameras of a file, for [`planning::Session::set_given_views`].
pub fn poses(path: &Path) -> Result<Vec<Isometry3<f64>>> {
    Ok(known_poses(path)?.iter().map(|p| p.world_from_camera).collect())
}

/// The poses of a file; what is odd about them is said.
fn known_poses(path: &Path) -> Result<Vec<FilePose>> {
    let file = read_poses(path)?;
    if file.of_scans {
        bail!(
            "{}: the lines of a .conf place range images, whose cameras stood elsewhere: expected poses of cameras",
            path.display()
        );
    }
    let off = file.poses.iter().map(|p| p.off).fold(0.0, f64::max);
    if off > NOT_ROUNDING {
        tracing::warn!("{}: rotations are off by up to {off:.1e}; the nearest ones are taken", path.display());
    }
    Ok(file.poses)
}

/// Rotations are off by more than rounding.
const NOT_ROUNDING: f64 = 1e-3;

/// A 4 x 4 matrix as a rigid motion; said where it was off by more than rounding.
pub fn rigid(rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, String> {
    let (pose, off) = planning::pose::rigid(rows)?;
    if off > NOT_ROUNDING {
        tracing::warn!("world_from_camera: its rotation is off by {off:.1e}; the nearest one is taken");
    }
    Ok(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::PointCloud;

    fn organised(camera: &PinholeCamera, pose: &Isometry3<f64>) -> CloudFile {
        let mut file = CloudFile::default();
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut pixels = Vec::new();
        for i in (0..width * height).filter(|i| i % 7 != 0) {
            let (column, row) = ((i % width) as f64, (i / width) as f64);
            let z = 1.0 + 0.2 * (column * 0.1).sin() + 0.001 * row;
            file.cloud.points.push(pose * camera.unproject(column, row, z));
            pixels.push(i as u32);
        }
        file.grid = Some(Grid { width, height, pixels });
        file
    }

    #[test]
    fn an_organised_cloud_is_a_depth_image() {
        let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
        let pose = Isometry3::new(nalgebra::Vector3::new(1.0, 2.0, 3.0), nalgebra::Vector3::new(0.3, 0.2, 0.1));
        let moved = CloudFile { viewpoint: Some(pose), ..organised(&camera, &pose) };
        for (file, expected) in [(organised(&camera, &Isometry3::identity()), Isometry3::identity()), (moved, pose)] {
            let points = file.cloud.points.clone();
            let Scan::Depth { camera: found, depth, world_from_camera, misses } = from_cloud_file(file, Unit::M) else {
                panic!("a depth image was expected");
            };
            assert!((found.fx - 55.0).abs() < 1e-6 && (found.cy - 25.5).abs() < 1e-6, "{found:?}");
            assert_eq!((world_from_camera, misses), (expected, Misses::Unknown));
            let back = depth.to_points(&found, &world_from_camera);
            assert_eq!(back.len(), points.len());
            assert!(back.iter().zip(&points).all(|(a, b)| (a - b).norm() < 1e-5), "the points come back");
        }
    }

    #[test]
    fn named_files_are_regular_and_keep_their_secrets() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("secret.xyz");
        std::fs::write(&path, "x y z\nhunter2 is the password").expect("a file");
        let read = |path: &Path| named_cloud(path, &named_bytes(path)?, Unit::M);
        let error = format!("{:#}", read(&path).expect_err("no cloud"));
        assert!(error.contains("secret.xyz") && !error.contains("hunter2"), "{error}");
        std::fs::write(&path, "1 2 3\n").expect("a file");
        assert!(read(&path).is_ok());
        for device in [Path::new("/dev/zero"), folder.path()] {
            let error = format!("{:#}", read(device).expect_err("no file"));
            assert!(error.contains("not a regular file"), "{error}");
        }
    }

    #[test]
    fn a_cloud_of_another_geometry_stays_a_cloud() {
        let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
        let mut file = organised(&camera, &Isometry3::identity());
        file.cloud.points.iter_mut().for_each(|p| p.x += 0.3);
        assert!(
            matches!(from_cloud_file(file, Unit::M), Scan::Cloud { from: None, .. }),
            "shifted: not from the origin"
        );
        let flat = PointCloud { points: vec![Point3::new(1.0, 2.0, 3.0)], normals: Vec::new() };
        let file = CloudFile { cloud: flat, ..Default::default() };
        let Scan::Cloud { cloud, .. } = from_cloud_file(file, Unit::Mm) else { panic!("a cloud was expected") };
        assert_eq!(cloud.points, vec![Point3::new(0.001, 0.002, 0.003)], "millimetres become metres");
    }

    #[test]
    fn poses_that_are_none_are_refused() {
        let identity = [[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 0.], [0., 0., 0., 1.]];
        assert_eq!(rigid(&identity), Ok(Isometry3::identity()));
        let mut mirrored = identity;
        mirrored[0][0] = -1.0;
        assert!(rigid(&mirrored).expect_err("mirrored").contains("determinant -1"), "says so");
        let mut by_column = identity;
        by_column[3] = [0.5, 0.0, 0.0, 1.0];
        assert!(rigid(&by_column).expect_err("transposed").contains("row by row"), "names the likely mistake");
        let (pose, _) = read_pose("1,2,3,0,0,0,1").expect("numbers");
        assert_eq!(pose, Isometry3::translation(1.0, 2.0, 3.0), "translation and quaternion");
        assert!(read_pose("1,2,3,0,0,0,2").is_err(), "not a unit quaternion");
        assert!(format!("{:#}", read_pose("nowhere.json").expect_err("no file")).contains("nowhere.json"));
    }

    #[test]
    fn one_pose_of_several_is_asked_for_by_name_or_number() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("poses.log");
        let matrix = |z: i32| format!("1 0 0 0\n0 1 0 0\n0 0 1 {z}\n0 0 0 1\n");
        std::fs::write(&path, format!("5 5 6\n{}6 6 7\n{}", matrix(3), matrix(4))).expect("written");
        let at = |suffix: &str| read_pose(&format!("{}{suffix}", path.display())).map(|(pose, _)| pose.translation.z);
        assert_eq!((at(":0").ok(), at(":1").ok(), at(":6").ok()), (Some(3.0), Some(4.0), Some(4.0)));
        let several = format!("{:#}", at("").expect_err("which?"));
        assert!(several.contains("found 2 poses") && several.contains("poses.log:0 to 1"), "{several}");
        assert!(format!("{:#}", at(":9").expect_err("none")).contains("no such pose among the 2"));
        assert_eq!(poses(&path).expect("both").len(), 2);
        let conf = dir.path().join("bun.conf");
        std::fs::write(&conf, "bmesh a.ply 0 0 0 0 0 0 1\n").expect("written");
        assert!(poses(&conf).expect_err("scans").to_string().contains("place range images"));
    }

    #[test]
    fn a_cloud_takes_the_position_of_its_pose_and_lies_ahead() {
        let dir = tempfile::tempdir().expect("a folder");
        let (cloud, pose) = (dir.path().join("a.xyz"), dir.path().join("pose.txt"));
        std::fs::write(&cloud, "0 0 1\n0.1 0 1\n0 0.1 1\n0 0 -1\n").expect("written");
        let rows = |z: i32| format!("1 0 0 0.5\n0 1 0 0\n0 0 1 {z}\n0 0 0 1\n");
        std::fs::write(&pose, rows(0)).expect("written");
        let text = pose.display().to_string();
        let scan = cloud_from(&cloud, Unit::M, &text).expect("ahead");
        assert_eq!(scan.camera_position(), Some(Point3::new(0.5, 0.0, 0.0)));
        std::fs::write(&pose, rows(2)).expect("written");
        let error = cloud_from(&cloud, Unit::M, &text).expect_err("behind").to_string();
        assert!(error.contains("0 % of the points") && error.contains("the inverse"), "{error}");
    }
}
