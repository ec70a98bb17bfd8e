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
        builder.notes.push(format!("{left} lines follow behind the {num_faces} faces declared and were not read"));
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
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Mesh, FormatError> {
        parse(Path::new("a.off"), text.as_bytes())
    }

    #[test]
    fn headers_of_all_kinds() {
        let body = "0 0 0\n1 0 0 # here\n\n0 1 0 255 0 0\n1 1 0\n4 0 1 3 2 0.5 0.5\n";
        for header in ["OFF\n4 1 0", "OFF4 1 0", "OFF 4 1 0", "# c\n\n  COFF\n4\n1 0", "4 1 4", "OFF\r\n4 1"] {
            let mesh = read(&format!("{header}\n{body}")).unwrap_or_else(|e| panic!("{header:?}: {e}"));
            assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 2), "{header:?}");
            assert_eq!(mesh.area(), 1.0, "{header:?}");
        }
    }

    #[test]
    fn errors_name_line_found_and_expected() {
        let text = |t: &str| read(t).expect_err(t).to_string();
        assert!(text("OFF\n1 1 0\n0 0 zero\n3 0 0 0").contains("line 3: found \"zero\", expected a coordinate"));
        assert!(
            text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7")
                .contains("line 6: found vertex index 7, expected one of 3")
        );
        assert!(text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1").contains("index -1"));
        assert!(text("OFF\n3 1 0\n0 0 0\n1 0 0").contains("the file ends here"));
        assert!(text("OFF1000000000000 1 0\n").contains("1000000000000 vertices declared"));
        assert!(text("OFF BINARY\n").contains("expected OFF"));
        assert!(text("solid x\n").contains("line 1"));
        assert!(text("").contains("nothing in it"));
        assert!(text("OFF 0 0 0").contains("found 0 vertices and 0 faces"));
    }

    #[test]
    fn marks_and_line_ends_of_any_system() {
        let text = "OFF\n3 1 0\n0 0 0\n1. 0 0\n.0 1 0\n3 0 1 2\n";
        let wide = text.encode_utf16().flat_map(u16::to_le_bytes);
        let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(wide).collect();
        for bytes in [text.replace('\n', "\r").into_bytes(), format!("\u{feff}{text}").into_bytes(), wide] {
            assert_eq!(parse(Path::new("a.off"), &bytes).unwrap().area(), 0.5, "{bytes:?}");
        }
    }

    #[test]
    fn survey_coordinates_keep_their_corners() {
        let mesh = read("OFF3 1 0\n5600000.01 0 0\n5600000.02 0 0\n5600000.01 0.01 0\n3 0 1 2\n").unwrap();
        assert!((mesh.area() - 0.5e-4).abs() < 1e-8, "{}", mesh.area());
    }

    #[test]
    fn useless_triangles_are_left_out() {
        let mesh = read(
            "OFF 5 6 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 0\n2 0 0\n3 0 1 2\n3 1 2 0\n3 2 1 0\n3 0 1 3\n3 0 1 1\n3 0 1 4\n",
        );
        let mesh = mesh.unwrap();
        assert_eq!(mesh.triangles.len(), 2, "one triangle and the same seen from behind");
        assert!(mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite())));
    }
}
