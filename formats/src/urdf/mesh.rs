//! Collision meshes of links, found as ROS finds them.

use super::xml::Element;
use crate::mesh::read_mesh;
use geometry::Mesh;
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// The mesh of a `<mesh filename=... scale=...>` in the URDF at `urdf`, in its link's unit, and what a user should know of where it was
/// found.
///
/// # Errors
/// Why it cannot be used: for a note.
pub fn collision_mesh(urdf: &Path, element: &Element) -> Result<(Mesh, Option<String>), String> {
    let name = element.attribute("filename").ok_or("a collision mesh without a filename")?;
    let scale = match element.attribute("scale") {
        None => [1.0; 3],
        text => super::triple(text)
            .ok_or_else(|| format!("the collision mesh {name} has scale {text:?}, not three numbers"))?,
    };
    let (path, note) = find(urdf, name, &prefixes())?;
    let mut mesh = read_mesh(&path).map_err(|e| format!("the collision mesh cannot be read: {e}"))?;
    for vertex in &mut mesh.vertices {
        *vertex = Point3::from([0, 1, 2].map(|k| vertex[k] * scale[k]));
    }
    if mesh.vertices.iter().any(|v| v.iter().any(|x| !x.is_finite() || x.abs() > 100.0)) {
        return Err(format!("the collision mesh {name} reaches beyond 100 m: is its scale right?"));
    }
    Ok((mesh, note))
}

/// Where ROS 2 looks for installed packages.
fn prefixes() -> Vec<PathBuf> {
    std::env::var_os("AMENT_PREFIX_PATH").map_or_else(Vec::new, |paths| std::env::split_paths(&paths).collect())
}

/// A file named by `package://PACKAGE/PATH`, `file://PATH` or a path from the URDF's folder. A package is a folder of its name above the
/// URDF, beside one of those or installed there (colcon's `PACKAGE/share/PACKAGE`), or installed under one of `prefixes`. A folder of another
/// name is taken for it where nothing else is found: said, since another package may have a file of the same name.
///
/// # Errors
/// The file is nowhere, and where it may be.
pub(super) fn find(urdf: &Path, name: &str, prefixes: &[PathBuf]) -> Result<(PathBuf, Option<String>), String> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    let Some(name) = name.strip_prefix("package://") else {
        let path = folder.join(name.strip_prefix("file://").unwrap_or(name));
        let missing = || format!("the collision mesh {name} is not found: expected it at {path:?}");
        return if path.is_file() { Ok((path, None)) } else { Err(missing()) };
    };
    let missing = |package: &str| {
        format!(
            "the collision mesh package://{name} is not found: put the package's folder {package:?} above {urdf:?} or beside one of the \
             folders there, or source its workspace (AMENT_PREFIX_PATH)"
        )
    };
    let (package, inside) = name.split_once('/').ok_or_else(|| missing(name))?;
    let absolute = std::path::absolute(folder).map_err(|_| missing(package))?;
    let shared = Path::new("share").join(name);
    let named = absolute.ancestors().flat_map(|above| {
        let itself = above.file_name().filter(|folder| *folder == package).map(|_| above.join(inside));
        itself.into_iter().chain([above.join(name), above.join(package).join(&shared)])
    });
    let installed = prefixes.iter().map(|prefix| prefix.join(&shared));
    if let Some(path) = named.chain(installed).find(|path| path.is_file()) {
        return Ok((path, None));
    }
    let other = absolute.ancestors().map(|above| above.join(inside)).find(|path| path.is_file());
    let path = other.ok_or_else(|| missing(package))?;
    let note =
        format!("no folder of the package {package:?} has the collision mesh {inside}: {path:?} was used instead");
    Ok((path, Some(note)))
}
