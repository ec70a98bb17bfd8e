//! PLY, for meshes and clouds; `ply-rs-bw` parses, after a look at the header: an element without properties and
//! a count of a billion would otherwise eat gigabytes.

use crate::FormatError;
use crate::cloud::CloudFile;
use crate::error::Place;
use crate::mesh::MeshBuilder;
use crate::run::atomic_write_with;
use geometry::{Mesh, PointCloud};
use nalgebra::{Point3, Vector3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::io::{BufRead, Cursor, Write};
use std::path::Path;

/// A vertex or a face; properties that are neither are skipped.
#[derive(Default)]
struct Row {
    position: [f64; 3],
    normal: [f64; 3],
    indices: Vec<i64>,
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "nx" => &mut self.normal[0],
            "ny" => &mut self.normal[1],
            "nz" => &mut self.normal[2],
            "vertex_indices" | "vertex_index" => {
                return match to_indices(property) {
                    Some(indices) => {
                        self.indices = indices;
                        PropertyAccessResult::Set
                    }
                    None => PropertyAccessResult::UnsupportedType,
                };
            }
            _ => return PropertyAccessResult::Ignored,
        };
        match to_number(&property) {
            Some(value) => {
                *slot = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

fn to_number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(v) => v.into(),
        Property::UChar(v) => v.into(),
        Property::Short(v) => v.into(),
        Property::UShort(v) => v.into(),
        Property::Int(v) => v.into(),
        Property::UInt(v) => v.into(),
        Property::Float(v) => v.into(),
        Property::Double(v) => v,
        _ => return None,
    })
}

fn to_indices(property: Property) -> Option<Vec<i64>> {
    fn wide<T: Into<i64>>(list: Vec<T>) -> Vec<i64> {
        list.into_iter().map(Into::into).collect()
    }
    Some(match property {
        Property::ListChar(list) => wide(list),
        Property::ListUChar(list) => wide(list),
        Property::ListShort(list) => wide(list),
        Property::ListUShort(list) => wide(list),
        Property::ListInt(list) => wide(list),
        Property::ListUInt(list) => wide(list),
        _ => return None,
    })
}

/// The vertices and faces of a file, with the header.
fn parse(path: &Path, bytes: &[u8]) -> Result<(Header, Vec<Row>, Vec<Row>), FormatError> {
    let parser = Parser::<Row>::new();
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = parser.read_header(&mut reader).map_err(|e| {
        let place = e.line().map_or(Place::File, |line| Place::Line(line.max(1)));
        FormatError::syntax(
            path,
            place,
            first_line(&e.to_string()),
            "a PLY header (ply, format, element ..., end_header)",
        )
    })?;
    let (mut vertices, mut faces) = (vec![], vec![]);
    for (name, element) in &header.elements {
        let room = bytes.len() as u64 - reader.get_ref().position();
        check_count(path, element, header.encoding, room)?;
        let place = match header.encoding {
            Encoding::Ascii => None,
            _ => Some(Place::Part(format!("element {name:?} from byte {}", reader.get_ref().position()))),
        };
        let rows = parser.read_payload_for_element(&mut reader, element, &header).map_err(|e| {
            let ascii = Place::Line(reader_line(bytes, reader.get_ref()));
            let expected = format!("{} rows of element {name:?} as the header declares them", element.count);
            match e.kind() {
                std::io::ErrorKind::UnexpectedEof => FormatError::truncated(path, place.unwrap_or(ascii), expected),
                _ => FormatError::syntax(path, place.unwrap_or(ascii), first_line(&e.to_string()), expected),
            }
        })?;
        match name.as_str() {
            "vertex" => vertices = rows,
            "face" => faces = rows,
            _ => {}
        }
    }
    Ok((header, vertices, faces))
}

