//! ModelNet40 (Wu et al. 2015): 40 categories, split into training and test.

use super::{DatasetError, Found, SplitChoice, describe, entries, extension, file_name, stem};
use std::path::Path;

pub(super) fn find(root: &Path) -> Result<Vec<Found>, DatasetError> {
    let mut found = vec![];
    for category in entries(root)? {
        for (half, choice) in [("train", SplitChoice::Train), ("test", SplitChoice::Test)] {
            for path in entries(&category.join(half))? {
                if extension(&path) == "off" && path.is_file() {
                    let category = file_name(&category);
                    found.push(Found {
                        name: format!("{category}/{}", stem(&path)),
                        category,
                        path,
                        half: Some(choice),
                    });
                }
            }
        }
    }
    if found.is_empty() {
        return Err(DatasetError::Layout {
            name: "ModelNet40",
            root: root.to_owned(),
            found: describe(root),
            layout: "<category>/{train,test}/*.off, e.g. airplane/train/airplane_0001.off",
            source_of_data: "download it from https://modelnet.cs.princeton.edu (ModelNet40.zip, 2 GB; scripts/fetch-data does) and unpack it so that the categories are in that directory",
        });
    }
    Ok(found)
}
