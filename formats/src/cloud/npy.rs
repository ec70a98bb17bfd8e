//! NumPy arrays: N x 3, N x 6 (position, normal), or height x width x 3 or 6 of an organised cloud. Own code:
//! `npyz` 0.9.1 overflows on the product of a hostile shape and allocates a header of the length that is claimed.

use super::CloudFile;
use crate::FormatError;
use crate::error::Place;
use std::path::Path;

/// An array as f64, row-major.
pub(crate) struct Array {
    /// As its file says: where one dimension is zero, the others may be anything.
    pub(crate) shape: Vec<usize>,
    pub(crate) values: Vec<f64>,
    /// The largest value of the file's type where it holds integers.
    pub(crate) largest_integer: Option<f64>,
    /// Bytes behind the numbers.
    pub(crate) left: usize,
}

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let Array { shape, values, left, .. } = read_array(path, bytes, "(N, 3), (N, 6), (H, W, 3) or (H, W, 6)")?;
    let (size, columns) = match *shape {
        [_, columns @ (3 | 6)] => (None, columns),
        [height, width, columns @ (3 | 6)] => (Some((width, height)), columns),
        _ => {
            let place = Place::Part("shape".to_owned());
            let expected = "(N, 3), (N, 6), (H, W, 3) or (H, W, 6)";
            return Err(FormatError::syntax(path, place, format!("{shape:?}"), expected));
        }
    };
    let rows = || values.chunks_exact(columns);
    let others: Vec<[f64; 3]> = rows().filter_map(|row| row.get(3..6)?.try_into().ok()).collect();
    let with_normals = columns == 6 && super::are_normals(others.iter());
    let points = rows().zip(0..).map(|(row, i): (_, usize)| {
        let normal = with_normals.then(|| others[i]);
        ([row[0], row[1], row[2]], normal)
    });
    let file = CloudFile::gather(path, points, size)?;
    let ignored = (columns == 6 && !with_normals).then(super::columns_ignored);
    let left = (left > 0).then(|| format!("{left} bytes follow after the array and were not read"));
    Ok(file.with_notes(ignored.into_iter().chain(left)))
}

/// Reads an array of numbers.
pub(crate) fn read_array(path: &Path, bytes: &[u8], expected: &str) -> Result<Array, FormatError> {
    let refuse = |found: &str| FormatError::syntax(path, Place::Part("header".to_owned()), found, expected);
    let version = bytes.strip_prefix(b"\x93NUMPY").and_then(|b| b.first()).ok_or_else(|| refuse("no NumPy file"))?;
    let length = |range: std::ops::Range<usize>| {
        bytes.get(range).map(|b| b.iter().rev().fold(0usize, |n, &byte| n << 8 | usize::from(byte)))
    };
    let (start, length) = match version {
        1 => (10, length(8..10)),
        2 | 3 => (12, length(8..12)),
        other => return Err(refuse(&format!("NumPy format version {other}"))),
    };
    let end = length.and_then(|n| n.checked_add(start));
    let header = end
        .and_then(|end| bytes.get(start..end))
        .ok_or_else(|| FormatError::truncated(path, Place::Byte(bytes.len() as u64), "the header"))?;
    let header = String::from_utf8_lossy(header);
    let data = &bytes[end.unwrap_or(bytes.len())..];

    let descr = entry(&header, "descr").and_then(|v| v.strip_prefix('\'')?.split_once('\''));
    let descr = descr.ok_or_else(|| refuse("a header without a plain type"))?.0;
    let column_major = entry(&header, "fortran_order").is_some_and(|v| v.starts_with("True"));
    let shape = entry(&header, "shape").and_then(|v| v.strip_prefix('(')?.split_once(')'));
    let shape = shape.ok_or_else(|| refuse("a header without a shape"))?.0;
    let shape: Vec<u64> = shape
        .split(',')
        .map(str::trim)
        .filter(|d| !d.is_empty())
        .map(|d| d.parse().map_err(|_| refuse(&format!("a shape with {d:?}"))))
        .collect::<Result<_, _>>()?;

    let unknown = || refuse(&format!("numbers of type {descr:?}"));
    let (big, kind) = descr.split_at_checked(1).ok_or_else(unknown)?;
    let big = match big {
        ">" => true,
        "<" | "|" | "=" => false,
        _ => return Err(unknown()),
    };
    let number: fn(&[u8]) -> f64 = match kind {
        "f4" => |b| f64::from(f32::from_le_bytes(b.try_into().unwrap_or_default())),
        "f8" => |b| f64::from_le_bytes(b.try_into().unwrap_or_default()),
        "i1" => |b| f64::from(b[0] as i8),
        "i2" => |b| f64::from(i16::from_le_bytes(b.try_into().unwrap_or_default())),
        "i4" => |b| f64::from(i32::from_le_bytes(b.try_into().unwrap_or_default())),
        "i8" => |b| i64::from_le_bytes(b.try_into().unwrap_or_default()) as f64,
        "u1" => |b| f64::from(b[0]),
        "u2" => |b| f64::from(u16::from_le_bytes(b.try_into().unwrap_or_default())),
        "u4" => |b| f64::from(u32::from_le_bytes(b.try_into().unwrap_or_default())),
        "u8" => |b| u64::from_le_bytes(b.try_into().unwrap_or_default()) as f64,
        _ => return Err(unknown()),
    };
    let width = usize::from(kind.as_bytes()[1] - b'0');
    let most = (data.len() / width) as u64;
    let count = shape.iter().try_fold(1u64, |n, &d| n.checked_mul(d));
    let Some(count) = count.filter(|&n| n <= most) else {
        return Err(FormatError::Count {
            path: path.to_owned(),
            place: Place::Part(format!("shape {shape:?}")),
            what: "numbers".to_owned(),
            found: count.unwrap_or(u64::MAX),
            most,
        });
    };
    let mut values = Vec::with_capacity(count as usize);
    for bytes in data.chunks_exact(width).take(count as usize) {
        let mut little = [0; 8];
        little[..width].copy_from_slice(bytes);
        if big {
            little[..width].reverse();
        }
        values.push(number(&little[..width]));
    }
    let shape: Vec<usize> = shape.iter().map(|&d| d as usize).collect();
    let values = if column_major { to_row_major(&shape, &values) } else { values };
    let bits = (8 * width) as i32;
    let largest_integer = match kind.as_bytes()[0] {
        b'u' => Some(2f64.powi(bits) - 1.0),
        b'i' => Some(2f64.powi(bits - 1) - 1.0),
        _ => None,
    };
    Ok(Array { shape, values, largest_integer, left: data.len() - count as usize * width })
}

/// What follows `'key':` in the header, a Python dictionary.
fn entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = header.split_once(&format!("'{key}'"))?;
    Some(rest.trim_start().strip_prefix(':')?.trim_start())
}

fn to_row_major(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let mut index = vec![0usize; shape.len()];
    let mut out = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        let at = index.iter().zip(shape).rev().fold(0, |at, (&i, &d)| at * d + i);
        out.push(values[at]);
        for k in (0..shape.len()).rev() {
            index[k] += 1;
            if index[k] < shape[k] {
                break;
            }
            index[k] = 0;
        }
    }
    out
}

#[cfg(test)]
mod tests;
