//! Writing a shard.

use super::{CHECKSUM, CloudPrecision, METADATA, SCHEMA_VERSION, Sample, ShardMetadata};
use crate::error::Place;
use crate::run::atomic_write;
use crate::{FormatError, checksum};
use half::f16;
use safetensors::tensor::{Dtype, TensorView, serialize};
use std::collections::HashMap;
use std::path::Path;

/// Gathers the samples of one shard.
#[derive(Clone, Debug)]
pub struct ShardWriter {
    metadata: ShardMetadata,
    precision: CloudPrecision,
    all_normals: bool,
    points: Vec<u8>,
    normals: Vec<u8>,
    point_offsets: Vec<u64>,
    candidates: Vec<f64>,
    density: Vec<f64>,
    coverage: Vec<f64>,
    overlap: Vec<f64>,
    scores: Vec<f64>,
    num_candidates: Vec<u32>,
    cameras: Vec<f64>,
    num_cameras: Vec<u32>,
    current_coverage: Vec<f64>,
    working_distance: Vec<f64>,
    scan_index: Vec<u32>,
    object: Vec<u32>,
}

impl ShardWriter {
    /// An empty shard. `schema_version` and `sha256` of the metadata are filled in by [`ShardWriter::to_bytes`].
    pub fn new(metadata: ShardMetadata, precision: CloudPrecision) -> Self {
        Self {
            metadata,
            precision,
            all_normals: true,
            points: vec![],
            normals: vec![],
            point_offsets: vec![0],
            candidates: vec![],
            density: vec![],
            coverage: vec![],
            overlap: vec![],
            scores: vec![],
            num_candidates: vec![],
            cameras: vec![],
            num_cameras: vec![],
            current_coverage: vec![],
            working_distance: vec![],
            scan_index: vec![],
            object: vec![],
        }
    }

    /// Number of samples so far.
    pub fn len(&self) -> usize {
        self.object.len()
    }

    /// Whether there is no sample yet.
    pub fn is_empty(&self) -> bool {
        self.object.is_empty()
    }

    /// Appends a sample.
    ///
    /// # Errors
    /// Lists of unequal length, or an object that the metadata do not list.
    pub fn push(&mut self, sample: &Sample) -> Result<(), FormatError> {
        let refuse = |found: String, expected: String| {
            Err(FormatError::syntax(Path::new(&sample.object), Place::Part("sample".into()), found, expected))
        };
        let count = sample.candidates.len();
        for (name, list) in [("coverage", &sample.coverage), ("overlap", &sample.overlap), ("scores", &sample.scores)] {
            if list.len() != count {
                return refuse(format!("{} {name}", list.len()), format!("{count}, one per candidate"));
            }
        }
        let Some(object) = self.metadata.objects.iter().position(|o| o.object == sample.object) else {
            return refuse(format!("object {:?}", sample.object), "one of the metadata's objects".into());
        };
        self.all_normals &= sample.cloud.has_normals();
        for p in &sample.cloud.points {
            put(&mut self.points, self.precision, p.coords.iter());
        }
        for n in &sample.cloud.normals {
            put(&mut self.normals, self.precision, n.iter());
        }
        self.point_offsets.push(self.point_offsets.last().unwrap_or(&0) + sample.cloud.len() as u64);
        for c in &sample.candidates {
            self.candidates.extend(c.view.target.iter().chain(c.view.position.iter()));
            self.density.push(c.density);
        }
        self.coverage.extend(&sample.coverage);
        self.overlap.extend(&sample.overlap);
        self.scores.extend(&sample.scores);
        self.num_candidates.push(count as u32);
        for pose in &sample.cameras {
            self.cameras.extend(pose.rotation.coords.iter().chain(pose.translation.vector.iter()));
        }
        self.num_cameras.push(sample.cameras.len() as u32);
        self.current_coverage.push(sample.current_coverage);
        self.working_distance.push(sample.working_distance);
        self.scan_index.push(sample.scan_index as u32);
        self.object.push(object as u32);
        Ok(())
    }

