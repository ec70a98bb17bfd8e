//! Reading a shard.

use super::{SCHEMA_VERSION, Sample, ShardMetadata};
use crate::FormatError;
use crate::error::Place;
use crate::run::hex;
use geometry::{PointCloud, View};
use half::f16;
use memmap2::Mmap;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use planning::CandidateView;
use safetensors::tensor::{Dtype, SafeTensors};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The one entry of the file's metadata.
pub(super) const METADATA: &str = "shard";

/// A memory-mapped shard. Opening checks that all counts agree, so that reading a sample cannot fail.
#[derive(Debug)]
pub struct ShardReader {
    path: PathBuf,
    map: Mmap,
    metadata: ShardMetadata,
    tensors: BTreeMap<&'static str, Range<usize>>,
    cloud_type: Dtype,
    has_normals: bool,
    points: Vec<usize>,
    candidates: Vec<usize>,
    cameras: Vec<usize>,
}

impl ShardReader {
    /// Opens a shard and checks its header and counts (not its checksum: [`ShardReader::verify`]).
    ///
    /// # Errors
    /// An unreadable file, a damaged or foreign header, another schema version, counts that do not agree.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = File::open(path).map_err(|e| FormatError::io(path, "open", e))?;
        // SAFETY: shards are written to a temporary sibling and renamed, never changed in place, so the mapped
        // pages stay as they are; every access is bounds-checked.
        let map = unsafe { Mmap::map(&file) }.map_err(|e| FormatError::io(path, "map", e))?;
        let part = |name: &str| Place::Part(name.to_owned());
        let header = |e: safetensors::SafeTensorError| {
            FormatError::syntax(path, part("header"), e.to_string(), "a safetensors file as datagen writes it")
        };
        let (start, info) = SafeTensors::read_metadata(&map).map_err(header)?;
        let start = start + 8;
        let text = info.metadata().as_ref().and_then(|m| m.get(METADATA)).ok_or_else(|| {
            FormatError::syntax(path, part("metadata"), "no entry \"shard\"", "a shard as datagen writes it")
        })?;
        let version = serde_json::from_str::<serde_json::Value>(text)
            .ok()
            .and_then(|v| v.get("schema_version")?.as_u64())
            .ok_or_else(|| FormatError::syntax(path, part("metadata"), text.as_str(), "JSON with a schema_version"))?;
        if version != u64::from(SCHEMA_VERSION) {
            let found = u32::try_from(version).unwrap_or(u32::MAX);
            return Err(FormatError::Version { path: path.to_owned(), found, expected: SCHEMA_VERSION });
        }
        let metadata: ShardMetadata = serde_json::from_str(text)
            .map_err(|e| FormatError::syntax(path, part("metadata"), e.to_string(), "the JSON of a shard"))?;

