//! Triangle meshes from OFF, OBJ, PLY and STL files.

mod obj;
mod off;
mod polygon;
mod stl;
mod write;

pub use write::write_surface;

use crate::FormatError;
use crate::error::Place;
use geometry::Mesh;
use nalgebra::Point3;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Endings of the files that [`read_mesh`] reads, lower case.
pub const EXTENSIONS: [&str; 4] = ["off", "obj", "ply", "stl"];

/// Reads a mesh; the ending of the name (in any case) says the format. Polygons become
/// triangles. Triangles with a vertex that is not finite, without area, or given twice with the same orientation are left
/// out. What a file holds beyond what it declares is logged as a warning.
///
/// # Errors
/// A file that cannot be read, is not of its format, or holds no triangle of use.
pub fn read_mesh(path: &Path) -> Result<Mesh, FormatError> {
    let bytes = crate::file::read(path)?;
    parse_mesh(path, &bytes)
}

/// [`read_mesh`] on bytes at hand; `path` gives the format and stands in the errors.
///
/// ```
/// use std::path::Path;
///
/// let mesh = formats::mesh::parse_mesh(Path::new("a.off"), b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")?;
/// assert_eq!(mesh.triangles, [[0, 1, 2]]);
/// let error = formats::mesh::parse_mesh(Path::new("b.off"), b"OFF\n3 1 0\n0 0 0\n1 x 0\n").expect_err("x is no number");
/// assert!(error.to_string().contains("b.off"));
/// # Ok::<(), formats::FormatError>(())
/// ```
///
/// # Errors
/// As [`read_mesh`].
pub fn parse_mesh(path: &Path, bytes: &[u8]) -> Result<Mesh, FormatError> {
    match crate::extension(path).as_str() {
        "off" => off::parse(path, bytes),
        "obj" => obj::parse(path, bytes),
        "ply" => crate::ply::parse_mesh(path, bytes),
        "stl" => stl::parse(path, bytes),
        found => Err(FormatError::UnknownType {
            path: path.to_owned(),
            found: format!(".{found}"),
            expected: ".off, .obj, .ply or .stl",
        }),
    }
}

/// Gathers triangles by their corners; equal corners become one vertex.
#[derive(Default)]
pub(crate) struct MeshBuilder {
    vertices: Vec<Point3<f64>>,
    corners: HashMap<Corner, u32>,
    positions: HashMap<[u64; 3], u32>,
    position_of: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    seen: HashSet<[u32; 3]>,
    left_out: usize,
    work: polygon::Work,
    /// What a user should know of how the file was read.
    pub(crate) notes: Vec<String>,
}

/// Bits of the position, and of the normal as f32: the published loader's vertices, whose mean is its centre. The
/// loader rounds positions to f32 too; that changes no vertex of the objects at hand, and would weld those of a mesh in
/// survey coordinates.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Corner {
    position: [u64; 3],
    normal: Option<[u32; 3]>,
}

/// A corner of a face: its position, and its normal where the file gives one.
pub(crate) type CornerData = ([f64; 3], Option<[f64; 3]>);

impl MeshBuilder {
    /// Adds a triangle, unless it is of no use.
    pub(crate) fn push(&mut self, corners: [CornerData; 3]) {
        if corners.iter().any(|(p, _)| p.iter().any(|&x| !(x as f32).is_finite())) {
            self.left_out += 1;
            return;
        }
        let triangle = corners.map(|(p, n)| self.vertex(p, n));
        let [a, b, c] = triangle.map(|i| self.vertices[i as usize]);
        // As positions, turned so that the smallest comes first: equal for a face given again.
        let mut ids = triangle.map(|i| self.position_of[i as usize]);
        let least = (0..3).min_by_key(|&k| ids[k]).unwrap_or(0);
        ids.rotate_left(least);
        let flat = ids[0] == ids[1] || ids[1] == ids[2] || ids[2] == ids[0] || (b - a).cross(&(c - a)).norm() == 0.0;
        if flat || !self.seen.insert(ids) {
            self.left_out += 1;
        } else {
            self.triangles.push(triangle);
        }
    }

    /// Adds a polygon, in triangles.
    pub(crate) fn push_polygon(
        &mut self,
        corners: &[CornerData],
        path: &Path,
        place: impl FnOnce() -> Place,
    ) -> Result<(), FormatError> {
        if let [a, b, c] = *corners {
            self.push([a, b, c]);
            return Ok(());
        }
        let Some(triangles) = polygon::triangulate(corners, &mut self.work) else {
            let found = format!("a concave polygon of {} corners", corners.len());
            let expected = "polygons that can be triangulated quickly: triangulate it in the program that made it";
            return Err(FormatError::syntax(path, place(), found, expected));
        };
        triangles.into_iter().for_each(|t| self.push(t.map(|i| corners[i])));
        Ok(())
    }

    fn vertex(&mut self, position: [f64; 3], normal: Option<[f64; 3]>) -> u32 {
        // + 0.0: -0 and 0 are one place.
        let key = Corner {
            position: position.map(|x| (x + 0.0).to_bits()),
            normal: normal.map(|n| n.map(|x| (x as f32 + 0.0).to_bits())),
        };
        let next = self.vertices.len() as u32;
        let index = *self.corners.entry(key).or_insert(next);
        if index == next {
            self.vertices.push(Point3::from(position));
            let fresh = self.positions.len() as u32;
            self.position_of.push(*self.positions.entry(key.position).or_insert(fresh));
        }
        index
    }

    /// The mesh; an error where no triangle is left.
    pub(crate) fn finish(mut self, path: &Path, found: impl FnOnce() -> String) -> Result<Mesh, FormatError> {
        if self.work.crossing > 0 {
            self.notes
                .push(format!("{} polygons intersect themselves: their triangles are a guess", self.work.crossing));
        }
        if self.triangles.is_empty() {
            let found = match self.left_out {
                0 => [found()].into_iter().chain(self.notes).collect::<Vec<_>>().join("; "),
                n => format!("{n} triangles, all without area or with non-finite coordinates"),
            };
            return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one triangle" });
        }
        self.notes.iter().for_each(|note| tracing::warn!("{path:?}: {note}"));
        Ok(Mesh { vertices: self.vertices, triangles: self.triangles })
    }
}