    /// The file's bytes.
    ///
    /// # Errors
    /// A header beyond what safetensors allows (100 MB of metadata).
    pub fn to_bytes(&self) -> Result<Vec<u8>, FormatError> {
        let refuse = |e: &dyn std::fmt::Display| {
            FormatError::syntax(Path::new("shard"), Place::File, e.to_string(), "what safetensors can hold")
        };
        let metadata = ShardMetadata {
            schema_version: SCHEMA_VERSION,
            sha256: checksum::UNKNOWN.to_owned(),
            ..self.metadata.clone()
        };
        // One entry only: the crate keeps metadata in a hash map, and two would change places from run to run.
        let text = serde_json::to_string(&metadata).map_err(|e| refuse(&e))?;
        let metadata = HashMap::from([(METADATA.to_owned(), text)]);

        let cloud_type = match self.precision {
            CloudPrecision::F32 => Dtype::F32,
            CloudPrecision::F16 => Dtype::F16,
        };
        let f64s = |values: &[f64]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let u32s = |values: &[u32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
        let (samples, count) = (self.len(), self.density.len());
        let num_points = *self.point_offsets.last().unwrap_or(&0) as usize;
        let num_normals = if self.all_normals { num_points } else { 0 };
        let tensors: Vec<(&str, Dtype, Vec<usize>, Vec<u8>)> = vec![
            ("points", cloud_type, vec![num_points, 3], self.points.clone()),
            ("normals", cloud_type, vec![num_normals, 3], if self.all_normals { self.normals.clone() } else { vec![] }),
            (
                "point_offsets",
                Dtype::U64,
                vec![samples + 1],
                self.point_offsets.iter().flat_map(|x| x.to_le_bytes()).collect(),
            ),
            ("candidates", Dtype::F64, vec![count, 6], f64s(&self.candidates)),
            ("density", Dtype::F64, vec![count], f64s(&self.density)),
            ("coverage", Dtype::F64, vec![count], f64s(&self.coverage)),
            ("overlap", Dtype::F64, vec![count], f64s(&self.overlap)),
            ("scores", Dtype::F64, vec![count], f64s(&self.scores)),
            ("num_candidates", Dtype::U32, vec![samples], u32s(&self.num_candidates)),
            ("cameras", Dtype::F64, vec![self.cameras.len() / 7, 7], f64s(&self.cameras)),
            ("num_cameras", Dtype::U32, vec![samples], u32s(&self.num_cameras)),
            ("current_coverage", Dtype::F64, vec![samples], f64s(&self.current_coverage)),
            ("working_distance", Dtype::F64, vec![samples], f64s(&self.working_distance)),
            ("scan_index", Dtype::U32, vec![samples], u32s(&self.scan_index)),
            ("object", Dtype::U32, vec![samples], u32s(&self.object)),
        ];
        let views = tensors
            .iter()
            .map(|(name, dtype, shape, data)| Ok((*name, TensorView::new(*dtype, shape.clone(), data)?)))
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
            .map_err(|e| refuse(&e))?;
        let mut bytes = serialize(views, Some(metadata)).map_err(|e| refuse(&e))?;
        if !checksum::seal(&mut bytes, CHECKSUM) {
            return Err(refuse(&"no place for a checksum"));
        }
        Ok(bytes)
    }

    /// Writes the shard, whole or not at all.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn write(&self, path: &Path) -> Result<(), FormatError> {
        atomic_write(path, &self.to_bytes()?)
    }
}

fn put<'a>(bytes: &mut Vec<u8>, precision: CloudPrecision, values: impl Iterator<Item = &'a f64>) {
    for &x in values {
        match precision {
            CloudPrecision::F32 => bytes.extend((x as f32).to_le_bytes()),
            CloudPrecision::F16 => bytes.extend(f16::from_f64(x).to_le_bytes()),
        }
    }
}
