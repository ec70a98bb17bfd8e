//! Collision meshes of links, found as ROS finds them.

use super::xml::Element;
use crate::mesh::read_mesh;
use geometry::Mesh;
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// The mesh of a `<mesh filename=... scale=...>` in the URDF at `urdf`, in its link's unit.
///
/// # Errors
/// Why it cannot be used: for a note.
pub fn collision_mesh(urdf: &Path, element: &Element) -> Result<Mesh, String> {
    let name = element.attribute("filename").ok_or("a collision mesh without a filename")?;
    let scale = match element.attribute("scale") {
        None => [1.0; 3],
        text => super::triple(text)
            .ok_or_else(|| format!("the collision mesh {name} has scale {text:?}, not three numbers"))?,
    };
    let path = find(urdf, name).ok_or_else(|| format!("the collision mesh {name} is not found next to {urdf:?}"))?;
    let mut mesh = read_mesh(&path).map_err(|e| format!("the collision mesh cannot be read: {e}"))?;
    for vertex in &mut mesh.vertices {
        *vertex = Point3::from([0, 1, 2].map(|k| vertex[k] * scale[k]));
    }
    if mesh.vertices.iter().any(|v| v.iter().any(|x| !x.is_finite() || x.abs() > 100.0)) {
        return Err(format!("the collision mesh {name} reaches beyond 100 m: is its scale right?"));
    }
    Ok(mesh)
}

/// A file named by `package://PACKAGE/PATH`, `file://PATH` or a path from the URDF's folder. Packages are folders above the URDF, or beside
/// those.
fn find(urdf: &Path, name: &str) -> Option<PathBuf> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    let Some(name) = name.strip_prefix("package://") else {
        return Some(folder.join(name.strip_prefix("file://").unwrap_or(name))).filter(|path| path.is_file());
    };
    let (_, inside) = name.split_once('/')?;
    let absolute = std::path::absolute(folder).ok()?;
    absolute.ancestors().flat_map(|above| [above.join(inside), above.join(name)]).find(|path| path.is_file())
}
