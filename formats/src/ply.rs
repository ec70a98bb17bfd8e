//! PLY, for meshes and clouds. Own code: `ply-rs-bw` 4.0.1 refuses property names, number types, line ends and numbers that
//! exporters write, and keeps properties by name, so that one given twice shifts all that follow.

mod body;
mod header;
mod write;

pub use write::{ColoredPoint, write_ply, write_ply_scene};

use crate::FormatError;
use crate::cloud::CloudFile;
use crate::error::Place;
use crate::mesh::MeshBuilder;
use body::{Body, Wanted};
use geometry::Mesh;
use header::{Element, Header, Kind};
use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

/// Names of the list that makes a face.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The vertices of a file and the lists that make its faces.
#[derive(Default)]
struct Content {
    positions: Vec<[f64; 3]>,
    /// Empty where the file gives none.
    normals: Vec<[f64; 3]>,
    /// Vertices of all faces, one after the other, and where each face ends.
    corners: Vec<i64>,
    ends: Vec<usize>,
    /// Which of the faces are strips.
    strips: Vec<Range<usize>>,
    notes: Vec<String>,
}

fn parse(path: &Path, bytes: &[u8], with_faces: bool) -> Result<Content, FormatError> {
    let decoded = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Cow::Owned(crate::text::decode(bytes).into_owned().into_bytes()),
        _ => Cow::Borrowed(crate::text::without_mark(bytes)),
    };
    let bytes = decoded.as_ref();
    let header = header::parse(path, bytes)?;
    let vertex = vertex_properties(path, &header);
    let text = body::text_of(&header, bytes);
    let mut body = Body::new(path, &header, bytes, &text);
    let mut content = Content::default();
    for element in &header.elements {
        let is = |name: &str| element.name.eq_ignore_ascii_case(name);
        if let (true, &Ok((xyz, normal))) = (is("vertex"), &vertex) {
            let scalars = xyz.into_iter().chain(normal.into_iter().flatten()).collect();
            body.each(element, &Wanted { scalars, list: None }, |&[x, y, z, nx, ny, nz], _| {
                content.positions.push([x, y, z]);
                if normal.is_some() {
                    content.normals.push([nx, ny, nz]);
                }
                Ok(())
            })?;
            continue;
        }
        let faces = with_faces && (is("face") || is("tristrips"));
        let list = if faces { index_list(path, element)? } else { None };
        let name = list.map(|at| &element.properties[at].name);
        if let Some(name) = name.filter(|name| !INDICES.iter().any(|known| name.eq_ignore_ascii_case(known))) {
            let element = &element.name;
            content
                .notes
                .push(format!("{name:?}, the only list of integers of element {element:?}, was read as its vertices"));
        }
        let first = content.ends.len();
        body.each(element, &Wanted { scalars: vec![], list }, |_, indices| {
            if list.is_some() {
                content.corners.extend_from_slice(indices);
                content.ends.push(content.corners.len());
            }
            Ok(())
        })?;
        if is("tristrips") {
            content.strips.push(first..content.ends.len());
        }
    }
    vertex?;
    content.notes.extend(body.left_over(&header)?);
    Ok(content)
}

/// The property that lists the vertices of a face: by its name, else the only list of integers.
fn index_list(path: &Path, element: &Element) -> Result<Option<usize>, FormatError> {
    let is_list = |&at: &usize| matches!(element.properties[at].kind, Kind::List { item, .. } if item.is_integer());
    let Some(at) = INDICES.into_iter().find_map(|name| element.find(name)) else {
        let mut lists = (0..element.properties.len()).filter(is_list);
        return Ok(lists.next().filter(|_| lists.next().is_none()));
    };
    match element.properties[at].kind {
        Kind::List { item, .. } if item.is_integer() => Ok(Some(at)),
        _ => {
            let place = Place::Part(format!("element {:?}", element.name));
            let found = format!("property {:?}", element.properties[at].name);
            Err(FormatError::syntax(path, place, found, "a list of integers of that name"))
        }
    }
}

/// Where the position and the normal of a vertex stand.
fn vertex_properties(path: &Path, header: &Header) -> Result<([usize; 3], Option<[usize; 3]>), FormatError> {
    let vertex = header.elements.iter().find(|e| e.name.eq_ignore_ascii_case("vertex"));
    if let Some((vertex, xyz)) = vertex.and_then(|v| Some((v, v.find_all(["x", "y", "z"])?))) {
        let normal = vertex.find_all(["nx", "ny", "nz"]);
        return Ok((xyz, normal.or_else(|| vertex.find_all(["normal_x", "normal_y", "normal_z"]))));
    }
    let names: Vec<_> = header.elements.iter().map(|e| e.name.as_str()).collect();
    let found = match vertex {
        Some(vertex) => {
            let names: Vec<_> = vertex.properties.iter().map(|p| p.name.as_str()).collect();
            format!("an element vertex with {names:?}")
        }
        None if names.is_empty() => "no element".to_owned(),
        None => format!("the elements {names:?}"),
    };
    Err(FormatError::Empty { path: path.to_owned(), found, expected: "an element vertex with x, y and z" })
}

/// Reads a mesh.
pub(crate) fn parse_mesh(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let Content { positions, corners, ends, strips, notes, .. } = parse(path, bytes, true)?;
    let mut builder = MeshBuilder::default();
    builder.notes = notes;
    let mut polygon = vec![];
    let mut start = 0;
    for (number, &end) in ends.iter().enumerate() {
        let place = || Place::Part(format!("face {number}"));
        let find = |index: i64| {
            let vertex = usize::try_from(index).ok().and_then(|i| positions.get(i).copied());
            let (path, vertices) = (path.to_owned(), positions.len());
            vertex.map(|p| (p, None)).ok_or(FormatError::Index { path, place: place(), found: index, vertices })
        };
        let face = &corners[start..end];
        start = end;
        if strips.iter().any(|faces| faces.contains(&number)) {
            // Every second triangle of a strip is turned; -1 ends it.
            for strip in face.split(|&i| i == -1) {
                for (k, t) in strip.windows(3).enumerate() {
                    let [a, b, c] = if k % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
                    builder.push([find(a)?, find(b)?, find(c)?]);
                }
            }
            continue;
        }
        polygon.clear();
        for &index in face {
            polygon.push(find(index)?);
        }
        builder.push_polygon(&polygon, path, place)?;
    }
    builder.finish(path, || format!("{} vertices and {} faces", positions.len(), ends.len()))
}

/// Reads the vertices as a cloud.
pub(crate) fn parse_cloud(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let Content { positions, normals, notes, .. } = parse(path, bytes, false)?;
    let rows = positions.iter().enumerate().map(|(i, p)| (*p, normals.get(i).copied()));
    CloudFile::gather(path, rows, None).map(|file| file.with_notes(notes))
}

#[cfg(test)]
mod tests;
