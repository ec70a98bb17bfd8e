//! ShapeNetCore (Chang et al. 2015), versions 1 and 2. It comes unsplit: a fixed fifth, by name, is for testing.

use super::{DatasetError, Found, SplitChoice, describe, entries, file_name};
use rand::RngExt;
use std::path::Path;

pub(super) fn find(root: &Path) -> Result<Vec<Found>, DatasetError> {
    let mut found = vec![];
    for category in entries(root)? {
        for model in entries(&category)? {
            let files = ["model.obj", "models/model_normalized.obj"].map(|file| model.join(file));
            let Some(path) = files.into_iter().find(|path| path.is_file()) else { continue };
            let category = file_name(&category);
            let name = format!("{category}/{}", file_name(&model));
            // Not of the run's seed: no object may change sides from one run to the next.
            let test = geometry::rng::stream(0, &format!("shapenet/{name}")).random_bool(0.2);
            let half = Some(if test { SplitChoice::Test } else { SplitChoice::Train });
            found.push(Found { name, category, path, half });
        }
    }
    if found.is_empty() {
        return Err(DatasetError::Layout {
            name: "ShapeNetCore",
            root: root.to_owned(),
            found: describe(root),
            layout: "<synset>/<id>/model.obj (version 1) or <synset>/<id>/models/model_normalized.obj (version 2), e.g. 02691156/10155655850468db78d106ce0a280f87/model.obj",
            source_of_data: "download it from https://shapenet.org after registering (ShapeNetCore.v1 or .v2) and unpack the synsets into that directory",
        });
    }
    Ok(found)
}