fn check_count(path: &Path, element: &ElementDef, encoding: Encoding, room: u64) -> Result<(), FormatError> {
    let size = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let row: u64 = match encoding {
        Encoding::Ascii => 1, // its line break
        _ => element
            .properties
            .iter()
            .map(|(_, p)| match &p.data_type {
                PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size(scalar),
            })
            .sum(),
    };
    let found = element.count as u64;
    // The last line may lack its break.
    let most = room.checked_div(row).map_or(0, |rows| rows + u64::from(encoding == Encoding::Ascii));
    if found > most {
        let place = Place::Part("header".to_owned());
        let what = format!("rows of element {:?}", element.name);
        return Err(FormatError::Count { path: path.to_owned(), place, what, found, most });
    }
    Ok(())
}

/// Line of the last byte that was read.
fn reader_line(bytes: &[u8], cursor: &Cursor<&[u8]>) -> usize {
    let end = (cursor.position() as usize).min(bytes.len());
    Cursor::new(&bytes[..end]).split(b'\n').count()
}

fn first_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn has(header: &Header, element: &str, properties: [&str; 3]) -> bool {
    header.elements.get(element).is_some_and(|e| properties.iter().all(|&p| e.properties.contains_key(p)))
}

fn check_positions(path: &Path, header: &Header) -> Result<(), FormatError> {
    if has(header, "vertex", ["x", "y", "z"]) {
        return Ok(());
    }
    let names: Vec<_> = header.elements.iter().map(|(name, _)| name.as_str()).collect();
    let found = if names.is_empty() { "no element".to_owned() } else { format!("the elements {names:?}") };
    Err(FormatError::Empty { path: path.to_owned(), found, expected: "an element vertex with x, y and z" })
}

/// Reads a mesh.
pub(crate) fn parse_mesh(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    let (header, vertices, faces) = parse(path, bytes)?;
    check_positions(path, &header)?;
    let mut builder = MeshBuilder::default();
    let mut corners = vec![];
    for (number, face) in faces.iter().enumerate() {
        corners.clear();
        for &index in &face.indices {
            let vertex = usize::try_from(index).ok().and_then(|i| vertices.get(i)).ok_or(FormatError::Index {
                path: path.to_owned(),
                place: Place::Part(format!("face {number}")),
                found: index,
                vertices: vertices.len(),
            })?;
            corners.push((vertex.position, None));
        }
        builder.push_polygon(&corners);
    }
    builder.finish(path, || format!("{} vertices and {} faces", vertices.len(), faces.len()))
}

/// Reads the vertices as a cloud.
pub(crate) fn parse_cloud(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let (header, vertices, _) = parse(path, bytes)?;
    check_positions(path, &header)?;
    let with_normals = has(&header, "vertex", ["nx", "ny", "nz"]);
    CloudFile::gather(path, vertices.iter().map(|v| (v.position, with_normals.then_some(v.normal))), None)
}

/// Writes a cloud as binary PLY (doubles).
///
/// # Errors
/// What the operating system refuses.
pub fn write_ply(path: &Path, cloud: &PointCloud) -> Result<(), FormatError> {
    let normals = if cloud.has_normals() { "property double nx\nproperty double ny\nproperty double nz\n" } else { "" };
    atomic_write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\n{normals}end_header\n",
            cloud.len()
        )?;
        for (i, point) in cloud.points.iter().enumerate() {
            write_vector(out, &point.coords)?;
            if cloud.has_normals() {
                write_vector(out, &cloud.normals[i])?;
            }
        }
        Ok(())
    })
}

/// A coloured point of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColoredPoint {
    /// Position.
    pub position: Point3<f64>,
    /// Red, green, blue.
    pub color: [u8; 3],
}