        let mut tensors = BTreeMap::new();
        let mut rows = BTreeMap::new();
        let mut cloud_type = Dtype::F32;
        for (name, dtypes, columns) in TENSORS {
            let tensor = info
                .info(name)
                .ok_or_else(|| FormatError::syntax(path, part(name), "no such tensor", "all tensors of a shard"))?;
            let expected = if *columns == 1 { 1 } else { 2 };
            let shape = &tensor.shape;
            if !dtypes.contains(&tensor.dtype) || shape.len() != expected || (*columns > 1 && shape[1] != *columns) {
                return Err(FormatError::syntax(
                    path,
                    part(name),
                    format!("{:?} {shape:?}", tensor.dtype),
                    format!("{dtypes:?} with {columns} columns"),
                ));
            }
            if *name == "points" {
                cloud_type = tensor.dtype;
            }
            if *name == "normals" && tensor.dtype != cloud_type {
                return Err(FormatError::syntax(
                    path,
                    part(name),
                    format!("{:?}", tensor.dtype),
                    format!("{cloud_type:?}"),
                ));
            }
            let (from, to) = tensor.data_offsets;
            tensors.insert(*name, start + from..start + to);
            rows.insert(*name, shape[0]);
        }
        let mut reader = Self {
            path: path.to_owned(),
            map,
            metadata,
            tensors,
            cloud_type,
            has_normals: rows["normals"] > 0 || rows["points"] == 0,
            points: vec![],
            candidates: vec![],
            cameras: vec![],
        };
        reader.check_counts(&rows)?;
        Ok(reader)
    }

    fn check_counts(&mut self, rows: &BTreeMap<&str, usize>) -> Result<(), FormatError> {
        let samples = rows["object"];
        let refuse = |name: &str, found: String, expected: String| {
            Err(FormatError::syntax(&self.path, Place::Part(name.to_owned()), found, expected))
        };
        for name in ["num_candidates", "num_cameras", "current_coverage", "working_distance", "scan_index"] {
            if rows[name] != samples {
                return refuse(name, format!("{} rows", rows[name]), format!("{samples}, one per sample"));
            }
        }
        for name in ["density", "coverage", "overlap", "scores"] {
            if rows[name] != rows["candidates"] {
                return refuse(name, format!("{} rows", rows[name]), format!("{}", rows["candidates"]));
            }
        }
        if rows["normals"] != 0 && rows["normals"] != rows["points"] {
            return refuse("normals", format!("{} rows", rows["normals"]), format!("0 or {}", rows["points"]));
        }
        if rows["point_offsets"] != samples + 1 {
            return refuse("point_offsets", format!("{} rows", rows["point_offsets"]), format!("{}", samples + 1));
        }
        let points: Vec<usize> =
            (0..=samples).map(|i| usize::try_from(self.u64("point_offsets", i)).unwrap_or(usize::MAX)).collect();
        if points[0] != 0 || !points.is_sorted() || points[samples] != rows["points"] {
            return refuse("point_offsets", "other offsets".into(), format!("rising from 0 to {}", rows["points"]));
        }
        let running = |name: &'static str, total: usize| {
            let mut sums = vec![0usize];
            for i in 0..samples {
                sums.push(sums[i].saturating_add(self.u32(name, i) as usize));
            }
            if sums[samples] == total {
                Ok(sums)
            } else {
                Err(FormatError::syntax(
                    &self.path,
                    Place::Part(name.to_owned()),
                    format!("a sum of {}", sums[samples]),
                    format!("{total}"),
                ))
            }
        };
        let candidates = running("num_candidates", rows["candidates"])?;
        let cameras = running("num_cameras", rows["cameras"])?;
        for i in 0..samples {
            let object = self.u32("object", i) as usize;
            if object >= self.metadata.objects.len() {
                return refuse("object", format!("{object}"), format!("under {}", self.metadata.objects.len()));
            }
        }
        (self.points, self.candidates, self.cameras) = (points, candidates, cameras);
        Ok(())
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.points.len() - 1
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What the shard says of itself.
    pub fn metadata(&self) -> &ShardMetadata {
        &self.metadata
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of points of a sample's cloud. Panics beyond [`ShardReader::len`], as indexing does.
    pub fn num_points(&self, index: usize) -> usize {
        self.points[index + 1] - self.points[index]
    }

    /// Reads a sample. Panics beyond [`ShardReader::len`], as indexing does.
    pub fn sample(&self, index: usize) -> Sample {
        let points = self.points[index]..self.points[index + 1];
        let candidates = self.candidates[index]..self.candidates[index + 1];
        let cameras = self.cameras[index]..self.cameras[index + 1];
        let list = |name| candidates.clone().map(|i| self.f64(name, i)).collect();
        Sample {
            object: self.metadata.objects[self.u32("object", index) as usize].object.clone(),
            scan_index: self.u32("scan_index", index) as usize,
            cloud: PointCloud {
                points: points.clone().map(|i| Point3::from(self.vector("points", i))).collect(),
                normals: if self.has_normals { points.map(|i| self.vector("normals", i)).collect() } else { vec![] },
            },
            candidates: candidates
                .clone()
                .map(|i| {
                    let at = |k| self.f64("candidates", 6 * i + k);
                    let target = Point3::new(at(0), at(1), at(2));
                    let view = View { target, position: Point3::new(at(3), at(4), at(5)) };
                    CandidateView { view, density: self.f64("density", i) }
                })
                .collect(),
            coverage: list("coverage"),
            overlap: list("overlap"),
            scores: list("scores"),
            current_coverage: self.f64("current_coverage", index),
            working_distance: self.f64("working_distance", index),
            cameras: cameras
                .map(|i| {
                    let at = |k| self.f64("cameras", 7 * i + k);
                    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(at(3), at(0), at(1), at(2)));
                    Isometry3::from_parts(Translation3::new(at(4), at(5), at(6)), rotation)
                })
                .collect(),
        }
    }

    /// Checks every byte against the checksum, and every number for sense.
    ///
    /// # Errors
    /// Damage; numbers that are not finite or scores outside [0, 1].
    pub fn verify(&self) -> Result<(), FormatError> {
        let damaged = |found: String| {
            let expected = self.metadata.sha256.clone();
            FormatError::Damaged { path: self.path.clone(), found, expected }
        };
        let at = checksum_range(&self.map).ok_or_else(|| damaged("none".to_owned()))?;
        let mut sum = Sha256::new();
        sum.update(&self.map[..at.start]);
        sum.update([b'0'; 64]);
        sum.update(&self.map[at.end..]);
        let found = hex(&sum.finalize());
        if found != self.metadata.sha256 {
            return Err(damaged(found));
        }
        for index in 0..self.len() {
            let sample = self.sample(index);
            let place = || Place::Part(format!("sample {index}"));
            let cloud = sample.cloud.points.iter().map(|p| p.coords).chain(sample.cloud.normals.iter().copied());
            if cloud.flat_map(|v| [v.x, v.y, v.z]).any(|x| !x.is_finite()) {
                return Err(FormatError::syntax(&self.path, place(), "a cloud with NaN or infinity", "finite numbers"));
            }
            if let Some(c) =
                sample.candidates.iter().find(|c| !c.view.is_valid() || c.density.is_nan() || c.density < 0.0)
            {
                return Err(FormatError::syntax(
                    &self.path,
                    place(),
                    format!("{c:?}"),
                    "a view with a direction and a density",
                ));
            }
            if let Some(s) = sample.scores.iter().find(|s| !(0.0..=1.0).contains(*s)) {
                return Err(FormatError::syntax(&self.path, place(), format!("score {s}"), "0 to 1"));
            }
        }
        Ok(())
    }

    fn bytes<const N: usize>(&self, name: &str, index: usize) -> [u8; N] {
        let range = self.tensors[name].clone();
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.map[range][index * N..(index + 1) * N]);
        bytes
    }

    fn u32(&self, name: &str, index: usize) -> u32 {
        u32::from_le_bytes(self.bytes(name, index))
    }

    fn u64(&self, name: &str, index: usize) -> u64 {
        u64::from_le_bytes(self.bytes(name, index))
    }

    fn f64(&self, name: &str, index: usize) -> f64 {
        f64::from_le_bytes(self.bytes(name, index))
    }

    fn vector(&self, name: &str, row: usize) -> Vector3<f64> {
        match self.cloud_type {
            Dtype::F16 => {
                let b: [u8; 6] = self.bytes(name, row);
                Vector3::from_fn(|k, _| f16::from_le_bytes([b[2 * k], b[2 * k + 1]]).to_f64())
            }
            _ => {
                let b: [u8; 12] = self.bytes(name, row);
                Vector3::from_fn(|k, _| {
                    f64::from(f32::from_le_bytes([b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3]]))
                })
            }
        }
    }
}

