//! Everything that becomes or comes from bytes, network weights excepted: meshes, clouds, depth images,
//! shards, the authors' frame history, configuration, run directories.
//!
//! Readers take files that others made: every error names the file, the place in it, what was found and what
//! was expected. No reader allocates more than the size of its file warrants, whatever a header claims.

pub mod config;
pub mod error;
pub mod manifest;
pub mod run;
pub mod shard;

pub use config::{ConfigError, Flag};
pub use error::{FormatError, Place};
pub use manifest::{Fate, Manifest, ObjectRecord, Split};
pub use shard::{CloudPrecision, Sample, ShardMetadata, ShardReader, ShardWriter};
