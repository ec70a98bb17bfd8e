//! Files of poses beside a sequence, one of them for each scan.

use super::DescribedScan;
use crate::poses::{FilePose, read_poses};
use crate::{FormatError, Place};
use std::ffi::OsStr;
use std::path::Path;

/// The pose of each scan's camera: by the name of its file where the poses have names that fit, else in their order. `None`
/// for a scan that tells its own pose and is not named.
pub(super) fn of_cameras(path: &Path, scans: &[DescribedScan]) -> Result<Vec<Option<FilePose>>, FormatError> {
    let file = read_poses(path)?;
    if file.of_scans {
        let expected = "camera poses; for poses of scans use placed_by";
        return Err(FormatError::syntax(path, Place::File, "places of range images", expected));
    }
    let named: Vec<Option<FilePose>> = scans.iter().map(|scan| named(&file.poses, scan).cloned()).collect();
    if named.iter().all(Option::is_none) {
        return in_order(path, file.poses, scans.len());
    }
    let mut pairs = scans.iter().zip(&named);
    if let Some((scan, _)) = pairs.find(|(scan, pose)| pose.is_none() && scan.world_from_camera.is_none()) {
        let found = format!("no pose, or more than one, that is called like {}", scan.cloud);
        let expected = "a pose called like the cloud or the image of each scan, or of none: then their order counts";
        return Err(FormatError::syntax(path, Place::File, found, expected));
    }
    Ok(named)
}

fn in_order(path: &Path, poses: Vec<FilePose>, scans: usize) -> Result<Vec<Option<FilePose>>, FormatError> {
    if poses.len() != scans {
        let found = format!("{} poses", poses.len());
        return Err(FormatError::syntax(path, Place::File, found, format!("{scans}, one for each scan")));
    }
    Ok(poses.into_iter().map(Some).collect())
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

/// The one pose that is called like a scan's cloud or image.
fn named<'a>(poses: &'a [FilePose], scan: &DescribedScan) -> Option<&'a FilePose> {
    let files: Vec<&str> = [Some(&scan.cloud), scan.depth.as_ref()].into_iter().flatten().map(String::as_str).collect();
    called(poses, &files)
}

/// The one pose that is called like one of these files, by as much of both names as possible. `None` where none is, or
/// several are as much.
pub fn called<'a>(poses: &'a [FilePose], files: &[&str]) -> Option<&'a FilePose> {
    let apart = |pose: &FilePose| files.iter().filter_map(|file| left_out(file, pose.name.as_deref()?)).min();
    let fitting: Vec<_> = poses.iter().filter_map(|pose| Some((apart(pose)?, pose))).collect();
    let least = fitting.iter().map(|(apart, _)| *apart).min()?;
    let mut closest = fitting.into_iter().filter(|(apart, _)| *apart == least).map(|(_, pose)| pose);
    closest.next().filter(|_| closest.next().is_none())
}

/// How much has to be left out of two names until they are the same: endings first, then folders. `None`: they never are.
fn left_out(a: &str, b: &str) -> Option<usize> {
    let (a, b) = (shorter(a), shorter(b));
    let pairs = (0..a.len()).flat_map(|i| (0..b.len()).map(move |j| (i, j)));
    pairs.filter(|&(i, j)| same(a[i], b[j])).map(|(i, j)| i + j).min()
}

/// A name as written, without its ending, without its folders, and without either.
fn shorter(name: &str) -> [&str; 4] {
    let path = Path::new(name);
    let ending = path.extension().and_then(OsStr::to_str);
    let without_ending = ending.and_then(|ending| name.strip_suffix(ending)?.strip_suffix('.'));
    let [file, stem] = [path.file_name(), path.file_stem()].map(|part| part.and_then(OsStr::to_str));
    [name, without_ending.unwrap_or(name), file.unwrap_or(name), stem.unwrap_or(name)]
}

/// Numbers are the same with zeros before them: `7` of BOP is `000007.png`.
fn same(a: &str, b: &str) -> bool {
    a == b || digits(a).zip(digits(b)).is_some_and(|(a, b)| a == b)
}

fn digits(name: &str) -> Option<&str> {
    let number = !name.is_empty() && name.bytes().all(|b| b.is_ascii_digit());
    number.then(|| name.trim_start_matches('0'))
}
