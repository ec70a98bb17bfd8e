//! Poses in JSON: our own (`world_from_camera`), BOP's `scene_camera.json` and `scene_gt.json` (camera from world or model,
//! millimetres) and Open3D's `PinholeCameraTrajectory` (camera from world, column by column).

use super::{EXPECTED, FilePose, Given, ROWS, inverse, of_matrix, of_parts};
use crate::camera::{self, INTRINSICS, by_columns, check_intrinsics};
use crate::{FormatError, Place};
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::Path;

/// Metres per unit of BOP's positions.
const BOP_UNIT_M: f64 = 0.001;

const EXTRINSIC: Given = ["extrinsic", "a rigid motion, camera_from_world, 4 x 4, column by column, metres"];
const BOP_CAMERA: Given = ["cam_R_w2c", "a rotation, 3 x 3, row by row, and cam_t_w2c in millimetres"];
const BOP_TRUTH: Given = ["cam_R_m2c", "a rotation, 3 x 3, row by row, and cam_t_m2c in millimetres"];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Own {
    world_from_camera: [[f64; 4]; 4],
    intrinsics: Option<[f64; 4]>,
    #[serde(default)]
    name: Option<String>,
}

#[derive(Deserialize)]
struct BopCamera {
    #[serde(rename = "cam_K")]
    k: Option<[f64; 9]>,
    #[serde(rename = "cam_R_w2c")]
    r: [f64; 9],
    #[serde(rename = "cam_t_w2c")]
    t: [f64; 3],
    depth_scale: Option<f64>,
}

#[derive(Deserialize)]
struct BopTruth {
    #[serde(rename = "cam_R_m2c")]
    r: [f64; 9],
    #[serde(rename = "cam_t_m2c")]
    t: [f64; 3],
}

#[derive(Deserialize)]
struct Open3d {
    extrinsic: [f64; 16],
    intrinsic: Option<Open3dIntrinsic>,
}

#[derive(Deserialize)]
struct Open3dIntrinsic {
    intrinsic_matrix: [f64; 9],
    width: Option<f64>,
    height: Option<f64>,
}

impl Open3dIntrinsic {
    /// Columns and rows; Open3D writes -1 where it does not know them.
    fn size(&self, path: &Path) -> Result<Option<[u32; 2]>, FormatError> {
        let [width, height] = [self.width, self.height].map(|side| side.filter(|n| *n > 0.0));
        camera::size(path, width, height)
    }
}

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<FilePose>, FormatError> {
    let value = crate::json::value(text)
        .map_err(|e| FormatError::syntax(path, Place::Line(e.line()), e.to_string(), EXPECTED))?;
    match value {
        Value::Array(entries) if entries.first().is_some_and(|row| row.get(0).is_some_and(Value::is_number)) => {
            Ok(vec![own(path, Place::File, Value::Array(entries))?])
        }
        Value::Array(entries) => {
            let numbered = entries.into_iter().enumerate();
            numbered.map(|(i, entry)| own(path, Place::Part(format!("pose {i}")), entry)).collect()
        }
        Value::Object(mut map) => match map.remove("parameters") {
            Some(Value::Array(entries)) => {
                let numbered = entries.into_iter().enumerate();
                numbered.map(|(i, entry)| open3d(path, Place::Part(format!("parameters {i}")), entry)).collect()
            }
            Some(other) => {
                Err(FormatError::syntax(path, Place::Part("parameters".into()), other.to_string(), "a list"))
            }
            None if map.contains_key("extrinsic") => Ok(vec![open3d(path, Place::File, Value::Object(map))?]),
            None if map.contains_key("world_from_camera") => Ok(vec![own(path, Place::File, Value::Object(map))?]),
            None => bop(path, map),
        },
        other => Err(FormatError::syntax(path, Place::File, other.to_string(), EXPECTED)),
    }
}