/// Writes coloured points and lines between some of them (camera frustums) as binary PLY, for any viewer.
///
/// # Errors
/// What the operating system refuses.
pub fn write_ply_scene(path: &Path, points: &[ColoredPoint], edges: &[[u32; 2]]) -> Result<(), FormatError> {
    atomic_write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement edge {}\n\
             property int vertex1\nproperty int vertex2\nend_header\n",
            points.len(),
            edges.len()
        )?;
        for point in points {
            write_vector(out, &point.position.coords)?;
            out.write_all(&point.color)?;
        }
        for index in edges.iter().flatten() {
            out.write_all(&index.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Writes a mesh as binary PLY (doubles).
///
/// # Errors
/// What the operating system refuses.
pub fn write_ply_mesh(path: &Path, mesh: &Mesh) -> Result<(), FormatError> {
    atomic_write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            mesh.vertices.len(),
            mesh.triangles.len()
        )?;
        for vertex in &mesh.vertices {
            write_vector(out, &vertex.coords)?;
        }
        for triangle in &mesh.triangles {
            out.write_all(&[3])?;
            for index in triangle {
                out.write_all(&index.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

fn write_vector(out: &mut dyn Write, vector: &Vector3<f64>) -> std::io::Result<()> {
    vector.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(text: &str) -> Result<Mesh, FormatError> {
        parse_mesh(Path::new("a.ply"), text.as_bytes())
    }

    const HEAD: &str =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float y\nproperty float x\nproperty double z\n";

    #[test]
    fn any_order_of_properties_and_extra_elements() {
        let text = format!(
            "{HEAD}property list uchar int other\nelement face 1\nproperty uchar red\nproperty list uchar short vertex_index\n\
             element range_grid 2\nproperty list uchar int vertex_indices\nend_header\n\
             0 1 0 2 5 5\n0 0 0 0\n1 0 0 0\n9 3 0 1 2\n1 2\n0\n"
        );
        let mesh = mesh(&text).unwrap();
        assert_eq!(mesh.vertices[0], Point3::new(1.0, 0.0, 0.0));
        assert_eq!(mesh.area(), 0.5);
    }

    #[test]
    fn errors_name_place_found_and_expected() {
        let text = |t: &str| mesh(t).expect_err(t).to_string();
        let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        let rows = "0 0 0\n1 0 0\n0 1 0\n";
        assert!(
            text(&format!("{HEAD}{faces}{rows}3 0 1 3\n")).contains("face 0: found vertex index 3, expected one of 3")
        );
        let message = text(&format!("{HEAD}{faces}0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n"));
        assert!(message.contains("line 11") && message.contains("zero"), "{message}");
        let message = text(&format!("{HEAD}{faces}0 0 0\n"));
        assert!(message.contains("declared") || message.contains("ends here"), "{message}");
        let huge = HEAD.replace("vertex 3", "vertex 1000000000000");
        assert!(text(&format!("{huge}{faces}{rows}")).contains("1000000000000 rows of element \"vertex\" declared"));
        let bare = "ply\nformat binary_little_endian 1.0\nelement nothing 1000000000\nend_header\n";
        assert!(text(bare).contains("1000000000 rows of element \"nothing\" declared"));
        assert!(text("ply\nformat ascii 1.0\nend_header\n").contains("found no element"));
        assert!(text("plx\n").contains("PLY header"));
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let mut cloud = PointCloud {
            points: vec![Point3::new(5_600_000.123, 0.1, -3.0), Point3::new(1.0 / 3.0, 0.0, 1e-9)],
            normals: vec![Vector3::z(), Vector3::new(0.5, 0.5, 0.1)],
        };
        write_ply(&path, &cloud).unwrap();
        assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud, cloud);
        cloud.normals.clear();
        write_ply(&path, &cloud).unwrap();
        assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud, cloud);

        let triangle = mesh(&format!(
            "{HEAD}element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2"
        ));
        let triangle = triangle.unwrap();
        write_ply_mesh(&path, &triangle).unwrap();
        assert_eq!(crate::mesh::read_mesh(&path).unwrap(), triangle);

        let points = [ColoredPoint { position: cloud.points[0], color: [1, 2, 3] }; 2];
        write_ply_scene(&path, &points, &[[0, 1]]).unwrap();
        assert_eq!(crate::cloud::read_cloud(&path).unwrap().cloud.len(), 2);
    }
}
