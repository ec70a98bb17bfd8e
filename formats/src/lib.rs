//! Everything that becomes or comes from bytes, network weights excepted: meshes, clouds, depth images,
//! shards, the authors' frame history, configuration, run directories.
//!
//! Readers take files that others made: every error names the file, the place in it, what was found and what
//! was expected. No reader allocates more than the size of its file warrants, whatever a header claims.

pub mod camera;
pub mod checksum;
pub mod cloud;
pub mod config;
pub mod declared;
pub mod depth;
pub mod error;
pub mod file;
pub mod frame_history;
pub mod html;
mod json;
pub mod lock;
pub mod manifest;
pub mod mesh;
pub mod ply;
pub mod poses;
#[cfg(feature = "program")]
pub mod program;
pub mod run;
pub mod sequence;
pub mod shard;
pub mod surface;
mod text;
pub mod urdf;
mod yaml;

pub use cloud::{CloudFile, read_cloud};
pub use config::{ConfigError, Flag};
pub use error::{FormatError, Place};
pub use manifest::{Manifest, ObjectRecord, ObjectStatus, Split};
pub use mesh::read_mesh;
pub use shard::{CloudPrecision, Sample, ShardMetadata, ShardReader, ShardWriter};

/// The ending of a file's name, lower case, without the dot.
fn extension(path: &std::path::Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}
