//! Clouds, depth images and meshes from files.

use crate::arrays;
use crate::fault::{Fault, detached};
use crate::session::as_json;
use geometry::Lens;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;

/// A cloud as its file holds it: points, normals or None, what there is to say of how it was read.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "a tuple for Python to name")]
pub fn read_cloud<'py>(
    py: Python<'py>,
    path: PathBuf,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>, Option<f64>, Vec<String>)> {
    let mut file = detached(py, || Ok(formats::read_cloud(&path)?))?;
    let unknown = file.unknown_unit.map(|unit| format!("the unit [{unit}] of its columns is not known"));
    file.notes.extend(unknown);
    let normals = file.cloud.has_normals().then(|| arrays::of_vectors(py, file.cloud.normals)).transpose()?;
    Ok((arrays::of_points(py, file.cloud.points)?, normals, file.metres_per_unit, file.notes))
}

/// What is in a regular file.
#[pyfunction]
pub fn read_file(py: Python<'_>, path: PathBuf) -> PyResult<Cow<'static, [u8]>> {
    detached(py, || Ok(Cow::Owned(formats::file::read(&path)?)))
}

/// A depth image in metres, and what there is to say of how it was read.
#[pyfunction]
#[pyo3(signature = (path, metres_per_unit=None))]
pub fn read_depth<'py>(
    py: Python<'py>,
    path: PathBuf,
    metres_per_unit: Option<f64>,
) -> PyResult<(Bound<'py, PyArray2<f32>>, Vec<String>)> {
    let file = detached(py, || Ok(formats::depth::read_depth(&path, metres_per_unit)?))?;
    let [width, height] = file.image.size.map(|side| side as usize);
    Ok((PyArray1::from_vec(py, file.image.depth).reshape([height, width])?, file.notes))
}

/// Vertices and triangles.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "a tuple for Python to name")]
pub fn read_mesh(py: Python<'_>, path: PathBuf) -> PyResult<arrays::MeshArrays<'_>> {
    let mesh = detached(py, || Ok(formats::read_mesh(&path)?))?;
    arrays::of_mesh(py, mesh)
}

/// The arm of a URDF that ends in the link `tool`, as settings in JSON, and what there is to say of how it was read.
#[pyfunction]
pub fn read_arm(py: Python<'_>, path: PathBuf, tool: &str) -> PyResult<(String, Vec<String>)> {
    detached(py, || {
        let read = formats::urdf::read_urdf(&path, tool)?;
        Ok((as_json(&read.arm)?, read.notes))
    })
}

/// A calibration: columns and rows where the file has them, fx, fy, cx, cy, the lens's model and coefficients, and metres per unit of depth
/// where the file says so.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "a tuple for Python to name")]
pub fn read_camera(
    py: Python<'_>,
    path: String,
) -> PyResult<(Option<(u32, u32)>, (f64, f64, f64, f64), &'static str, Vec<f64>, Option<f64>)> {
    let camera = detached(py, || Ok(formats::camera::read_camera(&path)?))?;
    let (model, coefficients) = match camera.lens {
        Lens::Pinhole => ("brown_conrady", Vec::new()),
        Lens::BrownConrady(k) => ("brown_conrady", k.to_vec()),
        Lens::Fisheye(k) => ("fisheye", k.to_vec()),
    };
    Ok((camera.size.map(Into::into), camera.intrinsics.into(), model, coefficients, camera.metres_per_unit))
}

/// The poses in a file of any of the formats of docs/formats.md.
#[pyfunction]
pub fn read_poses(py: Python<'_>, path: PathBuf) -> PyResult<Vec<Bound<'_, PyArray2<f64>>>> {
    let poses = detached(py, || infer::load::poses(&path).map_err(Fault::from))?;
    poses.iter().map(|pose| arrays::of_pose(py, pose)).collect()
}
