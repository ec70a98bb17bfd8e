//! STL, text and binary. Own code: `stl_io` 0.11.0 stops at the first `endsolid` of several, takes a binary file
//! whose header begins with "solid " for text, and refuses files with one coordinate that is not finite.

use super::MeshBuilder;
use crate::FormatError;
use crate::error::Place;
use geometry::Mesh;
use std::path::Path;

const HEADER: usize = 84;
const FACET: usize = 50;

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let count = bytes.get(80..HEADER).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let fits = count.is_some_and(|n| HEADER as u64 + n * FACET as u64 == bytes.len() as u64);
    let solid = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    match count {
        _ if solid && !fits => text(path, bytes),
        Some(count) => binary(path, bytes, count),
        None => Err(FormatError::syntax(
            path,
            Place::File,
            format!("{} bytes that do not begin with \"solid\"", bytes.len()),
            "a text STL, or a binary one of at least 84 bytes",
        )),
    }
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
    builder.finish(path, || "no triangle".to_owned())
}

fn text(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut builder = MeshBuilder::default();
    let mut corners = vec![];
    for (index, line) in text.lines().enumerate() {
        let place = Place::Line(index + 1);
        let mut words = line.split_whitespace();
        let word = words.next().unwrap_or("").to_ascii_lowercase();
        match word.as_str() {
            "vertex" => {
                let mut position = [0.0; 3];
                for value in &mut position {
                    let word = words.next().unwrap_or("");
                    *value = word.parse().map_err(|_| {
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
                builder.push_polygon(&corners);
                corners.clear();
            }
            "" | "solid" | "facet" | "outer" | "endfacet" | "endsolid" | "color" => {}
            _ => {
                let expected = "solid, facet, outer loop, vertex, endloop, endfacet or endsolid";
                return Err(FormatError::syntax(path, place, format!("{word:?}"), expected));
            }
        }
    }
    if !corners.is_empty() {
        return Err(FormatError::truncated(path, Place::Line(text.lines().count()), "endloop"));
    }
    builder.finish(path, || "no facet".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(header: &[u8]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(1u32.to_le_bytes());
        for x in [0f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend([0, 0]);
        bytes
    }

    #[test]
    fn text_and_binary_whatever_the_header_says() {
        let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nVERTEX 0 1 0\nendloop\nendfacet\n";
        let two = format!("solid\n{facet}endsolid\nSOLID b\n{}endsolid b\n", facet.replace("0 0 0", "0 0 5"));
        let path = Path::new("a.stl");
        assert_eq!(parse(path, two.as_bytes()).unwrap().triangles.len(), 2, "both solids");
        for header in [&b"solid of an exporter"[..], b"", b"COLOR="] {
            assert_eq!(parse(path, &triangle(header)).unwrap().area(), 0.5);
        }
    }

    #[test]
    fn errors_name_place_found_and_expected() {
        let error = |bytes: &[u8]| parse(Path::new("a.stl"), bytes).expect_err("must fail").to_string();
        let mut huge = triangle(b"");
        huge[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(error(&huge).contains("byte 80: 4294967295 triangles declared, but the file has room for 1"));
        assert!(error(b"solid a\nvertex 1 2 x\n").contains("line 2: found \"x\""));
        assert!(error(b"solid a\nvertex 1 2 3\nendloop").contains("line 3: found a facet of 1 vertices"));
        assert!(error(b"solid a\nvertex 1 2 3\n").contains("ends here"));
        assert!(error(b"solid a\nendsolid a").contains("found no facet"));
        assert!(error(b"").contains("0 bytes"));
    }
}
