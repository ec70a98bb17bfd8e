//! ROS `CameraInfo` (a calibration file, or a message as `ros2 topic echo` prints it), OpenCV's FileStorage and Kalibr's camchain.

use super::{CameraFile, EXPECTED, lens, of_matrix, size};
use crate::{FormatError, Place};
use std::path::Path;
use yaml_rust2::{Yaml, YamlLoader};

pub(super) fn parse(path: &Path, text: &str, name: Option<&str>) -> Result<CameraFile, FormatError> {
    // OpenCV's first line is no directive of YAML, and its tags are known to it alone.
    let text: String = text.lines().filter(|line| !line.starts_with("%YAML")).flat_map(|line| [line, "\n"]).collect();
    check_shape(path, &text)?;
    let documents = YamlLoader::load_from_str(&text.replace("!!opencv-matrix", ""))
        .map_err(|e| FormatError::syntax(path, Place::Line(e.marker().line()), e.info().to_owned(), EXPECTED))?;
    let Some(root @ Yaml::Hash(entries)) = documents.first() else {
        return Err(FormatError::syntax(path, Place::File, "no keys with values", EXPECTED));
    };
    let cameras: Vec<(&str, &Yaml)> = entries
        .iter()
        .filter_map(|(key, value)| Some((key.as_str()?, value)))
        .filter(|(_, value)| !value["camera_model"].is_badvalue())
        .collect();
    let names = || cameras.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    match (&cameras[..], name) {
        ([], None) => flat(path, root),
        ([], Some(name)) => Err(FormatError::syntax(
            path,
            Place::File,
            format!("one camera without a name, asked for {name}"),
            "no :NAME",
        )),
        ([(_, camera)], None) => kalibr(path, camera),
        (_, None) => Err(FormatError::syntax(
            path,
            Place::File,
            format!("cameras {}", names()),
            "one of them by name, FILE:NAME",
        )),
        (_, Some(name)) => match cameras.iter().find(|(n, _)| *n == name) {
            Some((_, camera)) => kalibr(path, camera),
            None => {
                Err(FormatError::syntax(path, Place::File, format!("cameras {}", names()), format!("one named {name}")))
            }
        },
    }
}

/// What no calibration has and a reader of YAML drowns in: anchors that multiply, and nesting without end.
fn check_shape(path: &Path, text: &str) -> Result<(), FormatError> {
    const DEEPEST: usize = 100;
    let mut flow = 0usize;
    for (line, number) in text.lines().zip(1..) {
        let refuse = |found: &str| FormatError::syntax(path, Place::Line(number), found, EXPECTED);
        if line.contains('&') {
            return Err(refuse("an anchor (&)"));
        }
        let indented = line.len() - line.trim_start_matches([' ', '-', '?']).len();
        for c in line.chars() {
            match c {
                '[' | '{' => flow += 1,
                ']' | '}' => flow = flow.saturating_sub(1),
                _ => {}
            }
            if flow + indented > DEEPEST {
                return Err(refuse("too many levels in each other"));
            }
        }
    }
    Ok(())
}

/// A number, whole or not.
fn number(value: &Yaml) -> Option<f64> {
    match value {
        Yaml::Integer(i) => Some(*i as f64),
        Yaml::Real(text) => text.parse().ok(),
        _ => None,
    }
}

/// A list of numbers, also as `data` of a matrix.
fn list(path: &Path, key: &str, value: &Yaml) -> Result<Vec<f64>, FormatError> {
    let items = if value["data"].is_badvalue() { value } else { &value["data"] };
    let numbers = items.as_vec().and_then(|list| list.iter().map(number).collect::<Option<Vec<f64>>>());
    numbers.ok_or_else(|| FormatError::syntax(path, Place::Part(key.to_owned()), "no list of numbers", "one"))
}

/// The first of these keys that is there.
fn first<'a>(of: &'a Yaml, keys: &[&'static str]) -> Option<(&'static str, &'a Yaml)> {
    keys.iter().map(|key| (*key, &of[*key])).find(|(_, value)| !value.is_badvalue() && !value.is_null())
}

/// ROS and OpenCV: one camera, its keys at the top.
fn flat(path: &Path, root: &Yaml) -> Result<CameraFile, FormatError> {
    let Some((key, matrix)) = first(root, &["camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "k"]) else {
        return Err(FormatError::syntax(path, Place::File, "no camera matrix (camera_matrix, K)", EXPECTED));
    };
    let intrinsics = of_matrix(path, &list(path, key, matrix)?)?;
    let get = |keys: &[&'static str]| first(root, keys).and_then(|(_, value)| number(value));
    let size = size(path, get(&["image_width", "width"]), get(&["image_height", "height"]))?;
    let refuse = |key: &str, found: String| {
        FormatError::syntax(path, Place::Part(key.to_owned()), found, "the whole image, each pixel by itself")
    };
    for key in ["binning_x", "binning_y"] {
        if let Some(binned) = number(&root[key]).filter(|n| *n > 1.0) {
            return Err(refuse(key, format!("pixels joined by {binned}")));
        }
    }
    for key in ["x_offset", "y_offset"] {
        if let Some(offset) = number(&root["roi"][key]).filter(|n| *n != 0.0) {
            return Err(refuse("roi", format!("{key} of {offset}")));
        }
    }
    let keys =
        ["distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "distortion", "D", "d"];
    let coefficients = match first(root, &keys) {
        Some((key, value)) => list(path, key, value)?,
        None => Vec::new(),
    };
    let fisheye = ["fisheye_model", "fisheye"].iter().any(|key| number(&root[*key]).is_some_and(|n| n != 0.0));
    let model = match first(root, &["distortion_model", "camera_model"]) {
        Some((key, value)) => {
            let wrong = || FormatError::syntax(path, Place::Part(key.to_owned()), "no name", "such as plumb_bob");
            value.as_str().ok_or_else(wrong)?
        }
        None if fisheye => "fisheye",
        None => "brown_conrady",
    };
    // A message of a rectified image has an empty name and no coefficients.
    let model = if model.is_empty() && coefficients.iter().all(|k| *k == 0.0) { "none" } else { model };
    Ok(CameraFile { size, intrinsics, lens: lens(path, model, &coefficients)? })
}

/// One camera of a camchain.
fn kalibr(path: &Path, camera: &Yaml) -> Result<CameraFile, FormatError> {
    let text = |key: &str| camera[key].as_str().unwrap_or("none");
    if text("camera_model") != "pinhole" {
        let found = text("camera_model").to_owned();
        return Err(FormatError::syntax(path, Place::Part("camera_model".into()), found, "pinhole"));
    }
    let intrinsics = list(path, "intrinsics", &camera["intrinsics"])?;
    let count = intrinsics.len();
    let wrong =
        |_| FormatError::syntax(path, Place::Part("intrinsics".into()), format!("{count} numbers"), "fu, fv, pu, pv");
    let intrinsics = intrinsics.try_into().map_err(wrong)?;
    let resolution = match camera["resolution"].is_badvalue() {
        true => Vec::new(),
        false => list(path, "resolution", &camera["resolution"])?,
    };
    let size = size(path, resolution.first().copied(), resolution.get(1).copied())?;
    let coefficients = match camera["distortion_coeffs"].is_badvalue() {
        true => Vec::new(),
        false => list(path, "distortion_coeffs", &camera["distortion_coeffs"])?,
    };
    Ok(CameraFile { size, intrinsics, lens: lens(path, text("distortion_model"), &coefficients)? })
}
