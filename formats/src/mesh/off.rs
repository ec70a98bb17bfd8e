//! OFF. Own code: `off-rs` 1.0.0 fails on ModelNet40's glued headers (`OFF490 518 0`) and above 10,000 vertices.

use super::MeshBuilder;
use crate::FormatError;
use crate::error::Place;
use crate::text;
use geometry::Mesh;
use std::path::Path;

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let text = text::decode(bytes);
    let mut lines = Lines { path, lines: Box::new(text::lines(&text)), line: 0, tokens: vec![] };

    let Some(first) = lines.next_line() else {
        return Err(FormatError::Empty { path: path.to_owned(), found: "no text".into(), expected: "an OFF header" });
    };
    // Texture, colours and normals stand behind the position, so that these variants read alike; 4OFF does not.
    let (keyword, rest) = match first.find("OFF") {
        Some(at) if ["", "C", "N", "ST", "CN", "STC", "STN", "STCN"].contains(&&first[..at]) => first.split_at(at + 3),
        _ => ("", first),
    };
    if keyword.is_empty() && !first.starts_with(|c: char| c.is_ascii_digit()) || rest.trim_start().starts_with("BINARY")
    {
        return Err(FormatError::syntax(path, Place::Line(lines.line), first, "OFF (text, three coordinates)"));
    }
    lines.tokens = rest.split_whitespace().collect();
    lines.fill(2, "the numbers of vertices and faces")?;
    let header = Place::Line(lines.line);
    let num_vertices: u64 = lines.number(0, "the number of vertices")?;
    let num_faces: u64 = lines.number(1, "the number of faces")?;
    // A vertex takes six bytes at least, a face two.
    for (found, size, what) in [(num_vertices, 6, "vertices"), (num_faces, 2, "faces")] {
        let most = bytes.len() as u64 / size;
        if found > most {
            return Err(FormatError::Count { path: path.to_owned(), place: header, what: what.into(), found, most });
        }
    }

    let mut vertices = Vec::with_capacity(num_vertices as usize);
    for _ in 0..num_vertices {
        lines.tokens.clear();
        lines.fill(3, "three coordinates")?;
        let at = |k| lines.coordinate(k);
        vertices.push([at(0)?, at(1)?, at(2)?]);
    }
    let mut builder = MeshBuilder::default();
    let mut corners = vec![];
    for _ in 0..num_faces {
        lines.tokens.clear();
        lines.fill(1, "a face")?;
        let count: usize = lines.number(0, "the number of a face's corners")?;
        if count > vertices.len() {
            let most = vertices.len() as u64;
            let place = Place::Line(lines.line);
            return Err(FormatError::Count {
                path: path.to_owned(),
                place,
                what: "corners".into(),
                found: count as u64,
                most,
            });
        }
        lines.fill(1 + count, "a vertex index per corner")?;
        corners.clear();
        for k in 1..=count {
            let index: i64 = lines.number(k, "a vertex index")?;
            let vertex = usize::try_from(index).ok().and_then(|i| vertices.get(i)).ok_or(FormatError::Index {
                path: path.to_owned(),
                place: Place::Line(lines.line),
                found: index,
                vertices: vertices.len(),
            })?;
            corners.push((*vertex, None));
        }
        let line = lines.line;
        builder.push_polygon(&corners, path, || Place::Line(line))?;
    }
    let mut left = 0;
    while lines.next_line().is_some() {
        left += 1;
    }
    if left > 0 {
        builder.notes.push(format!("{left} lines follow after the {num_faces} declared faces and were not read"));
    }
    builder.finish(path, || format!("{num_vertices} vertices and {num_faces} faces"))
}

/// Lines without comments and blanks; what stands behind the wanted numbers of a line (colours) is ignored.
struct Lines<'a> {
    path: &'a Path,
    lines: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
    tokens: Vec<&'a str>,
}

impl<'a> Lines<'a> {
    fn next_line(&mut self) -> Option<&'a str> {
        for (number, line) in self.lines.by_ref() {
            self.line = number;
            let content = text::without_comment(line).trim();
            if !content.is_empty() {
                return Some(content);
            }
        }
        None
    }

    /// Appends lines until there are `count` tokens.
    fn fill(&mut self, count: usize, expected: &str) -> Result<(), FormatError> {
        while self.tokens.len() < count {
            let Some(line) = self.next_line() else {
                return Err(FormatError::truncated(self.path, Place::Line(self.line), expected));
            };
            self.tokens.extend(line.split_whitespace());
        }
        Ok(())
    }

    fn coordinate(&self, token: usize) -> Result<f64, FormatError> {
        let word = self.tokens[token];
        let refuse = || FormatError::syntax(self.path, Place::Line(self.line), format!("{word:?}"), "a coordinate");
        text::number(word).ok_or_else(refuse)
    }

    fn number<T: std::str::FromStr>(&self, token: usize, expected: &str) -> Result<T, FormatError> {
        let text = self.tokens[token];
        text.parse().map_err(|_| FormatError::syntax(self.path, Place::Line(self.line), format!("{text:?}"), expected))
    }
}

#[cfg(test)]
mod tests;
