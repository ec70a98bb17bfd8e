//! Any tree of meshes; the folder of a mesh is its category.

use super::{DatasetError, Found, describe, entries, extension};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// No collection of meshes is deeper.
const MAX_DEPTH: usize = 32;

pub(super) fn find(root: &Path) -> Result<Vec<Found>, DatasetError> {
    let mut found = vec![];
    visit(root, root, 0, &mut BTreeSet::new(), &mut found)?;
    if found.is_empty() {
        return Err(DatasetError::Layout {
            name: "mesh",
            root: root.to_owned(),
            found: describe(root),
            layout: "a tree of .off, .obj, .ply or .stl files",
            source_of_data: "any meshes can be used",
        });
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

/// Takes every directory once: links to one that was taken, be it on the way here, lead nowhere new.
fn visit(
    root: &Path,
    directory: &Path,
    depth: usize,
    taken: &mut BTreeSet<PathBuf>,
    found: &mut Vec<Found>,
) -> Result<(), DatasetError> {
    if !directory.canonicalize().is_ok_and(|place| taken.insert(place)) {
        return Ok(());
    }
    for path in entries(directory)? {
        if path.is_dir() {
            if depth < MAX_DEPTH {
                visit(root, &path, depth + 1, taken, found)?;
            }
        } else if formats::mesh::EXTENSIONS.contains(&extension(&path).as_str()) {
            let relative = path.strip_prefix(root).unwrap_or(&path);
            let slashes = |p: &Path| p.iter().map(|c| c.to_string_lossy()).collect::<Vec<_>>().join("/");
            let category =
                relative.parent().map(slashes).filter(|c| !c.is_empty()).unwrap_or_else(|| "folder".to_owned());
            found.push(Found { name: slashes(&relative.with_extension("")), category, path, half: None });
        }
    }
    Ok(())
}
