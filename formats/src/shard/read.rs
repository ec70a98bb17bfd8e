//! Reading a shard.

use super::{CHECKSUM, METADATA, SCHEMA_VERSION, Sample, ShardMetadata};
use crate::error::{Place, REMAKE};
use crate::{FormatError, checksum};
use geometry::{PointCloud, View};
use half::f16;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use planning::CandidateView;
use safetensors::tensor::{Dtype, Metadata, SafeTensors};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A shard whose bytes agree with their checksum and whose counts agree with each other. Samples are read from the file
/// when they are asked for: mapped memory would end the program where another process cuts the file short.
#[derive(Debug)]
pub struct ShardReader {
    path: PathBuf,
    stamp: Stamp,
    metadata: ShardMetadata,
    tensors: BTreeMap<&'static str, Range<usize>>,
    cloud_type: Dtype,
    has_normals: bool,
    points: Vec<usize>,
    candidates: Vec<usize>,
    cameras: Vec<usize>,
}

/// Tells whether a file is still the one that was checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stamp {
    length: u64,
    modified: Option<SystemTime>,
    file: u64,
}

impl Stamp {
    fn of(file: &File) -> std::io::Result<Self> {
        let metadata = file.metadata()?;
        #[cfg(unix)]
        let number = std::os::unix::fs::MetadataExt::ino(&metadata);
        #[cfg(not(unix))]
        let number = 0;
        Ok(Self { length: metadata.len(), modified: metadata.modified().ok(), file: number })
    }
}

