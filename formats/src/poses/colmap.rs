//! COLMAP's `images.txt`: per image a line `ID qw qx qy qz tx ty tz CAMERA NAME`, camera from world, and one of its points,
//! which may be empty. COLMAP's lengths are metres only if the model was scaled to metres.

use super::{FilePose, inverse};
use crate::{FormatError, Place};
use planning::pose::from_quaternion;
use std::path::Path;

const EXPECTED: &str = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";

/// The numbers of an image's line, and its name.
fn image(line: &str) -> Option<([f64; 8], &str)> {
    let mut rest = line.trim();
    let mut values = [0.0; 8];
    for slot in 0..9 {
        let (word, after) = rest.split_once(char::is_whitespace)?;
        // The ninth is the camera's number, and not needed.
        let value = crate::text::number(word)?;
        if let Some(place) = values.get_mut(slot) {
            *place = value;
        }
        rest = after.trim_start();
    }
    Some((values, rest))
}

/// Whether a line begins an image of COLMAP, rather than being numbers alone.
pub(super) fn is_image(line: &str) -> bool {
    image(line).is_some_and(|(_, name)| super::numbers(name).is_none())
}

/// Whether a line holds points: X Y POINT3D_ID, again and again.
fn is_points(line: &str) -> bool {
    super::numbers(line).is_some_and(|values| values.len() % 3 == 0)
}

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<FilePose>, FormatError> {
    let mut poses = Vec::new();
    let mut lines = crate::text::lines(text).filter(|(_, line)| !line.trim_start().starts_with('#')).peekable();
    while let Some((number, line)) = lines.next() {
        if line.trim().is_empty() {
            continue;
        }
        let wrong = |found: String, expected: &str| FormatError::syntax(path, Place::Line(number), found, expected);
        let ([_, qw, qx, qy, qz, x, y, z], name) = image(line).ok_or_else(|| wrong(line.to_owned(), EXPECTED))?;
        let camera_from_world =
            from_quaternion([qx, qy, qz, qw], [x, y, z]).map_err(|e| wrong(e, "a unit quaternion w x y z"))?;
        let name = Some(name.to_owned());
        poses.push(inverse(FilePose { world_from_camera: camera_from_world, name, ..FilePose::default() }));
        lines.next_if(|(_, line)| line.trim().is_empty() || is_points(line));
    }
    Ok(poses)
}
