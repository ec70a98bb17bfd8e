//! The commit that a program was built from. A separate crate, so that a commit rebuilds the four programs and nothing below them.

/// Commit of the source tree at the time of the build, `-dirty` where tracked files were changed; `unknown` where git was
/// not to be had or the tree is no clone; `development` in unoptimised builds, which do not follow every commit.
pub const COMMIT: &str = env!("BUILT_COMMIT");

/// Version and commit, as `--version` prints them.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("BUILT_COMMIT"), ")");
