//! Training samples on disk: one safetensors file per object, ragged.
//!
//! Tensors (little endian; S samples, P points, C candidates and V cameras over all samples):
//! `points` [P, 3] and `normals` [P, 3] f32 or f16, `point_offsets` [S + 1] u64; `candidates` [C, 6] f64
//! (target, camera position), `density`, `scores`, `coverage`, `overlap` [C] f64, `num_candidates` [S] u32;
//! `cameras` [V, 7] f64 (quaternion x y z w, translation of `world_from_camera`), `num_cameras` [S] u32;
//! `current_coverage`, `working_distance` [S] f64; `scan_index`, `object` [S] u32. The metadata entry `shard` is
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
    /// Overlap of each candidate's scan with the cloud, in [0, 1]; NaN where a foreign set does not say.
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
    /// The objects in it, each with its split and curves; `object` in the tensors indexes this list.
    pub objects: Vec<ObjectRecord>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fate, FormatError, Split};
    use geometry::View;
    use nalgebra::{Point3, UnitQuaternion, Vector3};
    use proptest::prelude::*;
    use std::path::Path;

    fn record(name: &str) -> ObjectRecord {
        ObjectRecord { object: name.into(), category: "c".into(), split: Split::Train, fate: Fate::Missing }
    }

    fn sample(object: &str, scan_index: usize, num_points: usize, num_candidates: usize) -> Sample {
        let value = |i: usize| 0.1 + i as f64 / 64.0; // exact in f32 after rounding below
        let point = |i: usize| Point3::new(value(i), -value(i), value(i) * 2.0).map(|x| f64::from(x as f32));
        let candidate = |i: usize| CandidateView {
            view: View { target: point(i), position: Point3::new(1.0 / 3.0, i as f64, 1.2) },
            density: 100.0 / (i + 1) as f64,
        };
        Sample {
            object: object.into(),
            scan_index,
            cloud: PointCloud {
                points: (0..num_points).map(point).collect(),
                normals: (0..num_points).map(|i| point(i).coords).collect(),
            },
            candidates: (0..num_candidates).map(candidate).collect(),
            coverage: (0..num_candidates).map(value).collect(),
            overlap: (0..num_candidates).map(|i| value(i) / 3.0).collect(),
            scores: (0..num_candidates).map(|i| value(i) / 7.0).collect(),
            current_coverage: 1.0 / 3.0,
            working_distance: 1.2,
            cameras: (0..=scan_index)
                .map(|i| {
                    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, i as f64));
                    Isometry3::from_parts(Vector3::new(1.0, i as f64, 0.1).into(), rotation)
                })
                .collect(),
        }
    }

    fn write(path: &Path, samples: &[Sample], precision: CloudPrecision) {
        let mut objects: Vec<ObjectRecord> = Vec::new();
        for s in samples {
            if objects.iter().all(|o| o.object != s.object) {
                objects.push(record(&s.object));
            }
        }
        let metadata = ShardMetadata { config_hash: "abc".into(), seed: 7, objects, ..Default::default() };
        let mut writer = ShardWriter::new(metadata, precision);
        for s in samples {
            writer.push(s).unwrap();
        }
        writer.write(path).unwrap();
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.safetensors");
        let samples = [sample("x", 0, 50, 20), sample("x", 1, 0, 0), sample("y", 2, 3, 5)];
        write(&path, &samples, CloudPrecision::F32);
        let reader = ShardReader::open(&path).unwrap();
        assert_eq!(reader.len(), 3);
        assert_eq!(reader.metadata().seed, 7);
        reader.verify().unwrap();
        for (i, s) in samples.iter().enumerate() {
            assert_eq!(&reader.sample(i).unwrap(), s, "sample {i}");
        }
        let bytes = std::fs::read(&path).unwrap();
        write(&path, &samples, CloudPrecision::F32);
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "the same samples must give the same bytes");
    }

    #[test]
    fn half_precision_clouds_are_within_their_bound() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.safetensors");
        let mut s = sample("x", 0, 40, 3);
        s.cloud.points.iter_mut().for_each(|p| *p *= 0.1);
        write(&path, std::slice::from_ref(&s), CloudPrecision::F16);
        let read = ShardReader::open(&path).unwrap().sample(0).unwrap();
        for (a, b) in read.cloud.points.iter().zip(&s.cloud.points) {
            assert!((a - b).amax() < 1e-4 * b.coords.amax().max(0.03) * 5.0, "{a} {b}");
        }
        assert_eq!(read.scores, s.scores, "only clouds lose digits");
    }

    #[test]
    fn damage_is_found_and_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("chair_0007.safetensors");
        write(&path, &[sample("x", 0, 50, 20)], CloudPrecision::F32);
        let good = std::fs::read(&path).unwrap();
        crate::checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
            std::fs::write(&path, bad).unwrap();
            ShardReader::open(&path).map(drop).map_err(|e| e.to_string())
        });
        for length in (0..good.len()).step_by(97) {
            std::fs::write(&path, &good[..length]).unwrap();
            assert!(ShardReader::open(&path).is_err(), "{length} of {} bytes", good.len());
        }
        assert!(matches!(ShardReader::open(dir.path().join("none").as_path()), Err(FormatError::Io { .. })));
    }

    #[test]
    fn a_shard_that_is_cut_or_replaced_while_it_is_open_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.safetensors");
        let first = [sample("x", 0, 5000, 20)];
        write(&path, &first, CloudPrecision::F32);
        let reader = ShardReader::open(&path).unwrap();
        assert_eq!(reader.sample(0).unwrap(), first[0]);
        std::fs::File::options().write(true).open(&path).unwrap().set_len(1000).unwrap();
        let text = reader.sample(0).expect_err("cut").to_string();
        assert!(text.contains("changed while it was in use") && text.contains("a.safetensors"), "{text}");
        write(&path, &[sample("x", 1, 5000, 20)], CloudPrecision::F32);
        assert!(matches!(reader.sample(0), Err(FormatError::Changed { .. })), "of the same length, but another");
    }

    #[test]
    fn numbers_that_cannot_be_are_refused() {
        let good = sample("x", 1, 9, 4);
        good.check().unwrap();
        let foreign = Sample { coverage: vec![f64::NAN; 4], current_coverage: f64::NAN, ..good.clone() };
        foreign.check().expect("NaN where a foreign set does not say");
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.safetensors");
        let refused = |edit: &dyn Fn(&mut Sample), word: &str| {
            let mut bad = good.clone();
            edit(&mut bad);
            write(&path, &[good.clone(), bad], CloudPrecision::F32);
            let text = ShardReader::open(&path).unwrap().verify().expect_err(word).to_string();
            assert!(text.contains("sample 1") && text.contains(word), "{word}: {text}");
        };
        refused(&|s| s.cloud.points[3].x = f64::NAN, "point 3");
        refused(&|s| s.cloud.normals[2].y = f64::INFINITY, "normal 2");
        refused(&|s| s.candidates[1].density = -1.0, "candidate 1");
        refused(&|s| s.candidates[1].density = f64::INFINITY, "candidate 1");
        refused(&|s| s.scores[2] = f64::NAN, "score 2 is NaN");
        refused(&|s| s.coverage[0] = -0.1, "coverage -0.1");
        refused(&|s| s.overlap[0] = 1.5, "overlap 1.5");
        refused(&|s| s.current_coverage = -1.0, "current_coverage -1");
        refused(&|s| s.working_distance = f64::NAN, "working_distance NaN");
        refused(&|s| s.working_distance = -1.2, "working_distance -1.2");
        refused(&|s| s.cameras[1].translation.vector.z = f64::NAN, "camera 1");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn any_mutation_is_an_error_or_a_shard(edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.safetensors");
            write(&path, &[sample("x", 0, 9, 4), sample("x", 1, 5, 2)], CloudPrecision::F32);
            let mut bytes = std::fs::read(&path).unwrap();
            for (at, value) in edits {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            crate::checksum::seal(&mut bytes, CHECKSUM);
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(reader) = ShardReader::open(&path) {
                for i in 0..reader.len() {
                    let _ = reader.sample(i).map(|s| s.check());
                }
            }
        }
    }
}