impl ShardReader {
    /// Opens a shard: reads it once and checks header, checksum and counts (not what its numbers say:
    /// [`ShardReader::verify`]).
    ///
    /// # Errors
    /// An unreadable file, a damaged or foreign one, another schema version, counts that do not agree.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let (mut file, _) = crate::file::open(path)?;
        let mut bytes = Vec::new();
        let stamp = Stamp::of(&file).and_then(|stamp| file.read_to_end(&mut bytes).map(|_| stamp));
        let stamp = stamp.map_err(|e| FormatError::io(path, "read", e))?;
        let (start, info) = SafeTensors::read_metadata(&bytes).map_err(|e| foreign(path, &e))?;
        let metadata = described(path, &info)?;
        checksum::check(path, &bytes, CHECKSUM, REMAKE)?;
        let layout = Layout::of(path, start + 8, &info)?;
        let mut reader = Self {
            path: path.to_owned(),
            stamp,
            metadata,
            tensors: layout.tensors,
            cloud_type: layout.cloud_type,
            has_normals: layout.rows["normals"] > 0 || layout.rows["points"] == 0,
            points: vec![],
            candidates: vec![],
            cameras: vec![],
        };
        reader.check_counts(&bytes, &layout.rows)?;
        Ok(reader)
    }

    /// What a shard says of itself, by its header alone: nothing is checked against the checksum.
    ///
    /// # Errors
    /// An unreadable or foreign file, another schema version.
    pub fn peek(path: &Path) -> Result<ShardMetadata, FormatError> {
        let (mut file, _) = crate::file::open(path)?;
        let mut read = || {
            let mut length = [0; 8];
            file.read_exact(&mut length)?;
            let mut header = Vec::new();
            (&mut file).take(u64::from_le_bytes(length)).read_to_end(&mut header)?;
            Ok(header)
        };
        let header = read().map_err(|e| FormatError::io(path, "read", e))?;
        let info: Metadata = serde_json::from_slice(&header)
            .map_err(|e| FormatError::syntax(path, part("header"), e.to_string(), FOREIGN))?;
        described(path, &info)
    }

    fn check_counts(&mut self, bytes: &[u8], rows: &BTreeMap<&str, usize>) -> Result<(), FormatError> {
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
        let points: Vec<usize> = whole(bytes, &self.tensors["point_offsets"], u64::from_le_bytes)
            .map(|n| usize::try_from(n).unwrap_or(usize::MAX))
            .collect();
        if points[0] != 0 || !points.is_sorted() || points[samples] != rows["points"] {
            return refuse("point_offsets", "other offsets".into(), format!("rising from 0 to {}", rows["points"]));
        }
        let running = |name: &'static str, total: usize| {
            let mut sums = vec![0usize];
            for count in whole(bytes, &self.tensors[name], u32::from_le_bytes) {
                sums.push(sums[sums.len() - 1].saturating_add(count as usize));
            }
            if sums[samples] == total {
                Ok(sums)
            } else {
                refuse(name, format!("a sum of {}", sums[samples]), format!("{total}")).map(|()| vec![])
            }
        };
        let candidates = running("num_candidates", rows["candidates"])?;
        let cameras = running("num_cameras", rows["cameras"])?;
        let objects = self.metadata.objects.len();
        let stray = whole(bytes, &self.tensors["object"], u32::from_le_bytes).find(|&o| o as usize >= objects);
        if let Some(object) = stray {
            return refuse("object", format!("{object}"), format!("under {objects}"));
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
    ///
    /// # Errors
    /// A file that cannot be read any more, or is no longer the one that was opened.
    pub fn sample(&self, index: usize) -> Result<Sample, FormatError> {
        let io = |e| FormatError::io(&self.path, "read", e);
        let (mut file, _) = crate::file::open(&self.path)?;
        if Stamp::of(&file).map_err(io)? != self.stamp {
            return Err(FormatError::Changed { path: self.path.clone() });
        }
        let mut rows = |name: &str, width: usize, rows: Range<usize>| {
            let mut bytes = vec![0; rows.len() * width];
            let start = self.tensors[name].start + rows.start * width;
            file.seek(SeekFrom::Start(start as u64)).and_then(|_| file.read_exact(&mut bytes)).map_err(io)?;
            Ok::<_, FormatError>(bytes)
        };
        let points = self.points[index]..self.points[index + 1];
        let candidates = self.candidates[index]..self.candidates[index + 1];
        let cameras = self.cameras[index]..self.cameras[index + 1];
        let normals = if self.has_normals { points.clone() } else { 0..0 };
        let width = if self.cloud_type == Dtype::F16 { 6 } else { 12 };
        let cloud = PointCloud {
            points: self.vectors(&rows("points", width, points)?).map(Point3::from).collect(),
            normals: self.vectors(&rows("normals", width, normals)?).collect(),
        };
        let density = f64s(&rows("density", 8, candidates.clone())?);
        let views = f64s(&rows("candidates", 48, candidates.clone())?);
        let views = views
            .chunks_exact(6)
            .map(|c| View { target: Point3::new(c[0], c[1], c[2]), position: Point3::new(c[3], c[4], c[5]) });
        let cameras = f64s(&rows("cameras", 56, cameras)?);
        let mut list = |name| rows(name, 8, candidates.clone()).map(|bytes| f64s(&bytes));
        let (coverage, overlap, scores) = (list("coverage")?, list("overlap")?, list("scores")?);
        let mut number = |name| rows(name, 8, index..index + 1).map(|bytes| f64s(&bytes)[0]);
        let (current_coverage, working_distance) = (number("current_coverage")?, number("working_distance")?);
        let mut count = |name| rows(name, 4, index..index + 1).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let (object, scan_index) = (count("object")? as usize, count("scan_index")? as usize);
        let Some(record) = self.metadata.objects.get(object) else {
            return Err(FormatError::Changed { path: self.path.clone() });
        };
        Ok(Sample {
            object: record.object.clone(),
            scan_index,
            cloud,
            candidates: views.zip(density).map(|(view, density)| CandidateView { view, density }).collect(),
            coverage,
            overlap,
            scores,
            current_coverage,
            working_distance,
            cameras: cameras
                .chunks_exact(7)
                .map(|c| {
                    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(c[3], c[0], c[1], c[2]));
                    Isometry3::from_parts(Translation3::new(c[4], c[5], c[6]), rotation)
                })
                .collect(),
        })
    }

    /// Checks every number of every sample for sense ([`Sample::check`]); checksum and counts were checked when the shard
    /// was opened.
    ///
    /// # Errors
    /// A number that cannot be, with its sample.
    pub fn verify(&self) -> Result<(), FormatError> {
        for index in 0..self.len() {
            if let Err(odd) = self.sample(index)?.check() {
                let place = Place::Part(format!("sample {index}"));
                return Err(FormatError::syntax(&self.path, place, odd.found, odd.expected));
            }
        }
        Ok(())
    }

    fn vectors(&self, bytes: &[u8]) -> impl Iterator<Item = Vector3<f64>> {
        let half = self.cloud_type == Dtype::F16;
        bytes.chunks_exact(if half { 6 } else { 12 }).map(move |b| match half {
            true => Vector3::from_fn(|k, _| f16::from_le_bytes([b[2 * k], b[2 * k + 1]]).to_f64()),
            false => Vector3::from_fn(|k, _| {
                f64::from(f32::from_le_bytes([b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3]]))
            }),
        })
    }
}

