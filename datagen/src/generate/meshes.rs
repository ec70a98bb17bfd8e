//! Which meshes the shards of a set were made from: a shard is named after its object, and files of the same names may hold others.

use super::{GenerateError, Job, shard_path};
use crate::dataset::{Object, Source};
use formats::{FormatError, ShardReader};
use rayon::prelude::*;

/// Objects that a message names.
const NAMED: usize = 5;

/// Digest of an object's mesh file; empty for what is built in, which follows from the settings.
pub(super) fn digest(object: &Object) -> Result<String, FormatError> {
    match &object.source {
        Source::File(path) => Ok(formats::config::digest(&formats::file::read(path)?)),
        Source::Sequence(_) | Source::Procedural { .. } => Ok(String::new()),
    }
}

/// Refuses shards that were made from other meshes than those of this process's objects. Writes nothing.
pub(super) fn check(job: &Job) -> Result<(), GenerateError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(job.jobs).build()?;
    let others: Vec<&Object> =
        pool.install(|| job.mine().into_par_iter().filter(|object| is_other(job, object)).collect());
    if others.is_empty() {
        return Ok(());
    }
    let mut objects = others.iter().take(NAMED).map(|o| o.name.as_str()).collect::<Vec<_>>().join(", ");
    if others.len() > NAMED {
        objects += &format!(" and {} more", others.len() - NAMED);
    }
    Err(GenerateError::OtherMeshes { out: job.out.to_owned(), objects })
}

/// Whether an object's shard was made from another mesh. Older shards do not say; a damaged one is made anew, and a mesh that
/// cannot be read is reported as such when its shard has to be made.
fn is_other(job: &Job, object: &Object) -> bool {
    let Ok(shard) = ShardReader::peek(&shard_path(job.out, &object.name)) else { return false };
    !shard.mesh.is_empty() && digest(object).is_ok_and(|mesh| mesh != shard.mesh)
}
