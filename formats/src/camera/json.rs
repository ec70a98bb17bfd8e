//! RealSense's intrinsics (`rs2_intrinsics` as its tools and wrappers write them) and Open3D's `PinholeCameraIntrinsic`.

use super::{CameraFile, EXPECTED, lens, of_matrix, size};
use crate::{FormatError, Place};
use serde_json::Value;
use std::path::Path;

pub(super) fn parse(path: &Path, text: &str) -> Result<CameraFile, FormatError> {
    let value = crate::json::value(text)
        .map_err(|e| FormatError::syntax(path, Place::Line(e.line()), e.to_string(), EXPECTED))?;
    // Some tools put it one level down.
    let value = match value.get("intrinsics") {
        Some(inner @ Value::Object(_)) => inner,
        _ => &value,
    };
    let number = |key: &str| value.get(key).and_then(Value::as_f64);
    let size = size(path, number("width"), number("height"))?;
    let list = |key: &str| -> Result<Option<Vec<f64>>, FormatError> {
        let Some(value) = value.get(key) else { return Ok(None) };
        let numbers = value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
        let wrong = || FormatError::syntax(path, Place::Part(key.to_owned()), value.to_string(), "a list of numbers");
        numbers.map(Some).ok_or_else(wrong)
    };
    if let Some(matrix) = list("intrinsic_matrix")? {
        // Open3D stores it column by column.
        let rows: Vec<f64> = match matrix.len() {
            9 => (0..9).map(|i| matrix[i % 3 * 3 + i / 3]).collect(),
            _ => matrix,
        };
        return Ok(CameraFile { size, intrinsics: of_matrix(path, &rows)?, lens: lens(path, "none", &[])? });
    }
    let first = |keys: [&str; 2]| keys.iter().find_map(|key| number(key));
    let (Some(fx), Some(fy), Some(cx), Some(cy)) =
        (number("fx"), number("fy"), first(["ppx", "cx"]), first(["ppy", "cy"]))
    else {
        return Err(FormatError::syntax(path, Place::File, "JSON without fx, fy, ppx, ppy", EXPECTED));
    };
    let coefficients = match list("coeffs")? {
        Some(list) => list,
        None => list("distortion_coefficients")?.unwrap_or_default(),
    };
    let named = value.get("model").or_else(|| value.get("distortion_model"));
    let model = match named {
        None if coefficients.iter().all(|k| *k == 0.0) => "none".to_owned(),
        None => {
            let found = "coefficients without a model";
            return Err(FormatError::syntax(
                path,
                Place::Part("model".into()),
                found,
                "its name, such as brown_conrady",
            ));
        }
        Some(Value::String(name)) => {
            let name = name.to_ascii_lowercase().replace([' ', '-'], "_");
            name.trim_start_matches("rs2_distortion_").trim_start_matches("distortion.").to_owned()
        }
        Some(other) => {
            return Err(FormatError::syntax(path, Place::Part("model".into()), other.to_string(), "its name"));
        }
    };
    // RealSense names one of several formulas; without coefficients they are the same.
    let all_zero = coefficients.iter().all(|k| *k == 0.0);
    let model = match model.as_str() {
        "modified_brown_conrady" | "inverse_brown_conrady" | "f_theta" | "ftheta" if all_zero => "none",
        name => name,
    };
    Ok(CameraFile { size, intrinsics: [fx, fy, cx, cy], lens: lens(path, model, &coefficients)? })
}
