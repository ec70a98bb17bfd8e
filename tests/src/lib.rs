//! Fixtures shared by the tests that span crates.

use std::path::PathBuf;

/// Root of the repository.
pub fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Data that lies beside the clone on the project's own machines; `None`, said in words, in a user's clone.
pub fn shared(part: &str) -> Option<PathBuf> {
    let path = root().join("../shared").join(part);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {part} of the project's shared data is not beside this clone");
    None
}