/// Every tensor with its types and number of columns.
const TENSORS: &[(&str, &[Dtype], usize)] = &[
    ("points", &[Dtype::F32, Dtype::F16], 3),
    ("normals", &[Dtype::F32, Dtype::F16], 3),
    ("point_offsets", &[Dtype::U64], 1),
    ("candidates", &[Dtype::F64], 6),
    ("density", &[Dtype::F64], 1),
    ("coverage", &[Dtype::F64], 1),
    ("overlap", &[Dtype::F64], 1),
    ("scores", &[Dtype::F64], 1),
    ("num_candidates", &[Dtype::U32], 1),
    ("cameras", &[Dtype::F64], 7),
    ("num_cameras", &[Dtype::U32], 1),
    ("current_coverage", &[Dtype::F64], 1),
    ("working_distance", &[Dtype::F64], 1),
    ("scan_index", &[Dtype::U32], 1),
    ("object", &[Dtype::U32], 1),
];

/// Where the 64 digits of the checksum stand: JSON within a JSON string, hence the backslashes.
pub(super) fn checksum_range(bytes: &[u8]) -> Option<Range<usize>> {
    let key = br#"\"sha256\":\""#;
    let start = bytes.windows(key.len()).position(|w| w == key)? + key.len();
    (start + 64 <= bytes.len()).then_some(start..start + 64)
}
