//! Meshes that we write: binary PLY with normals and colours, binary STL.

use crate::FormatError;
use crate::run::atomic_write_with;
use geometry::Reconstruction;
use nalgebra::Vector3;
use std::io::Write;
use std::path::Path;

/// Measured surface, and where it ends: grey and orange.
const COLORS: [[u8; 3]; 2] = [[170, 180, 190], [255, 140, 26]];

/// Writes the surface that was measured, metres. PLY holds a normal and a colour per vertex, and `rim`, 1 where the surface ends;
/// STL the triangles alone. The ending of the name says which.
///
/// # Errors
/// Another ending, a surface without triangles, what the operating system refuses.
pub fn write_surface(path: &Path, surface: &Reconstruction) -> Result<(), FormatError> {
    match crate::extension(path).as_str() {
        "ply" => write_ply(path, surface),
        "stl" => write_stl(path, surface),
        found => Err(FormatError::UnknownType {
            path: path.to_owned(),
            found: format!(".{found}"),
            expected: ".ply or .stl",
        }),
    }
}

fn write_ply(path: &Path, surface: &Reconstruction) -> Result<(), FormatError> {
    let mesh = &surface.mesh;
    atomic_write_with(path, |out| {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\ncomment metres; rim: 1 where the measured surface ends\nelement vertex {}\n\
             property double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\nproperty float nz\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar rim\nelement face {}\n\
             property list uchar uint vertex_indices\nend_header\n",
            mesh.vertices.len(),
            mesh.triangles.len()
        )?;
        for ((vertex, normal), rim) in mesh.vertices.iter().zip(&surface.normals).zip(&surface.rim) {
            vertex.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
            floats(out, normal)?;
            out.write_all(&COLORS[usize::from(*rim)])?;
            out.write_all(&[u8::from(*rim)])?;
        }
        for triangle in &mesh.triangles {
            out.write_all(&[3])?;
            triangle.iter().try_for_each(|i| out.write_all(&i.to_le_bytes()))?;
        }
        Ok(())
    })
}

fn write_stl(path: &Path, surface: &Reconstruction) -> Result<(), FormatError> {
    let mesh = &surface.mesh;
    atomic_write_with(path, |out| {
        // Must not begin with "solid", which text files do.
        out.write_all(&format!("{:80}", "binary STL, metres").into_bytes())?;
        out.write_all(&u32::try_from(mesh.triangles.len()).map_err(std::io::Error::other)?.to_le_bytes())?;
        for &triangle in &mesh.triangles {
            let [a, b, c] = mesh.corners(triangle);
            floats(out, &(b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::zeros))?;
            [a, b, c].iter().try_for_each(|corner| floats(out, &corner.coords))?;
            out.write_all(&[0; 2])?;
        }
        Ok(())
    })
}

fn floats(out: &mut dyn Write, vector: &Vector3<f64>) -> std::io::Result<()> {
    vector.iter().try_for_each(|x| out.write_all(&(*x as f32).to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::read_mesh;
    use geometry::Mesh;
    use nalgebra::Point3;

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let mesh = Mesh {
            vertices: vec![
                Point3::origin(),
                Point3::new(0.5, 0.0, 0.0),
                Point3::new(0.0, 0.25, 0.0),
                Point3::new(0.0, 0.0, 1.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        };
        let surface = Reconstruction { normals: vec![Vector3::z(); 4], rim: vec![true, false, true, true], mesh };
        for name in ["a.ply", "a.STL"] {
            let path = folder.path().join(name);
            write_surface(&path, &surface).expect("written");
            let read = read_mesh(&path).expect("read");
            let corners = |mesh: &Mesh| mesh.triangles.iter().map(|t| mesh.corners(*t)).collect::<Vec<_>>();
            assert_eq!(corners(&read), corners(&surface.mesh), "{name}");
        }
        let refused = write_surface(&folder.path().join("a.obj"), &surface).expect_err("an ending").to_string();
        assert!(refused.contains("a.obj") && refused.contains(".ply or .stl"), "{refused}");
    }
}
