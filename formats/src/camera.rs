//! Calibrations of cameras as ROS, OpenCV, RealSense, Kalibr, Open3D and BOP write them, told apart by what stands in the file
//! (docs/formats.md, 'Cameras').

mod json;
mod yaml;

pub use geometry::camera::{INTRINSICS, check_intrinsics};

use crate::{FormatError, Place};
use geometry::Lens;
use std::path::Path;

/// A calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// Columns and rows of the image that it was calibrated for, where the file says so.
    pub size: Option<[u32; 2]>,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// Its distortion.
    pub lens: Lens,
    /// Metres per unit of its depth images where the file says so (BOP's `depth_scale`).
    pub metres_per_unit: Option<f64>,
}

const EXPECTED: &str = "a calibration: ROS CameraInfo (YAML), OpenCV FileStorage (YAML), Kalibr's camchain (YAML), RealSense's, \
                        Open3D's or BOP's intrinsics (JSON)";

/// Keys that the coefficients of a lens stand under.
const COEFFICIENTS: [&str; 9] = [
    "coeffs",
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distortion_coeffs",
    "distortion",
    "dist_coeffs",
    "dist_coeff",
    "distCoeffs",
    "dist",
];

/// Reads a calibration; `FILE:NAME` takes one camera of several (Kalibr's `cam1`).
///
/// # Errors
/// A file that cannot be read, of none of the formats, of several cameras without a name, or with a model that is not known here.
pub fn read_camera(file: &str) -> Result<CameraFile, FormatError> {
    let (path, name) = match file.rsplit_once(':') {
        Some((path, name)) if !Path::new(file).exists() => (Path::new(path), Some(name)),
        _ => (Path::new(file), None),
    };
    parse_camera(path, &crate::file::read(path)?, name)
}

/// [`read_camera`] on bytes at hand; `path` stands in the errors.
///
/// # Errors
/// As [`read_camera`].
pub fn parse_camera(path: &Path, bytes: &[u8], name: Option<&str>) -> Result<CameraFile, FormatError> {
    let text = crate::text::decode(bytes);
    let text = text.trim_start();
    if text.starts_with('<') {
        return Err(FormatError::syntax(path, Place::File, "XML", "OpenCV's FileStorage as YAML: write it to a .yml"));
    }
    let camera = if text.starts_with('{') { json::parse(path, text)? } else { yaml::parse(path, text, name)? };
    check_intrinsics(camera.intrinsics)
        .map_err(|found| FormatError::syntax(path, Place::Part(MATRIX.to_owned()), found, INTRINSICS))?;
    Ok(camera)
}

/// What the place of a camera matrix is called, where a file has only one.
const MATRIX: &str = "camera matrix";

/// fx, fy, cx, cy of a 3 x 3 matrix, row by row, which stands at `place`.
pub(crate) fn of_matrix(path: &Path, place: Place, k: &[f64]) -> Result<[f64; 4], FormatError> {
    let wrong = |found: String, expected: &str| Err(FormatError::syntax(path, place, found, expected));
    let &[fx, skew, cx, a, fy, cy, b, c, one] = k else {
        return wrong(format!("{} numbers", k.len()), "3 x 3, row by row");
    };
    if a != 0.0 || b != 0.0 || c != 0.0 || one != 1.0 {
        return wrong(format!("camera matrix {k:?}"), "[fx 0 cx; 0 fy cy; 0 0 1], row by row");
    }
    if skew.abs() > 1e-6 * fx.abs() {
        return wrong(format!("a skew of {skew}"), "no skew");
    }
    check_intrinsics([fx, fy, cx, cy]).or_else(|found| wrong(found, INTRINSICS))
}

/// A 3 x 3 matrix row by row, given column by column as Open3D stores it.
pub(crate) fn by_columns(k: &[f64; 9]) -> [f64; 9] {
    std::array::from_fn(|i| k[i % 3 * 3 + i / 3])
}

/// A model of distortion by its name.
fn lens(path: &Path, model: &str, coefficients: &[f64]) -> Result<Lens, FormatError> {
    let wrong = |found: String| FormatError::syntax(path, Place::Part("distortion".into()), found, "a lens known here");
    Lens::named(model, coefficients).map_err(wrong)
}

/// Whether a key seems to name coefficients of a lens, rather than its model or a distance.
fn may_be_coefficients(key: &str) -> bool {
    let key = key.to_ascii_lowercase();
    let other = ["model", "type", "distance"].iter().any(|word| key.contains(word));
    (key.contains("dist") || key.contains("coef")) && !other
}

/// Coefficients that would be left out.
fn unknown_coefficients(path: &Path, key: &str) -> FormatError {
    let expected = format!("one of the keys {}, beside the camera matrix or fx", COEFFICIENTS.join(", "));
    FormatError::syntax(
        path,
        Place::Part(key.to_owned()),
        "coefficients of a lens under a key not known here",
        expected,
    )
}

/// The image's size, both or none.
pub(crate) fn size(path: &Path, width: Option<f64>, height: Option<f64>) -> Result<Option<[u32; 2]>, FormatError> {
    let (Some(width), Some(height)) = (width, height) else { return Ok(None) };
    let whole = |x: f64| (x.fract() == 0.0 && (1.0..=16_384.0).contains(&x)).then_some(x as u32);
    match (whole(width), whole(height)) {
        (Some(width), Some(height)) => Ok(Some([width, height])),
        _ => {
            let found = format!("{width} x {height}");
            Err(FormatError::syntax(path, Place::Part("image size".into()), found, "1 to 16,384 pixels each"))
        }
    }
}

#[cfg(test)]
mod tests;
