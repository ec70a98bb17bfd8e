//! Stanford's `.conf`: lines of `bmesh FILE tx ty tz qx qy qz qw`. Found on the bunny's scans: a point p of FILE lies at
//! q* p q + t, so that the quaternion turns the other way than it reads, and the translation is as written. The line `camera`
//! is of a viewer.

use super::{FilePose, content, numbers};
use crate::{FormatError, Place};
use planning::pose::from_quaternion;
use std::path::Path;

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<FilePose>, FormatError> {
    let mut poses = Vec::new();
    for (number, line) in content(text) {
        let wrong = |found: String| {
            let expected = "bmesh FILE tx ty tz qx qy qz qw";
            FormatError::syntax(path, Place::Line(number), found, expected)
        };
        let mut words = line.splitn(3, char::is_whitespace);
        match (words.next(), words.next(), words.next()) {
            (Some("camera"), ..) => {}
            (Some("bmesh" | "mesh"), Some(file), Some(rest)) => {
                let values = numbers(rest).ok_or_else(|| wrong(line.to_owned()))?;
                let [x, y, z, qx, qy, qz, qw] = values[..] else {
                    return Err(wrong(format!("{} numbers after {file}", values.len())));
                };
                let world_from_camera = from_quaternion([-qx, -qy, -qz, qw], [x, y, z]).map_err(&wrong)?;
                poses.push(FilePose { world_from_camera, name: Some(file.to_owned()), ..FilePose::default() });
            }
            _ => return Err(wrong(line.to_owned())),
        }
    }
    Ok(poses)
}
