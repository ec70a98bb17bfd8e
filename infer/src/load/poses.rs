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
/// the file has them. `flag` is whose value the text is, for errors.
pub fn read_pose(flag: &str, text: &str) -> Result<(Isometry3<f64>, Option<[f64; 4]>)> {
    let pose = file_pose(flag, text)?;
    warn_of(format_args!("{flag} {text}"), pose.off);
    Ok((pose.world_from_camera, pose.intrinsics))
}

/// The pose of [`read_pose`] with all that its file says beside it.
pub(super) fn file_pose(flag: &str, text: &str) -> Result<FilePose> {
    if let Ok([x, y, z, qx, qy, qz, qw]) = crate::args::numbers::<7>(text) {
        let pose = from_quaternion([qx, qy, qz, qw], [x, y, z]).map_err(anyhow::Error::msg);
        let world_from_camera = pose.with_context(|| format!("{flag} {text}"))?;
        return Ok(FilePose { world_from_camera, ..FilePose::default() });
    }
    let (file, wanted) = match text.rsplit_once(':') {
        Some((file, wanted)) if !Path::new(text).exists() => (file, Some(wanted)),
        _ => (text, None),
    };
    if !Path::new(file).exists() {
        bail!("{flag} {text}: neither tx,ty,tz,qx,qy,qz,qw nor a readable file");
    }
    let poses = known_poses(Path::new(file))?;
    let count = poses.len();
    let chosen = match wanted {
        None if count == 1 => poses.first(),
        None => {
            bail!("{flag} {text}: found {count} poses, expected one: name it, {}", ways(file, &poses))
        }
        Some(wanted) => called(&poses, &[wanted]).or_else(|| {
            // Where numbers are names, another number is none of them, whatever stands at that place.
            let index = wanted.parse::<usize>().ok().filter(|_| !poses.iter().any(is_numbered))?;
            poses.get(index)
        }),
    };
    chosen.cloned().with_context(|| {
        format!("{flag} {text}: no such pose among the {count} of {file}, or more than one: {}", ways(file, &poses))
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
    let poses = known_poses(path)?;
    warn_of(format_args!("{path:?}"), poses.iter().map(|p| p.off).fold(0.0, f64::max));
    Ok(poses.iter().map(|p| p.world_from_camera).collect())
}

fn known_poses(path: &Path) -> Result<Vec<FilePose>> {
    let file = read_poses(path)?;
    if file.of_scans {
        bail!("{path:?}: a .conf file has the poses of range images, not of their cameras: expected camera poses");
    }
    Ok(file.poses)
}

/// What there is to say of a pose whose matrix was off a rotation by more than rounding.
pub(crate) fn off_rotation(off: f64) -> Option<String> {
    (off > 1e-3).then(|| format!("a pose that is off a rotation by {off:.1e}: the nearest rotation is used"))
}

fn warn_of(whose: std::fmt::Arguments, off: f64) {
    off_rotation(off).iter().for_each(|note| tracing::warn!("{whose}: {note}"));
}

/// A 4 x 4 matrix as a rigid motion; said where it was off by more than rounding.
pub fn rigid(rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, String> {
    let (pose, off) = planning::pose::rigid(rows)?;
    warn_of(format_args!("world_from_camera"), off);
    Ok(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_taken_for_a_rotation_is_told_with_the_scan() {
        use crate::load;
        use crate::request::{Ask, Body};
        use crate::service::Method;
        use base64::{Engine, engine::general_purpose::STANDARD};
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let image = geometry::DepthImage { origin: [0, 0], size: [8, 6], depth: vec![1.0; 48] };
        formats::depth::write_depth(&at("d.png"), &image, 8, 6, 0.001).expect("an image");
        std::fs::write(at("c.xyz"), "0 0 1\n0.1 0 1\n0 0.1 1\n").expect("a cloud");
        let png = STANDARD.encode(std::fs::read(at("d.png")).expect("there"));
        for (scale, told) in [(1.05, true), (1.0, false)] {
            let rows = [[scale, 0., 0., 0.], [0., scale, 0., 0.], [0., 0., scale, 0.], [0., 0., 0., 1.]];
            let row = |r: [f64; 4]| r.map(|x| x.to_string()).join(" ") + "\n";
            std::fs::write(at("pose.txt"), rows.map(row).concat()).expect("a pose");
            let pose = at("pose.txt").display().to_string();
            let camera = load::GivenCamera::Intrinsics([10.0, 10.0, 3.5, 2.5]);
            let body = serde_json::json!({ "depth": {
                "png_base64": png, "intrinsics": [10, 10, 3.5, 2.5], "world_from_camera": rows,
            } });
            let body = body.to_string().into_bytes();
            let Ok(Ask::AddScan { scan, .. }) = Ask::parse(Method::AddScan, Body::Whole(&body), false, false) else {
                panic!("a scan")
            };
            let depth = load::depth(&at("d.png"), None, &pose, Some(camera), planning::NoReturn::Unknown);
            let cloud = load::cloud_from(&at("c.xyz"), None, &pose);
            for loaded in [*scan, depth.expect("a scan"), cloud.expect("a scan")] {
                let notes = loaded.reading.notes;
                assert_eq!(notes.iter().any(|note| note.contains("off a rotation by 5.0e-2")), told, "{notes:?}");
            }
        }
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
        let (pose, _) = read_pose("--pose", "1,2,3,0,0,0,1").expect("numbers");
        assert_eq!(pose, Isometry3::translation(1.0, 2.0, 3.0), "translation and quaternion");
        let told = |text: &str| format!("{:#}", read_pose("--flange-from-camera", text).expect_err(text));
        let long = told("1,2,3,0,0,0,2");
        assert_eq!(long, "--flange-from-camera 1,2,3,0,0,0,2: a quaternion of length 2, not 1");
        assert!(told("nowhere.json").starts_with("--flange-from-camera nowhere.json: neither"), "of the flag");
    }
}
