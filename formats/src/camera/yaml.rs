//! ROS `CameraInfo` (a calibration file, or a message as `ros2 topic echo` prints it), OpenCV's FileStorage and Kalibr's camchain.

use super::{
    COEFFICIENTS, CameraFile, EXPECTED, MATRIX, lens, may_be_coefficients, of_matrix, size, unknown_coefficients,
};
use crate::yaml::{self, Yaml};
use crate::{FormatError, Place};
use std::path::Path;

pub(super) fn parse(path: &Path, text: &str, name: Option<&str>) -> Result<CameraFile, FormatError> {
    let root =
        yaml::parse(text).map_err(|(line, found)| FormatError::syntax(path, Place::Line(line), found, EXPECTED))?;
    let Yaml::Map(entries) = &root else {
        return Err(FormatError::syntax(path, Place::File, "no keys with values", EXPECTED));
    };
    let is_camera = |(_, value): &&(String, Yaml)| value.get("camera_model").is_some();
    let cameras: Vec<(&str, &Yaml)> =
        entries.iter().filter(is_camera).map(|(name, value)| (name.as_str(), value)).collect();
    let names = || cameras.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    let wrong = |found: String, expected: &str| Err(FormatError::syntax(path, Place::File, found, expected));
    match (&cameras[..], name) {
        ([], None) => flat(path, &root),
        ([], Some(name)) => wrong(format!("one camera without a name, asked for {name}"), "no :NAME"),
        ([(_, camera)], None) => kalibr(path, camera),
        (_, None) => wrong(format!("cameras {}", names()), "one of them by name, FILE:NAME"),
        (_, Some(name)) => match cameras.iter().find(|(n, _)| *n == name) {
            Some((_, camera)) => kalibr(path, camera),
            None => wrong(format!("cameras {}", names()), &format!("one named {name}")),
        },
    }
}

/// A list of numbers, also as `data` of a matrix or as a list of its rows.
fn list(path: &Path, key: &str, value: &Yaml) -> Result<Vec<f64>, FormatError> {
    fn flat(value: &Yaml) -> Option<Vec<f64>> {
        match value {
            Yaml::List(items) => items.iter().map(flat).collect::<Option<Vec<_>>>().map(|rows| rows.concat()),
            scalar => scalar.number().map(|number| vec![number]),
        }
    }
    let value = value.get("data").unwrap_or(value);
    let numbers = flat(value).filter(|_| matches!(value, Yaml::List(_)));
    numbers.ok_or_else(|| FormatError::syntax(path, Place::Part(key.to_owned()), "no list of numbers", "one"))
}

/// The first of these keys that is there.
fn first<'a>(of: &'a Yaml, keys: &[&'static str]) -> Option<(&'static str, &'a Yaml)> {
    let is_there = |value: &&Yaml| value.text() != Some("");
    keys.iter().find_map(|key| Some((*key, of.get(key).filter(is_there)?)))
}

/// The coefficients of a camera; none where no key names any.
fn coefficients(path: &Path, of: &Yaml) -> Result<Vec<f64>, FormatError> {
    if let Some((key, value)) = first(of, &COEFFICIENTS).or_else(|| first(of, &["D", "d"])) {
        return list(path, key, value);
    }
    let Yaml::Map(entries) = of else { return Ok(Vec::new()) };
    match entries.iter().find(|(key, value)| may_be_coefficients(key) && does_something(value)) {
        Some((key, _)) => Err(unknown_coefficients(path, key)),
        None => Ok(Vec::new()),
    }
}

/// Whether a number other than zero is in it.
fn does_something(value: &Yaml) -> bool {
    match value.get("data").unwrap_or(value) {
        text @ Yaml::Text(_) => text.number().is_some_and(|k| k != 0.0),
        Yaml::List(list) => list.iter().any(does_something),
        Yaml::Map(entries) => entries.iter().any(|(_, value)| does_something(value)),
    }
}

/// ROS and OpenCV: one camera, its keys at the top.
fn flat(path: &Path, root: &Yaml) -> Result<CameraFile, FormatError> {
    let Some((key, matrix)) = first(root, &["camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "k"]) else {
        return Err(FormatError::syntax(path, Place::File, "no camera matrix (camera_matrix, K)", EXPECTED));
    };
    let intrinsics = of_matrix(path, Place::Part(MATRIX.to_owned()), &list(path, key, matrix)?)?;
    let get = |keys: &[&'static str]| first(root, keys).and_then(|(_, value)| value.number());
    let size = size(path, get(&["image_width", "width"]), get(&["image_height", "height"]))?;
    let refuse = |key: &str, found: String| {
        FormatError::syntax(path, Place::Part(key.to_owned()), found, "the whole image, each pixel by itself")
    };
    for key in ["binning_x", "binning_y"] {
        if let Some(binned) = root.get(key).and_then(Yaml::number).filter(|n| *n > 1.0) {
            return Err(refuse(key, format!("pixels joined by {binned}")));
        }
    }
    for key in ["x_offset", "y_offset"] {
        if let Some(offset) = root.get("roi").and_then(|roi| roi.get(key)?.number()).filter(|n| *n != 0.0) {
            return Err(refuse("roi", format!("{key} of {offset}")));
        }
    }
    let coefficients = coefficients(path, root)?;
    let fisheye =
        ["fisheye_model", "fisheye"].iter().any(|key| root.get(key).and_then(Yaml::number).is_some_and(|n| n != 0.0));
    let model = match first(root, &["distortion_model", "distortion_type", "camera_model"]) {
        Some((key, value)) => {
            let wrong = || FormatError::syntax(path, Place::Part(key.to_owned()), "no name", "such as plumb_bob");
            value.text().ok_or_else(wrong)?
        }
        None if fisheye => "fisheye",
        None => "brown_conrady",
    };
    // A message of a rectified image has an empty name and no coefficients.
    let model = if model.is_empty() && coefficients.iter().all(|k| *k == 0.0) { "none" } else { model };
    Ok(CameraFile { size, intrinsics, lens: lens(path, model, &coefficients)?, metres_per_unit: None })
}

/// One camera of a camchain.
fn kalibr(path: &Path, camera: &Yaml) -> Result<CameraFile, FormatError> {
    let text = |key: &str| camera.get(key).and_then(Yaml::text).unwrap_or("none");
    let numbers = |key: &str| camera.get(key).map_or(Ok(Vec::new()), |value| list(path, key, value));
    if text("camera_model") != "pinhole" {
        let found = text("camera_model").to_owned();
        return Err(FormatError::syntax(path, Place::Part("camera_model".into()), found, "pinhole"));
    }
    let intrinsics = numbers("intrinsics")?;
    let count = intrinsics.len();
    let wrong =
        |_| FormatError::syntax(path, Place::Part("intrinsics".into()), format!("{count} numbers"), "fu, fv, pu, pv");
    let intrinsics = intrinsics.try_into().map_err(wrong)?;
    let resolution = numbers("resolution")?;
    let size = size(path, resolution.first().copied(), resolution.get(1).copied())?;
    let lens = lens(path, text("distortion_model"), &coefficients(path, camera)?)?;
    Ok(CameraFile { size, intrinsics, lens, metres_per_unit: None })
}
