//! Rows of 4 x 4 matrices, one matrix per line (KITTI), TUM's lines (time x y z qx qy qz qw, or as names above them say), and
//! Open3D's `.log` (three whole numbers before each matrix): all of them `world_from_camera`.

use super::header::{self, Header};
use super::{EXPECTED, FilePose, ROWS, content, numbers, of_matrix};
use crate::{FormatError, Place};
use planning::pose::from_quaternion;
use std::path::Path;

pub(super) fn parse(path: &Path, text: &str) -> Result<Vec<FilePose>, FormatError> {
    let mut rows: Vec<[f64; 4]> = Vec::new();
    let mut poses = Vec::new();
    // The numbers before a matrix, and whether the last matrix had any.
    let (mut before, mut is_log) = (None, None);
    let names = Header::above(text);
    for (number, line) in content(text) {
        if names.as_ref().is_some_and(|names| names.line == number) {
            continue;
        }
        let place = || Place::Line(number);
        let wrong = |found: String, expected: &str| FormatError::syntax(path, place(), found, expected);
        let values = numbers(line).ok_or_else(|| wrong(line.to_owned(), EXPECTED))?;
        let alone = rows.is_empty() && before.is_none();
        if let Some(names) = names.as_ref().filter(|names| alone && names.is_of(values.len())) {
            let world_from_camera = names.pose(&values).map_err(|e| wrong(e, header::EXPECTED))?;
            poses.push(FilePose { world_from_camera, ..FilePose::default() });
            continue;
        }
        match values[..] {
            [a, b, c, d] => rows.push([a, b, c, d]),
            [i, j, k] if alone && [i, j, k].iter().all(|x| x.fract() == 0.0) => before = Some(format!("{i}")),
            [_, x, y, z, qx, qy, qz, qw] if alone => {
                let pose = from_quaternion([qx, qy, qz, qw], [x, y, z]);
                let world_from_camera = pose.map_err(|e| wrong(e, "a unit quaternion x y z w, and metres"))?;
                poses.push(FilePose { world_from_camera, ..FilePose::default() });
            }
            _ if alone && matches!(values.len(), 12 | 16) => {
                poses.push(of_matrix(path, place(), ROWS, &in_one_line(&values))?);
            }
            _ => return Err(wrong(format!("{} numbers", values.len()), EXPECTED)),
        }
        if let [a, b, c, d] = rows[..] {
            if *is_log.get_or_insert(before.is_some()) != before.is_some() {
                let expected = "three numbers before each matrix (Open3D's .log) or before none";
                return Err(wrong("a matrix unlike those before it".to_owned(), expected));
            }
            poses.push(FilePose { name: before.take(), ..of_matrix(path, place(), ROWS, &[a, b, c, d])? });
            rows.clear();
        }
    }
    if !rows.is_empty() || before.is_some() {
        let last = Place::Line(crate::text::lines(text).count());
        return Err(FormatError::truncated(path, last, format!("4 rows of a matrix, found {}", rows.len())));
    }
    Ok(poses)
}

/// The rows of a matrix that stand in one line, the last one given or not.
fn in_one_line(values: &[f64]) -> [[f64; 4]; 4] {
    let mut rows = [[0.0, 0.0, 0.0, 1.0]; 4];
    for (row, given) in rows.iter_mut().zip(values.chunks_exact(4)) {
        row.copy_from_slice(given);
    }
    rows
}