/// `entry` as what it should be.
fn read<T: for<'a> Deserialize<'a>>(
    path: &Path,
    place: &Place,
    entry: Value,
    expected: &str,
) -> Result<T, FormatError> {
    serde_json::from_value(entry).map_err(|e| FormatError::syntax(path, place.clone(), e.to_string(), expected))
}

fn own(path: &Path, place: Place, entry: Value) -> Result<FilePose, FormatError> {
    const OWN: &str = "a 4 x 4 matrix, or {\"world_from_camera\": [[4 numbers] x 4], \"intrinsics\": [fx, fy, cx, cy]}";
    if entry.is_array() {
        return of_matrix(path, place.clone(), ROWS, &read(path, &place, entry, OWN)?);
    }
    let own: Own = read(path, &place, entry, OWN)?;
    let wrong = |found: String| FormatError::syntax(path, place.clone(), found, INTRINSICS);
    let intrinsics = own.intrinsics.map(check_intrinsics).transpose().map_err(wrong)?;
    Ok(FilePose { intrinsics, name: own.name, ..of_matrix(path, place, ROWS, &own.world_from_camera)? })
}

fn open3d(path: &Path, place: Place, entry: Value) -> Result<FilePose, FormatError> {
    let read: Open3d = read(path, &place, entry, "Open3D's camera: extrinsic, 16 numbers column by column")?;
    let e = read.extrinsic;
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| e[4 * column + row]));
    let size = read.intrinsic.as_ref().map_or(Ok(None), |i| i.size(path))?;
    // Open3D writes zeros where it does not know it.
    let matrix = read.intrinsic.map(|i| by_columns(&i.intrinsic_matrix)).filter(|k| *k != [0.0; 9]);
    let intrinsics = matrix.map(|k| camera::of_matrix(path, place.clone(), &k)).transpose()?;
    Ok(FilePose { intrinsics, size, ..inverse(of_matrix(path, place, EXTRINSIC, &rows)?) })
}

/// Images by their numbers, in the order of those.
fn bop(path: &Path, map: Map<String, Value>) -> Result<Vec<FilePose>, FormatError> {
    let numbered = map.into_iter().map(|(key, entry)| match key.trim().parse::<u64>() {
        Ok(number) => Ok((number, key, entry)),
        Err(_) => {
            Err(FormatError::syntax(path, Place::Part(format!("key {key:?}")), "no number of an image", EXPECTED))
        }
    });
    let mut images = numbered.collect::<Result<Vec<_>, _>>()?;
    images.sort_by_key(|(number, ..)| *number);
    let pose = |(_, key, entry): (u64, String, Value)| {
        let place = Place::Part(format!("image {key}"));
        let metres = |t: [f64; 3]| t.map(|x| BOP_UNIT_M * x);
        let pose = match entry {
            Value::Array(mut objects) => {
                if objects.len() != 1 {
                    let found = format!("{} objects", objects.len());
                    return Err(FormatError::syntax(path, place, found, "one object: poses of cameras around it"));
                }
                let expected = "BOP's cam_R_m2c (9 numbers) and cam_t_m2c (3, millimetres)";
                let truth: BopTruth = read(path, &place, objects.swap_remove(0), expected)?;
                of_parts(path, place, BOP_TRUTH, &truth.r, &metres(truth.t))?
            }
            entry => {
                let expected = "BOP's cam_R_w2c (9 numbers) and cam_t_w2c (3, millimetres); not every set has them, \
                                scene_gt.json has the object's pose instead";
                let camera: BopCamera = read(path, &place, entry, expected)?;
                let unit = |scale| crate::depth::bop_unit(path, place.clone(), scale);
                let matrix = |k: [f64; 9]| camera::of_matrix(path, place.clone(), &k);
                FilePose {
                    metres_per_unit: camera.depth_scale.map(unit).transpose()?,
                    intrinsics: camera.k.map(matrix).transpose()?,
                    ..of_parts(path, place.clone(), BOP_CAMERA, &camera.r, &metres(camera.t))?
                }
            }
        };
        Ok(FilePose { name: Some(key), ..inverse(pose) })
    };
    images.into_iter().map(pose).collect()
}
