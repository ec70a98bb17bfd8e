//! Names that stay apart on every disk: an object's name becomes that of its files.

use super::{DatasetError, Found, extension};
use std::collections::BTreeMap;
use std::path::Path;

/// Bytes of a part of a name; file systems allow 255, of which endings and temporary siblings take their share.
const LONGEST: usize = 160;

/// Gives every model a unique name, ignoring case: those that share one get the ending of their file
/// (`a.obj`, `a.stl`), and where that does not do (`a.off` beside `a.OFF`, names that are no Unicode), the digest of their
/// path below the root. So names depend neither on the order of the models nor on where the root lies.
///
/// # Errors
/// Two models that still share a name.
pub(super) fn distinct(root: &Path, mut found: Vec<Found>) -> Result<Vec<Found>, DatasetError> {
    found.iter_mut().for_each(|f| f.name = fit(&f.name));
    rename_shared(&mut found, |f| format!("{}.{}", f.name, extension(&f.path)));
    rename_shared(&mut found, |f| {
        let below = f.path.strip_prefix(root).unwrap_or(&f.path);
        format!("{}~{}", f.name, formats::config::digest(below.as_os_str().as_encoded_bytes()))
    });
    let mut seen = BTreeMap::<String, &Found>::new();
    for f in &found {
        if let Some(other) = seen.insert(f.name.to_lowercase(), f) {
            let text = format!("{:?} and {:?} are both called {:?}; rename one", other.path, f.path, f.name);
            return Err(DatasetError::Choice(text));
        }
    }
    Ok(found)
}

fn rename_shared(found: &mut [Found], name: impl Fn(&Found) -> String) {
    let mut uses = BTreeMap::<String, usize>::new();
    for f in &*found {
        *uses.entry(f.name.to_lowercase()).or_default() += 1;
    }
    for f in found.iter_mut().filter(|f| uses[&f.name.to_lowercase()] > 1) {
        f.name = name(f);
    }
}

/// The name with each of its parts short enough, and none that looks like the file of another object.
fn fit(name: &str) -> String {
    let parts = name.split('/').map(|part| {
        let like_a_file = [".safetensors", ".json"].iter().any(|ending| part.to_lowercase().ends_with(ending));
        if part.len() <= LONGEST && !like_a_file {
            return part.to_owned();
        }
        let end = (0..=LONGEST.min(part.len())).rev().find(|&i| part.is_char_boundary(i)).unwrap_or(0);
        format!("{}~{}", &part[..end], formats::config::digest(part.as_bytes()))
    });
    parts.collect::<Vec<_>>().join("/")
}
