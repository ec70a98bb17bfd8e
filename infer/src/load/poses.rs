//! Poses of cameras, from files in any of the formats of `formats::poses`.

use anyhow::{Context, Result, bail};
use formats::poses::{FilePose, read_poses};
use formats::sequence::called;
use nalgebra::Isometry3;
use planning::pose::from_quaternion;
use serde::Serialize;
use std::path::Path;

/// A pose file as it is written here; [`formats::poses`] reads it, and others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PoseFile {
    /// 4 x 4, row by row, metres.
    pub world_from_camera: [[f64; 4]; 4],
    /// fx, fy, cx, cy in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<[f64; 4]>,
}

/// A pose from tx,ty,tz,qx,qy,qz,qw, from a file with one, or, as FILE:NAME or FILE:INDEX, from one with several; and fx, fy, cx, cy where
/// the file has them.
pub fn read_pose(text: &str) -> Result<(Isometry3<f64>, Option<[f64; 4]>)> {
    file_pose(text).map(|pose| (pose.world_from_camera, pose.intrinsics))
}

/// The pose of [`read_pose`] with all that its file says beside it.
pub(super) fn file_pose(text: &str) -> Result<FilePose> {
    if let Ok([x, y, z, qx, qy, qz, qw]) = crate::args::numbers::<7>(text) {
        let pose = from_quaternion([qx, qy, qz, qw], [x, y, z]).map_err(anyhow::Error::msg);
        let world_from_camera = pose.with_context(|| format!("--pose {text}"))?;
        return Ok(FilePose { world_from_camera, ..FilePose::default() });
    }
    let (file, wanted) = match text.rsplit_once(':') {
        Some((file, wanted)) if !Path::new(text).exists() => (file, Some(wanted)),
        _ => (text, None),
    };
    if !Path::new(file).exists() {
        bail!("--pose {text}: neither tx,ty,tz,qx,qy,qz,qw nor a readable file");
    }
    let poses = known_poses(Path::new(file))?;
    let count = poses.len();
    let chosen = match wanted {
        None if count == 1 => poses.first(),
        None => {
            bail!("--pose {text}: found {count} poses, expected one: name it, {}", ways(file, &poses))
        }
        Some(wanted) => called(&poses, &[wanted]).or_else(|| {
            // Where numbers are names, another number is none of them, whatever stands at that place.
            let index = wanted.parse::<usize>().ok().filter(|_| !poses.iter().any(is_numbered))?;
            poses.get(index)
        }),
    };
    chosen.cloned().with_context(|| {
        format!("--pose {text}: no such pose among the {count} of {file}, or more than one: {}", ways(file, &poses))
    })
}

/// How one of these poses is asked for.
fn ways(file: &str, poses: &[FilePose]) -> String {
    match poses.iter().find(|pose| is_numbered(pose)).and_then(|pose| pose.name.as_deref()) {
        Some(name) => format!("{file}:NAME, such as {file}:{name}"),
        None => format!("{file}:NAME or {file}:0 to {}", poses.len() - 1),
    }
}

/// Whether its name is a number, folders and ending aside.
fn is_numbered(pose: &FilePose) -> bool {
    let stem = pose.name.as_deref().and_then(|name| Path::new(name).file_stem()?.to_str());
    stem.is_some_and(|stem| !stem.is_empty() && stem.bytes().all(|b| b.is_ascii_digit()))
}

/// The poses of cameras of a file, for [`planning::Session::set_given_views`].
pub fn poses(path: &Path) -> Result<Vec<Isometry3<f64>>> {
    Ok(known_poses(path)?.iter().map(|p| p.world_from_camera).collect())
}

/// The poses of a file; what is odd about them is said.
fn known_poses(path: &Path) -> Result<Vec<FilePose>> {
    let file = read_poses(path)?;
    if file.of_scans {
        bail!("{path:?}: a .conf file has the poses of range images, not of their cameras: expected camera poses");
    }
    let off = file.poses.iter().map(|p| p.off).fold(0.0, f64::max);
    if off > NOT_ROUNDING {
        tracing::warn!("{path:?}: matrices deviate from rotations by up to {off:.1e}; the nearest rotations are used");
    }
    Ok(file.poses)
}

/// Rotations are off by more than rounding.
const NOT_ROUNDING: f64 = 1e-3;

/// A 4 x 4 matrix as a rigid motion; said where it was off by more than rounding.
pub fn rigid(rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, String> {
    let (pose, off) = planning::pose::rigid(rows)?;
    if off > NOT_ROUNDING {
        tracing::warn!("world_from_camera deviates from a rotation by {off:.1e}; the nearest rotation is used");
    }
    Ok(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
