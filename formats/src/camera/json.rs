//! RealSense's intrinsics (`rs2_intrinsics` as its tools and wrappers write them), Open3D's `PinholeCameraIntrinsic` and BOP's
//! `camera.json`.

use super::{
    COEFFICIENTS, CameraFile, EXPECTED, MATRIX, by_columns, lens, may_be_coefficients, of_matrix, size,
    unknown_coefficients,
};
use crate::{FormatError, Place};
use geometry::Lens;
use serde_json::Value;
use std::path::Path;

/// All that BOP's file has. In others a `depth_scale` is another: RealSense's metres per unit, Open3D's units per metre.
const BOP: [&str; 7] = ["cx", "cy", "depth_scale", "fx", "fy", "height", "width"];

pub(super) fn parse(path: &Path, text: &str) -> Result<CameraFile, FormatError> {
    let whole = crate::json::value(text)
        .map_err(|e| FormatError::syntax(path, Place::Line(e.line()), e.to_string(), EXPECTED))?;
    // Some tools put it one level down.
    let value = match whole.get("intrinsics") {
        Some(inner @ Value::Object(_)) => inner,
        _ => &whole,
    };
    let number = |key: &str| value.get(key).and_then(Value::as_f64);
    let size = size(path, number("width"), number("height"))?;
    let lens = lens_of(path, value, &whole)?;
    if let Some(matrix) = list(path, value, "intrinsic_matrix")? {
        let rows = <[f64; 9]>::try_from(matrix).map_or_else(|other| other, |k| by_columns(&k).to_vec());
        let intrinsics = of_matrix(path, Place::Part(MATRIX.to_owned()), &rows)?;
        return Ok(CameraFile { size, intrinsics, lens, metres_per_unit: None });
    }
    let first = |keys: [&str; 2]| keys.iter().find_map(|key| number(key));
    let (Some(fx), Some(fy), Some(cx), Some(cy)) =
        (number("fx"), number("fy"), first(["ppx", "cx"]), first(["ppy", "cy"]))
    else {
        return Err(FormatError::syntax(path, Place::File, "JSON without fx, fy, ppx, ppy", EXPECTED));
    };
    Ok(CameraFile { size, intrinsics: [fx, fy, cx, cy], lens, metres_per_unit: bop_unit(path, value)? })
}

fn list(path: &Path, of: &Value, key: &str) -> Result<Option<Vec<f64>>, FormatError> {
    let Some(value) = of.get(key) else { return Ok(None) };
    let numbers = value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
    let wrong = || FormatError::syntax(path, Place::Part(key.to_owned()), value.to_string(), "a list of numbers");
    numbers.map(Some).ok_or_else(wrong)
}

/// Metres per unit of depth, where the file is BOP's.
fn bop_unit(path: &Path, of: &Value) -> Result<Option<f64>, FormatError> {
    let is_bop = of.as_object().is_some_and(|map| map.keys().all(|key| BOP.contains(&key.as_str())));
    let scale = of.get("depth_scale").filter(|_| is_bop);
    scale.map(|scale| crate::depth::bop_unit(path, Place::File, scale.as_f64().unwrap_or(f64::NAN))).transpose()
}

/// The lens of the camera `of`, which stands in `whole`.
fn lens_of(path: &Path, of: &Value, whole: &Value) -> Result<Lens, FormatError> {
    let named = model(path, of)?;
    let fisheye = named.as_deref().is_some_and(|name| matches!(Lens::named(name, &[]), Ok(Lens::Fisheye(_))));
    let is_listed = |key: &&&str| of.get(**key).is_some_and(|value| !value.is_null() && !value.is_string());
    let by_letter = ["D", "d"].into_iter().find(|key| of.get(key).is_some_and(Value::is_array));
    let coefficients = match COEFFICIENTS.iter().find(is_listed).copied().or(by_letter) {
        Some(key) => list(path, of, key)?.unwrap_or_default(),
        None => match one_by_one(of, fisheye) {
            Some(coefficients) => coefficients,
            None => none_unknown(path, [of, whole])?,
        },
    };
    let all_zero = coefficients.iter().all(|k| *k == 0.0);
    let model = match named.as_deref() {
        None if all_zero => "none",
        // Only this model has them.
        None if of.get("p1").is_some() && of.get("p2").is_some() => "brown_conrady",
        None => {
            let found = "coefficients without a model";
            return Err(FormatError::syntax(
                path,
                Place::Part("model".into()),
                found,
                "its name, such as brown_conrady",
            ));
        }
        // RealSense names one of several formulas; without coefficients they are the same.
        Some("modified_brown_conrady" | "inverse_brown_conrady" | "f_theta" | "ftheta") if all_zero => "none",
        Some(name) => name,
    };
    lens(path, model, &coefficients)
}

/// The name of the lens's model, as ROS writes it.
fn model(path: &Path, of: &Value) -> Result<Option<String>, FormatError> {
    match of.get("model").or_else(|| of.get("distortion_model")) {
        None => Ok(None),
        Some(Value::String(name)) => {
            let name = name.to_ascii_lowercase().replace([' ', '-'], "_");
            Ok(Some(name.trim_start_matches("rs2_distortion_").trim_start_matches("distortion.").to_owned()))
        }
        Some(other) => Err(FormatError::syntax(path, Place::Part("model".into()), other.to_string(), "its name")),
    }
}

/// Coefficients that each have a key, in the order of the model; `None` where there are none.
fn one_by_one(of: &Value, fisheye: bool) -> Option<Vec<f64>> {
    let keys = match fisheye {
        true => ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"],
        false => ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
    };
    let values = keys.map(|key| of.get(key).and_then(Value::as_f64));
    values.iter().any(Option::is_some).then(|| values.map(Option::unwrap_or_default).to_vec())
}

/// No coefficients, where no other key of these objects seems to have any.
fn none_unknown(path: &Path, objects: [&Value; 2]) -> Result<Vec<f64>, FormatError> {
    let mut entries = objects.into_iter().filter_map(Value::as_object).flatten();
    let may_be = |key: &str, value: &Value| may_be_coefficients(key) || (matches!(key, "D" | "d") && value.is_array());
    match entries.find(|(key, value)| may_be(key, value) && does_something(value)) {
        Some((key, _)) => Err(unknown_coefficients(path, key)),
        None => Ok(Vec::new()),
    }
}

/// Whether a number other than zero is in it.
fn does_something(value: &Value) -> bool {
    match value {
        Value::Array(list) => list.iter().any(does_something),
        Value::Object(map) => map.values().any(does_something),
        other => other.as_f64().is_some_and(|k| k != 0.0),
    }
}
