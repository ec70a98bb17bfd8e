//! Training samples that `datagen` made.

use crate::fault::{Fault, detached};
use formats::{Manifest, Sample, ShardReader, Split};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};

/// The samples of a set, or of one shard. Each is read from its file when it is asked for.
#[pyclass(frozen, module = "benbv._benbv")]
pub struct Shards {
    readers: Vec<ShardReader>,
    /// Samples before each reader's, and at last all.
    before: Vec<usize>,
}

fn open(path: &Path, split: Option<Split>) -> Result<Vec<ShardReader>, Fault> {
    if !path.is_dir() {
        let reader = ShardReader::open(path)?;
        let fits = reader.metadata().objects.iter().any(|o| split.is_none_or(|s| o.split == s));
        return Ok(if fits { vec![reader] } else { vec![] });
    }
    let manifest = Manifest::read(path)?;
    let mut readers = Vec::new();
    for record in manifest.objects.iter().filter(|o| split.is_none_or(|s| o.split == s)) {
        readers.extend(manifest.open(path, record)?);
    }
    Ok(readers)
}

#[pymethods]
impl Shards {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, split: Option<&str>) -> PyResult<Self> {
        let split = match split {
            None => None,
            Some("train") => Some(Split::Train),
            Some("validation") => Some(Split::Validation),
            Some("test") => Some(Split::Test),
            Some(other) => {
                let found = format!("split: {other:?}, expected \"train\", \"validation\" or \"test\"");
                return Err(Fault::Value(found).into());
            }
        };
        let readers = detached(py, || open(&path, split))?;
        let mut before = vec![0];
        readers.iter().for_each(|reader| before.push(before[before.len() - 1] + reader.len()));
        Ok(Self { readers, before })
    }

    fn __len__(&self) -> usize {
        self.before[self.before.len() - 1]
    }

    /// A sample as a dictionary of arrays.
    fn sample<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyDict>> {
        if index >= self.__len__() {
            return Err(PyIndexError::new_err(format!("sample {index} of {}", self.__len__())));
        }
        let reader = self.before.partition_point(|&before| before <= index) - 1;
        let sample = detached(py, || Ok(self.readers[reader].sample(index - self.before[reader])?))?;
        as_dict(py, sample)
    }
}

fn as_dict(py: Python<'_>, sample: Sample) -> PyResult<Bound<'_, PyDict>> {
    let single = |rows: Vec<[f32; 3]>| {
        let count = rows.len();
        PyArray1::from_vec(py, rows.into_flattened()).reshape([count, 3])
    };
    let (count, cameras) = (sample.candidates.len(), sample.cameras.len());
    let views = sample.candidates.iter().flat_map(|c| {
        let (t, p) = (c.view.target, c.view.position);
        [t.x, t.y, t.z, p.x, p.y, p.z]
    });
    let poses = sample.cameras.iter().flat_map(|c| planning::pose::Pose::from(c).matrix.into_iter().flatten());
    let dict = PyDict::new(py);
    dict.set_item("object", sample.object)?;
    dict.set_item("scan_index", sample.scan_index)?;
    // As they are on disk: in 32 bits at most.
    dict.set_item("points", single(sample.cloud.points.iter().map(|p| p.coords.map(|x| x as f32).into()).collect())?)?;
    dict.set_item("normals", single(sample.cloud.normals.iter().map(|n| n.map(|x| x as f32).into()).collect())?)?;
    dict.set_item("candidates", PyArray1::from_vec(py, views.collect()).reshape([count, 6])?)?;
    dict.set_item("density", PyArray1::from_vec(py, sample.candidates.iter().map(|c| c.density).collect()))?;
    dict.set_item("scores", PyArray1::from_vec(py, sample.scores))?;
    dict.set_item("coverage", PyArray1::from_vec(py, sample.coverage))?;
    dict.set_item("overlap", PyArray1::from_vec(py, sample.overlap))?;
    dict.set_item("current_coverage", sample.current_coverage)?;
    dict.set_item("working_distance", sample.working_distance)?;
    dict.set_item("cameras", PyArray1::from_vec(py, poses.collect()).reshape([cameras, 4, 4])?)?;
    Ok(dict)
}
