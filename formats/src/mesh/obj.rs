//! Wavefront OBJ: positions, normals and faces. Own code: `tobj` 4.0.5 gives no line with its errors, drops the
//! link between positions and normals where only some corners have one, refuses files in which only some
//! vertices have colours, and overflows on some indices (`f 1//6148914691236517207`).

use super::{CornerData, MeshBuilder};
use crate::FormatError;
use crate::error::Place;
use crate::text;
use geometry::Mesh;
use std::path::Path;

/// Indices of a corner as written, made absolute: from 0, not yet checked.
#[derive(Clone, Copy)]
struct Indices {
    position: i64,
    normal: Option<i64>,
}

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let text = text::decode(bytes);
    let mut positions: Vec<[f64; 3]> = vec![];
    let mut normals: Vec<[f64; 3]> = vec![];
    let mut corners: Vec<Indices> = vec![];
    let mut faces: Vec<(usize, usize)> = vec![]; // line, end in `corners`
    let mut joined = String::new();
    let mut num_faces = 0usize;
    let mut lines = text::lines(&text).peekable();
    while let Some((number, line)) = lines.next() {
        let place = || Place::Line(number);
        let mut content = text::without_comment(line).trim_end();
        if let Some(part) = content.strip_suffix('\\') {
            content = part;
            if lines.peek().is_some() {
                joined.push_str(part);
                joined.push(' ');
                continue;
            }
        }
        let whole = (!joined.is_empty()).then(|| std::mem::take(&mut joined) + content);
        let mut words = whole.as_deref().unwrap_or(content).split_whitespace();
        match words.next() {
            Some("v") => positions.push(vector(path, place, &mut words, "three coordinates")?),
            Some("vn") => normals.push(vector(path, place, &mut words, "the three components of a normal")?),
            Some("f") => {
                let start = corners.len();
                for word in words {
                    let indices =
                        parse_corner(word, positions.len(), normals.len()).map_err(|relative| match relative {
                            Some(found) => {
                                let (path, vertices) = (path.to_owned(), positions.len());
                                FormatError::Index { path, place: place(), found, vertices }
                            }
                            None => {
                                let expected = "a corner such as 7, 7/1, 7//3 or -1";
                                FormatError::syntax(path, place(), format!("{word:?}"), expected)
                            }
                        })?;
                    corners.push(indices);
                }
                num_faces += 1;
                match corners.len() - start {
                    0..=2 => corners.truncate(start), // a point or a line
                    _ => faces.push((number, corners.len())),
                }
            }
            _ => {}
        }
    }

    let mut builder = MeshBuilder::default();
    let mut polygon: Vec<CornerData> = vec![];
    let mut start = 0;
    let mut missing = None;
    for (line, end) in faces {
        polygon.clear();
        for indices in &corners[start..end] {
            let find = |list: &[[f64; 3]], index: i64| usize::try_from(index).ok().and_then(|i| list.get(i).copied());
            let position = find(&positions, indices.position).ok_or_else(|| FormatError::Index {
                path: path.to_owned(),
                place: Place::Line(line),
                found: indices.position.saturating_add(1),
                vertices: positions.len(),
            })?;
            let normal = indices.normal.and_then(|n| find(&normals, n));
            missing = missing.or((normal.is_none() && indices.normal.is_some()).then_some(line));
            polygon.push((position, normal));
        }
        start = end;
        builder.push_polygon(&polygon, path, || Place::Line(line))?;
    }
    if let Some(line) = missing {
        builder
            .notes
            .push(format!("line {line} and others refer to normals that the file does not have; they are ignored"));
    }
    builder.finish(path, || format!("{} vertices and {num_faces} faces", positions.len()))
}

fn vector<'a>(
    path: &Path,
    place: impl Fn() -> Place,
    words: &mut impl Iterator<Item = &'a str>,
    expected: &str,
) -> Result<[f64; 3], FormatError> {
    let mut values = [0.0; 3];
    for value in &mut values {
        let word = words.next().ok_or_else(|| FormatError::syntax(path, place(), "too few numbers", expected))?;
        *value = text::number(word).ok_or_else(|| FormatError::syntax(path, place(), format!("{word:?}"), expected))?;
    }
    Ok(values)
}

/// `position`, `position/texture`, `position//normal` or `position/texture/normal`; negative ones count back. The
/// error holds the position's index where that points before the first.
fn parse_corner(word: &str, num_positions: usize, num_normals: usize) -> Result<Indices, Option<i64>> {
    let absolute = |text: &str, count: usize| {
        let index: i64 = text.parse().map_err(|_| None)?;
        match index {
            0 => Err(None),
            1.. => Ok(index - 1),
            _ => (count as i64).checked_add(index).filter(|&i| i >= 0).ok_or(Some(index)),
        }
    };
    let mut parts = word.split('/');
    let position = absolute(parts.next().unwrap_or(""), num_positions)?;
    let texture = parts.next().unwrap_or("");
    if !texture.is_empty() {
        texture.parse::<i64>().map_err(|_| None)?;
    }
    let normal = match parts.next() {
        None | Some("") => None,
        // One before the first is missing like one behind the last.
        Some(text) => match absolute(text, num_normals) {
            Err(Some(before)) => Some(before),
            found => Some(found.map_err(|_| None)?),
        },
    };
    if parts.next().is_some() {
        return Err(None);
    }
    Ok(Indices { position, normal })
}

#[cfg(test)]
mod tests;
