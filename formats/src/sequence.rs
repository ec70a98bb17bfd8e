//! Recorded scans of one object with the camera of each: a folder with `sequence.json` (docs/formats.md).

mod poses;
mod scan;

pub use poses::called;

use crate::{FormatError, Place};
use geometry::{DepthImage, PinholeCamera, View};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::Deserialize;
use std::path::Path;

/// Name of the file that describes a sequence.
pub const SEQUENCE: &str = "sequence.json";

/// Recorded scans, as they were read.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Image-up as close to this as possible, where a pose is only known by its position.
    pub up: Vector3<f64>,
    /// Distance from target to camera, metres.
    pub working_distance_m: f64,
    /// Distance under which two points are the same surface, metres; absent: the user's setting.
    pub tolerance_m: Option<f64>,
    /// The object is in this box, metres.
    pub region_m: Option<[[f64; 3]; 2]>,
    /// Whether pixels without a return show what is behind the object, rather than that it was cut out.
    pub background: Option<bool>,
    /// The scans, in the order recorded.
    pub scans: Vec<SequenceScan>,
}

/// One recorded scan.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceScan {
    /// What it measured of the object, world frame, metres.
    pub points: Vec<Point3<f64>>,
    /// Its camera.
    pub world_from_camera: Isometry3<f64>,
    /// The image that it comes from.
    pub image: Option<(PinholeCamera, DepthImage)>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    #[serde(default, rename = "object")]
    _object: Option<String>,
    #[serde(default = "z")]
    up: [f64; 3],
    working_distance_m: f64,
    tolerance_m: Option<f64>,
    region_m: Option<[[f64; 3]; 2]>,
    background: Option<bool>,
    /// Of the depth images; absent: as the file of poses says, or [`crate::depth::read_depth`] tells them apart.
    depth_unit_m: Option<f64>,
    /// Poses of the cameras of scans that tell none themselves.
    poses: Option<String>,
    /// Where the frame of each cloud lies: Stanford's `.conf`.
    placed_by: Option<String>,
    /// Where the camera stood in the frame of every cloud that is placed.
    camera_in_scan_m: Option<[f64; 3]>,
    scans: Vec<DescribedScan>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DescribedScan {
    cloud: String,
    #[serde(default, rename = "recorded")]
    _recorded: Option<String>,
    camera_position_m: Option<[f64; 3]>,
    world_from_camera: Option<[[f64; 4]; 4]>,
    depth: Option<String>,
    intrinsics: Option<[f64; 4]>,
}

fn z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

/// Rotations are off by more than rounding.
const NOT_ROUNDING: f64 = 1e-3;

/// Reads a sequence by its file `sequence.json`; the clouds and images that it names lie beside it. What a user should know of
/// how these were read is logged as a warning.
///
/// # Errors
/// A file that cannot be read; fewer than two scans; a scan without a camera, or with one that did not take it.
pub fn read_sequence(path: &Path) -> Result<Sequence, FormatError> {
    let (sequence, notes) = read_with_notes(path)?;
    notes.iter().for_each(|note| tracing::warn!("{path:?}: {note}"));
    Ok(sequence)
}

/// [`read_sequence`], with what it has to say.
fn read_with_notes(path: &Path) -> Result<(Sequence, Vec<String>), FormatError> {
    let bytes = crate::file::read(path)?;
    let described: Described = serde_json::from_str(&crate::text::decode(&bytes)).map_err(|e| {
        let expected = "working_distance_m and scans, each with cloud, and camera_position_m or world_from_camera";
        FormatError::syntax(path, Place::Line(e.line()), e.to_string(), expected)
    })?;
    check(path, &described)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let in_folder = |file: &Option<String>| file.as_ref().map(|file| folder.join(file));
    let poses = in_folder(&described.poses).map(|file| poses::of_cameras(&file, &described.scans)).transpose()?;
    let places = in_folder(&described.placed_by).map(|file| poses::of_scans(&file, &described.scans)).transpose()?;
    let reader = scan::Reader { path, folder, described: &described, poses, places };
    let mut raw = (0..described.scans.len()).map(|index| reader.read(index)).collect::<Result<Vec<_>, _>>()?;
    let mut notes: Vec<String> = raw.iter_mut().flat_map(|scan| std::mem::take(&mut scan.notes)).collect();
    notes.extend(off_rotations(&raw));
    let up = Vector3::from(described.up);
    let middle = middle(raw.iter().map(|scan| &scan.points[..]));
    let scans = raw.into_iter().map(|scan| SequenceScan {
        points: scan.points,
        world_from_camera: match scan.camera {
            scan::Camera::Posed(pose) => pose,
            // Known by its position alone: it looks at the middle of the object.
            scan::Camera::At(position) => View { target: middle, position }.world_from_camera_with_up(&up),
        },
        image: scan.image,
    });
    let sequence = Sequence {
        up,
        working_distance_m: described.working_distance_m,
        tolerance_m: described.tolerance_m,
        region_m: described.region_m,
        background: described.background,
        scans: scans.collect(),
    };
    Ok((sequence, notes))
}

/// What is said of poses whose rotations are none.
fn off_rotations(raw: &[scan::Raw]) -> Option<String> {
    let (index, worst) = raw.iter().enumerate().max_by(|(_, a), (_, b)| a.off.total_cmp(&b.off))?;
    (worst.off > NOT_ROUNDING).then(|| {
        format!(
            "poses deviate from rotations by up to {:.1e} (scan {index}); the nearest rotations are used",
            worst.off
        )
    })
}

/// What holds whatever the scans are.
fn check(path: &Path, described: &Described) -> Result<(), FormatError> {
    let wrong = |part: &str, found: String, expected: &str| {
        Err(FormatError::syntax(path, Place::Part(part.to_owned()), found, expected))
    };
    let up = Vector3::from(described.up);
    if !(up.norm() > 1e-9 && up.iter().all(|x| x.is_finite())) {
        return wrong("up", format!("{:?}", described.up), "a direction");
    }
    for (key, value) in [
        ("working_distance_m", Some(described.working_distance_m)),
        ("tolerance_m", described.tolerance_m),
        ("depth_unit_m", described.depth_unit_m),
    ] {
        if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return wrong(key, value.to_string(), "a positive number");
        }
    }
    if let Some([low, high]) = described
        .region_m
        .filter(|[low, high]| (0..3).any(|k| low[k].partial_cmp(&high[k]) != Some(std::cmp::Ordering::Less)))
    {
        return wrong("region_m", format!("{:?}", [low, high]), "smallest and largest corner");
    }
    if described.scans.len() < 2 {
        let found = format!("{} scans", described.scans.len());
        return wrong("scans", found, "at least 2: with fewer there is nothing to choose from");
    }
    Ok(())
}

/// The middle of the box around all points.
fn middle<'a>(scans: impl Iterator<Item = &'a [Point3<f64>]>) -> Point3<f64> {
    let (low, high) = scans.flatten().fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
    });
    nalgebra::center(&Point3::from(low), &Point3::from(high))
}

#[cfg(test)]
mod tests;
