//! The '3D Repository': the paper's evaluation objects, from the Stanford 3D Scanning Repository and Georgia Tech's
//! Large Geometric Models Archive. For evaluation alone.

use super::{DatasetError, Found, SplitChoice, describe, entries, extension, stem};
use std::path::Path;

const OBJECTS: [&str; 8] =
    ["armadillo", "blade", "bunny", "dragon", "happyBuddha", "horse", "statue_of_liberty", "teapot"];

pub(super) fn find(root: &Path, choice: SplitChoice) -> Result<Vec<Found>, DatasetError> {
    if choice == SplitChoice::Train {
        let text = "the objects of repository3d are only for evaluation; omit --split, or train on another data set";
        return Err(DatasetError::Choice(text.to_owned()));
    }
    let mut found = vec![];
    for path in entries(root)?.into_iter().filter(|path| path.is_file()) {
        let name = OBJECTS.iter().find(|name| name.eq_ignore_ascii_case(&stem(&path)));
        let Some(name) = name.filter(|_| formats::mesh::EXTENSIONS.contains(&extension(&path).as_str())) else {
            continue;
        };
        let (name, category) = (name.to_string(), "repository3d".to_owned());
        if found.iter().all(|f: &Found| f.name != name) {
            found.push(Found { name, category, path, half: None });
        }
    }
    if found.is_empty() {
        return Err(DatasetError::Layout {
            name: "3D Repository",
            root: root.to_owned(),
            found: describe(root),
            layout: "meshes (.obj, .ply, .off or .stl) named armadillo, blade, bunny, dragon, happyBuddha, horse, statue_of_liberty, teapot, any of them",
            source_of_data: "download them from https://graphics.stanford.edu/data/3Dscanrep (scripts/fetch-data does) and https://www.cc.gatech.edu/projects/large_models; the meshes used in the paper come with the authors' code at https://github.com/leihui6/BENBV",
        });
    }
    Ok(found)
}
