//! STL, text and binary. Own code: `stl_io` 0.11.0 stops at the first `endsolid` of several, takes a binary file
//! whose header begins with "solid " for text, and refuses files with one coordinate that is not finite.

use super::MeshBuilder;
use crate::FormatError;
use crate::error::Place;
use crate::text;
use geometry::Mesh;
use std::path::Path;

const HEADER: usize = 84;
const FACET: usize = 50;

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let count = bytes.get(80..HEADER).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    match count {
        _ if is_text(bytes, count) => text(path, bytes),
        Some(count) => binary(path, bytes, count),
        None => Err(FormatError::syntax(
            path,
            Place::File,
            format!("{} bytes that do not begin with \"solid\"", bytes.len()),
            "a text STL, or a binary one of at least 84 bytes",
        )),
    }
}

/// Whether a file is text: it begins with "solid", whatever its byte-order mark, followed by words. Headers of binary
/// files may begin so, too: then the size fits the count, or zero bytes and no words of the grammar follow.
fn is_text(bytes: &[u8], count: Option<u64>) -> bool {
    if count.is_some_and(|n| HEADER as u64 + n * FACET as u64 == bytes.len() as u64) {
        return false;
    }
    if matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..]) {
        return true;
    }
    let head = text::without_mark(bytes).trim_ascii_start();
    let head = head[..head.len().min(4096)].to_ascii_lowercase();
    let has = |word: &[u8]| head.windows(word.len()).any(|w| w == word);
    head.starts_with(b"solid") && (!head.contains(&0) || has(b"facet") && has(b"vertex"))
}

fn binary(path: &Path, bytes: &[u8], count: u64) -> Result<Mesh, FormatError> {
    let most = ((bytes.len() - HEADER) / FACET) as u64;
    if count > most {
        let place = Place::Byte(80);
        return Err(FormatError::Count { path: path.to_owned(), place, what: "triangles".into(), found: count, most });
    }
    let mut builder = MeshBuilder::default();
    for facet in bytes[HEADER..].chunks_exact(FACET).take(count as usize) {
        let float = |at: usize| f64::from(f32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]));
        builder.push([12, 24, 36].map(|at| ([float(at), float(at + 4), float(at + 8)], None)));
    }
    let left = bytes.len() - HEADER - count as usize * FACET;
    if text::was_transferred_as_text(&bytes[HEADER..], left) {
        return Err(FormatError::syntax(path, Place::Byte(84), text::ONLY_PAIRS, text::TRANSFERRED_AS_TEXT));
    }
    if left >= FACET {
        builder.notes.push(format!("{left} bytes follow after the {count} declared triangles and were not read"));
    }
    builder.finish(path, || "no triangle".to_owned())
}

fn text(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let text = text::decode(bytes);
    let mut builder = MeshBuilder::default();
    let mut corners = vec![];
    let mut last = 0;
    let mut ended = false;
    for (number, line) in text::lines(&text) {
        last = number;
        let place = Place::Line(number);
        let mut words = line.split_whitespace();
        let word = words.next().unwrap_or("").to_ascii_lowercase();
        ended = word == "endsolid" || ended && word.is_empty();
        match word.as_str() {
            "vertex" => {
                let mut position = [0.0; 3];
                for value in &mut position {
                    let word = words.next().unwrap_or("");
                    *value = text::number(word).ok_or_else(|| {
                        FormatError::syntax(path, place.clone(), format!("{word:?}"), "vertex with three coordinates")
                    })?;
                }
                corners.push((position, None));
            }
            "endloop" => {
                if corners.len() < 3 {
                    let found = format!("a facet of {} vertices", corners.len());
                    return Err(FormatError::syntax(path, place, found, "three vertices"));
                }
                builder.push_polygon(&corners, path, || place)?;
                corners.clear();
            }
            "facet" | "outer" | "endfacet" | "endsolid" if !corners.is_empty() => {
                return Err(FormatError::syntax(
                    path,
                    place,
                    format!("{word:?}"),
                    "endloop behind the vertices of a facet",
                ));
            }
            "" | "solid" | "facet" | "outer" | "endfacet" | "endsolid" | "color" => {}
            _ => {
                let expected = "solid, facet, outer loop, vertex, endloop, endfacet or endsolid";
                return Err(FormatError::syntax(path, place, format!("{word:?}"), expected));
            }
        }
    }
    if !corners.is_empty() {
        return Err(FormatError::truncated(path, Place::Line(last), "endloop"));
    }
    if !ended {
        builder.notes.push("the text ends without endsolid: the file may have been cut off".to_owned());
    }
    builder.finish(path, || "no facet".to_owned())
}

#[cfg(test)]
mod tests;
