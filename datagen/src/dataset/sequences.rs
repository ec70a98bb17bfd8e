//! Recorded sequences: folders with `sequence.json`, or one such folder itself. For `evaluate` alone.

use super::{DatasetError, Found, describe, entries, file_name};
use formats::sequence::SEQUENCE;
use std::path::Path;

pub(super) fn find(root: &Path) -> Result<Vec<Found>, DatasetError> {
    let of = |folder: &Path| {
        let path = folder.join(SEQUENCE);
        let (name, category) = (file_name(folder), "sequences".to_owned());
        path.is_file().then_some(Found { name, category, path, half: None })
    };
    let found: Vec<Found> = match of(&root.canonicalize().unwrap_or_else(|_| root.to_owned())) {
        Some(found) => vec![found],
        None => entries(root)?.iter().filter_map(|folder| of(folder)).collect(),
    };
    if found.is_empty() {
        return Err(DatasetError::Layout {
            name: "recorded sequence",
            root: root.to_owned(),
            found: describe(root),
            layout: "folders of scans, each with a sequence.json",
            source_of_data: "docs/formats.md describes that file",
        });
    }
    Ok(found)
}
