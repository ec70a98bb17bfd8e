//! Files of poses beside a sequence, one of them for each scan.

use super::DescribedScan;
use crate::poses::{FilePose, read_poses};
use crate::{FormatError, Place};
use std::path::Path;

/// The pose of each scan's camera: by the name of its file where the poses have names that fit, else in their order.
pub(super) fn of_cameras(path: &Path, scans: &[DescribedScan]) -> Result<Vec<FilePose>, FormatError> {
    let file = read_poses(path)?;
    if file.of_scans {
        let expected = "camera poses; for poses of scans use placed_by";
        return Err(FormatError::syntax(path, Place::File, "places of range images", expected));
    }
    let named: Option<Vec<&FilePose>> = scans.iter().map(|scan| named(&file.poses, scan)).collect();
    match named {
        Some(poses) => Ok(poses.into_iter().cloned().collect()),
        None if file.poses.len() == scans.len() => Ok(file.poses),
        None => {
            let found = format!("{} poses", file.poses.len());
            Err(FormatError::syntax(path, Place::File, found, format!("{}, one for each scan", scans.len())))
        }
    }
}

/// Where the frame of each scan lies.
pub(super) fn of_scans(path: &Path, scans: &[DescribedScan]) -> Result<Vec<FilePose>, FormatError> {
    let file = read_poses(path)?;
    let place = |scan: &DescribedScan| {
        let missing =
            || FormatError::syntax(path, Place::File, format!("no line of {}", scan.cloud), "one for each scan");
        named(&file.poses, scan).cloned().ok_or_else(missing)
    };
    scans.iter().map(place).collect()
}

/// The one pose that is called like a scan's cloud or image, with or without its ending.
fn named<'a>(poses: &'a [FilePose], scan: &DescribedScan) -> Option<&'a FilePose> {
    let files = [Some(&scan.cloud), scan.depth.as_ref()];
    let names = files.into_iter().flatten().map(Path::new).flat_map(|file| [file.file_name(), file.file_stem()]);
    names.flatten().find_map(|name| {
        let mut fitting = poses.iter().filter(|p| p.name.as_deref().is_some_and(|n| Path::new(n).as_os_str() == name));
        fitting.next().filter(|_| fitting.next().is_none())
    })
}
