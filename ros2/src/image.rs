//! A depth `Image` with its `CameraInfo` as a request: the image as it is (NPY), its camera, its distortion and its pose.

use crate::MessageError;
use crate::messages::{CameraInfo, Image};
use crate::planner::{MadeOf, ScanRequest};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use formats::camera::check_intrinsics;
use geometry::Lens;
use nalgebra::Isometry3;
use serde_json::json;

const IMAGE: &str = "Image";
const INFO: &str = "CameraInfo";

/// The request that adds this depth image, taken by a camera at `base_from_camera` (an optical frame: +X right, +Y down, +Z
/// forward). `rectified`: the image was undistorted already, and `CameraInfo.p` is its camera.
///
/// # Errors
/// What is wrong with one of the messages, by the name of the field.
pub fn request(
    image: &Image,
    info: &CameraInfo,
    base_from_camera: &Isometry3<f64>,
    rectified: bool,
) -> Result<ScanRequest, MessageError> {
    let (npy, returns, metres_per_unit) = npy(image)?;
    let Camera { intrinsics, lens } = camera(image, info, rectified)?;
    let quaternion = base_from_camera.rotation.quaternion();
    let body = json!({ "depth": {
        "npy_base64": STANDARD.encode(npy),
        "metres_per_unit": metres_per_unit,
        "intrinsics": intrinsics,
        "distortion": { "model": lens.name(), "coefficients": lens.coefficients() },
        "quaternion_xyzw": [quaternion.i, quaternion.j, quaternion.k, quaternion.w],
        "translation_m": <[f64; 3]>::from(base_from_camera.translation.vector),
    }});
    let without = (image.width as usize * image.height as usize).saturating_sub(returns);
    let made_of = MadeOf { kind: "depth image", returns, without, notes: Vec::new() };
    Ok(ScanRequest { body: body.to_string().into_bytes(), made_of })
}

/// The image as an NPY file, its pixels with a return, and the metres of a step.
fn npy(image: &Image) -> Result<(Vec<u8>, usize, f64), MessageError> {
    let wrong = |place: &str, found: String, expected| Err(MessageError::new(IMAGE, place, found, expected));
    // By REP 118, the millimetres of integers and the metres of floats.
    let (kind, size, metres) = match image.encoding.as_str() {
        "16UC1" | "mono16" => ("<u2", 2, 0.001),
        "32FC1" => ("<f4", 4, 1.0),
        _ => return wrong("encoding", format!("{:?}", image.encoding), "depth: 16UC1 (millimetres) or 32FC1 (metres)"),
    };
    if image.is_bigendian != 0 {
        return wrong("is_bigendian", image.is_bigendian.to_string(), "0: little-endian pixels");
    }
    let [width, height, step] = [image.width, image.height, image.step].map(|n| n as usize);
    if width == 0 || height == 0 {
        return wrong("width and height", format!("{width} x {height}"), "at least one pixel");
    }
    let row = width.saturating_mul(size);
    if step < row {
        return wrong("step", format!("{step} bytes for {width} pixels of {size}"), "width times their bytes, or more");
    }
    if image.data.0.len() < step.saturating_mul(height - 1).saturating_add(row) {
        let found = format!("{} bytes for {height} rows of {step}", image.data.0.len());
        return wrong("data", found, "step times height");
    }
    // The head and its line feed fill a multiple of 64 bytes.
    let mut dictionary =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({height}, {width}), }}").into_bytes();
    dictionary.resize((dictionary.len() + 11).next_multiple_of(64) - 11, b' ');
    dictionary.push(b'\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(dictionary.len() as u16).to_le_bytes());
    bytes.extend_from_slice(&dictionary);
    let mut returns = 0;
    for row in image.data.0.chunks(step).take(height).map(|r| &r[..row]) {
        returns += row.chunks_exact(size).filter(|pixel| is_return(pixel)).count();
        bytes.extend_from_slice(row);
    }
    Ok((bytes, returns, metres))
}

fn is_return(pixel: &[u8]) -> bool {
    match *pixel {
        [a, b] => !matches!(u16::from_le_bytes([a, b]), 0 | u16::MAX),
        [a, b, c, d] => {
            let metres = f32::from_le_bytes([a, b, c, d]);
            metres.is_finite() && metres > 0.0
        }
        _ => false,
    }
}

struct Camera {
    intrinsics: [f64; 4],
    lens: Lens,
}

fn camera(image: &Image, info: &CameraInfo, rectified: bool) -> Result<Camera, MessageError> {
    let wrong = |place: &str, found: String, expected| Err(MessageError::new(INFO, place, found, expected));
    if info.header.frame_id != image.header.frame_id {
        let found = format!("{:?}, and the image's is {:?}", info.header.frame_id, image.header.frame_id);
        return wrong("header.frame_id", found, "that of the image");
    }
    let (k, p) = (info.k, info.p);
    let (name, [fx, skew, cx, a, fy, cy, b, c]) = match rectified {
        false => ("k", [k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7]]),
        true => ("p", [p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9]]),
    };
    let [fx, fy, cx, cy] = check_intrinsics([fx, fy, cx, cy])
        .map_err(|found| MessageError::new(INFO, name, found, "a calibrated camera: fx and fy positive"))?;
    if [a, b, c] != [0.0; 3] {
        let found = format!("{a}, {b}, {c} to the left of its diagonal");
        return wrong(name, found, "fx, 0, cx, 0, fy, cy and so on, row by row");
    }
    if skew.abs() > 1e-6 * fx {
        return wrong(name, format!("a skew of {skew}"), "no skew");
    }
    // What is calibrated is the full image; the message may be of a part of it, its pixels joined.
    let roi = &info.roi;
    let whole = roi.width == 0 && roi.height == 0;
    let [left, top] = [roi.x_offset, roi.y_offset].map(f64::from);
    let [columns, rows] = if whole { [info.width, info.height] } else { [roi.width, roi.height] };
    let [join_x, join_y] = [info.binning_x, info.binning_y].map(|n| n.max(1));
    if [columns / join_x, rows / join_y] != [image.width, image.height] {
        let found = format!(
            "{columns} x {rows} pixels joined by {join_x} x {join_y}, and the image has {} x {}",
            image.width, image.height
        );
        return wrong("width, height, roi and binning", found, "those of the image");
    }
    let [bx, by] = [join_x, join_y].map(f64::from);
    // As image_geometry does it.
    let intrinsics = [fx / bx, fy / by, (cx - left) / bx, (cy - top) / by];
    let none = info.distortion_model.is_empty() && info.d.iter().all(|k| *k == 0.0);
    let lens = match rectified || none {
        true => Ok(Lens::Pinhole),
        false => Lens::named(&info.distortion_model, &info.d),
    };
    match lens {
        Ok(lens) => Ok(Camera { intrinsics, lens }),
        Err(found) => wrong("distortion_model and d", found, "plumb_bob, rational_polynomial or equidistant"),
    }
}

#[cfg(test)]
mod tests;
