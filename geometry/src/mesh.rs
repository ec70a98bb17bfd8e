//! Triangle meshes.

use nalgebra::Point3;

/// A triangle surface. Vertices are the distinct corners that faces use: for formats with normals the
/// distinct (position, normal) pairs, as the published loader yields them, so that [`Mesh::center`] is the
/// published centre; for formats without, the distinct positions. Triangle indices are always in range and
/// vertices always finite (readers and generators see to it).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corner positions, in the unit of the file.
    pub vertices: Vec<Point3<f64>>,
    /// Vertex indices, counter-clockwise seen from outside where the file is oriented.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Mean of the vertices; the origin for an empty mesh.
    pub fn center(&self) -> Point3<f64> {
        let sum = self.vertices.iter().fold(nalgebra::Vector3::zeros(), |s, v| s + v.coords);
        Point3::from(sum / self.vertices.len().max(1) as f64)
    }

    /// Smallest and largest corner of the axis-aligned bounding box; both the origin for an empty mesh.
    pub fn bounding_box(&self) -> (Point3<f64>, Point3<f64>) {
        crate::cloud::bounding_box(&self.vertices)
    }

    /// The mesh centred on the mean of its vertices and scaled so that its bounding-box diagonal is
    /// `diagonal` (docs/method.md: 0.2 m). A mesh without extent is only centred.
    pub fn normalized(&self, diagonal: f64) -> Mesh {
        let (low, high) = self.bounding_box();
        let extent = (high - low).norm();
        let scale = if extent > 0.0 { diagonal / extent } else { 1.0 };
        let center = self.center();
        let vertices = self.vertices.iter().map(|v| Point3::from((v - center) * scale)).collect();
        Mesh { vertices, triangles: self.triangles.clone() }
    }

    /// The three corners of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|i| self.vertices[i as usize])
    }

    /// Sum of the triangles' areas.
    pub fn area(&self) -> f64 {
        self.triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = self.corners(t);
                0.5 * (b - a).cross(&(c - a)).norm()
            })
            .sum()
    }
}
