//! Rows of 4 x 4 matrices, TUM's lines (time x y z qx qy qz qw), and Open3D's `.log` (three whole numbers before each matrix):
//! all of them `world_from_camera`.

use super::{EXPECTED, FilePose, ROWS, content, numbers, of_matrix};
use crate::{FormatError, Place};
use planning::pose::from_quaternion;
use std::path::Path;

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<FilePose>, FormatError> {
    let mut rows: Vec<[f64; 4]> = Vec::new();
    let mut poses = Vec::new();
    // The numbers before a matrix, and whether the last matrix had any.
    let (mut header, mut is_log) = (None, None);
    for (number, line) in content(text) {
        let place = || Place::Line(number);
        let wrong = |found: String, expected: &str| FormatError::syntax(path, place(), found, expected);
        let values = numbers(line).ok_or_else(|| wrong(line.to_owned(), EXPECTED))?;
        match values[..] {
            [a, b, c, d] => rows.push([a, b, c, d]),
            [i, j, k] if rows.is_empty() && header.is_none() && [i, j, k].iter().all(|x| x.fract() == 0.0) => {
                header = Some(format!("{i}"));
            }
            [_, x, y, z, qx, qy, qz, qw] if rows.is_empty() && header.is_none() => {
                let pose = from_quaternion([qx, qy, qz, qw], [x, y, z]);
                let world_from_camera = pose.map_err(|e| wrong(e, "a unit quaternion x y z w, and metres"))?;
                poses.push(FilePose { world_from_camera, intrinsics: None, name: None, off: 0.0 });
            }
            _ => return Err(wrong(format!("{} numbers", values.len()), EXPECTED)),
        }
        if let [a, b, c, d] = rows[..] {
            if *is_log.get_or_insert(header.is_some()) != header.is_some() {
                let expected = "three numbers before each matrix (Open3D's .log) or before none";
                return Err(wrong("a matrix unlike those before it".to_owned(), expected));
            }
            poses.push(FilePose { name: header.take(), ..of_matrix(path, place(), ROWS, &[a, b, c, d])? });
            rows.clear();
        }
    }
    if !rows.is_empty() || header.is_some() {
        let last = Place::Line(crate::text::lines(text).count());
        return Err(FormatError::truncated(path, last, format!("4 rows of a matrix, found {}", rows.len())));
    }
    Ok(poses)
}
