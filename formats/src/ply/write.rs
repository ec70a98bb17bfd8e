//! PLY files that we write: binary, doubles.

use crate::FormatError;
use crate::run::atomic_write_with;
use geometry::PointCloud;
use nalgebra::{Point3, Vector3};
use std::io::Write;
use std::path::Path;

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

fn write_vector(out: &mut dyn Write, vector: &Vector3<f64>) -> std::io::Result<()> {
    vector.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