fn f64s(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]])).collect()
}

/// All numbers of a tensor of one column.
fn whole<const N: usize, T>(
    bytes: &[u8],
    tensor: &Range<usize>,
    number: impl Fn([u8; N]) -> T,
) -> impl Iterator<Item = T> {
    bytes[tensor.clone()].as_chunks::<N>().0.iter().map(move |b| number(*b))
}

fn part(name: &str) -> Place {
    Place::Part(name.to_owned())
}

const FOREIGN: &str = "a safetensors file as datagen writes it";

fn foreign(path: &Path, error: &safetensors::SafeTensorError) -> FormatError {
    FormatError::syntax(path, part("header"), error.to_string(), FOREIGN)
}

/// The JSON of the metadata's one entry.
fn described(path: &Path, info: &Metadata) -> Result<ShardMetadata, FormatError> {
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
    serde_json::from_str(text)
        .map_err(|e| FormatError::syntax(path, part("metadata"), e.to_string(), "the JSON of a shard"))
}

/// Where the tensors lie, each of the type and width that it must have.
struct Layout {
    tensors: BTreeMap<&'static str, Range<usize>>,
    rows: BTreeMap<&'static str, usize>,
    cloud_type: Dtype,
}

impl Layout {
    fn of(path: &Path, start: usize, info: &Metadata) -> Result<Self, FormatError> {
        let mut layout = Self { tensors: BTreeMap::new(), rows: BTreeMap::new(), cloud_type: Dtype::F32 };
        for (name, dtypes, columns) in TENSORS {
            let tensor = info
                .info(name)
                .ok_or_else(|| FormatError::syntax(path, part(name), "no such tensor", "all tensors of a shard"))?;
            let expected = if *columns == 1 { 1 } else { 2 };
            let shape = &tensor.shape;
            if !dtypes.contains(&tensor.dtype) || shape.len() != expected || (*columns > 1 && shape[1] != *columns) {
                let found = format!("{:?} {shape:?}", tensor.dtype);
                return Err(FormatError::syntax(path, part(name), found, format!("{dtypes:?} with {columns} columns")));
            }
            if *name == "points" {
                layout.cloud_type = tensor.dtype;
            }
            if *name == "normals" && tensor.dtype != layout.cloud_type {
                let (found, expected) = (format!("{:?}", tensor.dtype), format!("{:?}", layout.cloud_type));
                return Err(FormatError::syntax(path, part(name), found, expected));
            }
            let (from, to) = tensor.data_offsets;
            layout.tensors.insert(*name, start + from..start + to);
            layout.rows.insert(*name, shape[0]);
        }
        Ok(layout)
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
