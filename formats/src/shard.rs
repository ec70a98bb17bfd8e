//! Training samples on disk: one safetensors file per object, ragged.
//!
//! Tensors (little endian; S samples, P points, C candidates and V cameras over all samples):
//! `points` `[P, 3]` and `normals` `[P, 3]` f32 or f16, `point_offsets` `[S + 1]` u64; `candidates` `[C, 6]` f64
//! (target, camera position), `density`, `scores`, `coverage`, `overlap` `[C]` f64, `num_candidates` `[S]` u32;
//! `cameras` `[V, 7]` f64 (quaternion x y z w, translation of `world_from_camera`), `num_cameras` `[S]` u32;
//! `current_coverage`, `working_distance` `[S]` f64; `scan_index`, `object` `[S]` u32. The metadata entry `shard` is
//! the JSON of [`ShardMetadata`]; its `sha256` covers the whole file with its own digits set to zero.

mod read;
mod write;

pub use read::ShardReader;
pub use write::ShardWriter;

use crate::ObjectRecord;
use geometry::PointCloud;
use nalgebra::Isometry3;
use planning::{CandidateView, Observation};
use serde::{Deserialize, Serialize};

/// Version of the layout above.
pub const SCHEMA_VERSION: u32 = 1;

/// What stands before the digits of a shard's checksum: JSON within a JSON string, hence the backslashes.
pub const CHECKSUM: &[u8] = br#"\"sha256\":\""#;

/// The one entry of the file's metadata.
const METADATA: &str = "shard";

/// One decision of an episode: what was known, which views were offered, and what each would have brought.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Name of the object, e.g. `airplane/airplane_0001`.
    pub object: String,
    /// Number of scans done minus one: 0 for the first decision (the network's view order).
    pub scan_index: usize,
    /// The accumulated cloud, world frame, metres; f32 or f16 on disk.
    pub cloud: PointCloud,
    /// Candidates in the order of the greedy traversal, each with its density.
    pub candidates: Vec<CandidateView>,
    /// Coverage after each candidate's scan, in [0, 1]; NaN where a foreign set does not say.
    pub coverage: Vec<f64>,
    /// Overlap of each candidate's scan with the cloud, in [0, 1]; NaN for an empty scan, and where a foreign set does not say.
    pub overlap: Vec<f64>,
    /// Score of each candidate (docs/method.md, 'Score'), in [0, 1].
    pub scores: Vec<f64>,
    /// Coverage before the decision; NaN where a foreign set does not say.
    pub current_coverage: f64,
    /// Distance from target to camera, metres.
    pub working_distance: f64,
    /// `world_from_camera` of every scan in the cloud, oldest first.
    pub cameras: Vec<Isometry3<f64>>,
}

impl Sample {
    /// What the network is shown of this sample.
    pub fn observation(&self) -> Observation<'_> {
        Observation {
            cloud: &self.cloud,
            candidates: &self.candidates,
            view_order: self.scan_index,
            working_distance: self.working_distance,
            cameras: self.cameras.iter().map(|c| c.translation.vector.into()).collect(),
        }
    }

    /// Whether every number can be: finite lengths, shares in [0, 1] (NaN where a foreign set does not say), views with a
    /// direction, a distance above 0.
    ///
    /// # Errors
    /// The first that cannot.
    pub fn check(&self) -> Result<(), OddNumber> {
        let odd = |found: String, expected| Err(OddNumber { found, expected });
        let bad = |v: &nalgebra::Vector3<f64>| v.iter().any(|x| !x.is_finite());
        if let Some(i) = self.cloud.points.iter().position(|p| bad(&p.coords)) {
            return odd(format!("point {i} is not finite"), "finite numbers");
        }
        if let Some(i) = self.cloud.normals.iter().position(bad) {
            return odd(format!("normal {i} is not finite"), "finite numbers");
        }
        let unfit = |c: &CandidateView| !c.view.is_valid() || !c.density.is_finite() || c.density < 0.0;
        if let Some(i) = self.candidates.iter().position(unfit) {
            return odd(format!("candidate {i} is {:?}", self.candidates[i]), "a view with a direction and a density");
        }
        if let Some(i) = self.scores.iter().position(|s| !(0.0..=1.0).contains(s)) {
            return odd(format!("score {i} is {}", self.scores[i]), "a number from 0 to 1");
        }
        let shares = [("coverage", &self.coverage), ("overlap", &self.overlap)];
        let all = shares.iter().flat_map(|(name, list)| list.iter().map(move |x| (*name, *x)));
        for (name, share) in all.chain([("current_coverage", self.current_coverage)]) {
            if !(share.is_nan() || (0.0..=1.0).contains(&share)) {
                return odd(format!("{name} {share}"), "0 to 1, or NaN where it is not known");
            }
        }
        if !(self.working_distance > 0.0 && self.working_distance.is_finite()) {
            return odd(format!("working_distance {}", self.working_distance), "a length above 0");
        }
        let skew = |c: &Isometry3<f64>| bad(&c.translation.vector) || (c.rotation.coords.norm() - 1.0).abs() > 1e-6;
        match self.cameras.iter().position(|c| skew(c) || c.rotation.coords.iter().any(|x| x.is_nan())) {
            Some(i) => odd(format!("camera {i} is {:?}", self.cameras[i]), "a rigid motion"),
            None => Ok(()),
        }
    }
}

/// A number of a sample that cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{found}, expected {expected}")]
pub struct OddNumber {
    /// Which, and its value.
    pub found: String,
    /// What would do.
    pub expected: &'static str,
}

/// How clouds are stored; everything else is f64.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CloudPrecision {
    /// 24 bytes per point.
    #[default]
    F32,
    /// 12 bytes per point, within 0.03 mm for objects of 0.2 m around the origin.
    F16,
}

/// What a shard says of itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardMetadata {
    /// [`SCHEMA_VERSION`] of the writer.
    pub schema_version: u32,
    /// Checksum of the file; see the module's head.
    pub sha256: String,
    /// [`crate::config::hash`] of the settings that made it.
    pub config_hash: String,
    /// The run's seed.
    pub seed: u64,
    /// Commit of the source tree.
    pub commit: String,
    /// [`crate::config::digest`] of the mesh file that it was made from; empty where there was none, and in shards of older
    /// programs.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub mesh: String,
    /// The objects in it, each with its split and curves; `object` in the tensors indexes this list.
    pub objects: Vec<ObjectRecord>,
}

#[cfg(test)]
mod tests;
