//! Arrays of numpy in and out. What comes in is read where it lies, whatever its strides, and converted once, since the
//! planner keeps it; what goes out is handed over without a copy.

use crate::fault::Fault;
use geometry::{Mesh, PinholeCamera};
use infer::load::Origin;
use nalgebra::{Isometry3, Point3, Vector3};
use numpy::ndarray::ArrayViewD;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods,
};
use planning::scan::FARTHEST_M;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// Points and normals.
pub type CloudArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Vertices and triangles.
pub type MeshArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>);

/// Points or pixels that are taken at most.
pub const MOST: usize = 1 << 25;

/// `value`, known to the caller as `name`, as an aligned array of real numbers, of at most [`MOST`] rows.
pub fn numbers<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let array = match value.cast::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => value.py().import("numpy")?.call_method1("asarray", (value,))?.cast_into()?,
    };
    if array.hasattr("mask")? {
        let fill = "its mask would be lost: fill it first, NaN or 0 for no return";
        return Err(Fault::Value(format!("{name}: a masked array, {fill}")).into());
    }
    if !matches!(array.dtype().kind(), b'f' | b'i' | b'u') {
        return Err(PyTypeError::new_err(format!("{name}: an array of {}, expected real numbers", array.dtype())));
    }
    let most = 3 * MOST;
    if array.shape().iter().try_fold(1usize, |n, side| n.checked_mul(*side)).is_none_or(|n| n > most) {
        let found = format!("{name}: an array of shape {}, at most {most} numbers are taken", shape(array.shape()));
        return Err(Fault::Value(format!("{found}: thin or split it")).into());
    }
    let aligned: bool = array.getattr("flags")?.getattr("aligned")?.extract()?;
    if aligned { Ok(array) } else { Ok(array.call_method0("copy")?.cast_into()?) }
}

/// A shape as Python writes it.
fn shape(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    match &sides[..] {
        [one] => format!("({one},)"),
        sides => format!("({})", sides.join(", ")),
    }
}

fn unfit(name: &str, found: &[usize], expected: &str) -> PyErr {
    Fault::Value(format!("{name}: an array of shape {}, expected {expected}", shape(found))).into()
}

/// Lets `read` read the array, as 32 or 64 bit floats.
fn with_floats<T>(
    array: &Bound<'_, PyUntypedArray>,
    single: impl FnOnce(ArrayViewD<'_, f32>) -> T,
    double: impl FnOnce(ArrayViewD<'_, f64>) -> T,
) -> PyResult<T> {
    if let Ok(array) = array.cast::<PyArrayDyn<f32>>() {
        return Ok(single(borrowed(array)?.as_array()));
    }
    if let Ok(array) = array.cast::<PyArrayDyn<f64>>() {
        return Ok(double(borrowed(array)?.as_array()));
    }
    let array = array.call_method1("astype", ("float64",))?.cast_into::<PyArrayDyn<f64>>()?;
    Ok(double(borrowed(&array)?.as_array()))
}

fn borrowed<'py, T: Element>(array: &Bound<'py, PyArrayDyn<T>>) -> PyResult<numpy::PyReadonlyArrayDyn<'py, T>> {
    array.try_readonly().map_err(|e| Fault::Value(e.to_string()).into())
}

fn triples<T: Copy + Into<f64>>(view: &ArrayViewD<'_, T>) -> Vec<[f64; 3]> {
    match view.as_slice() {
        Some(all) => all.as_chunks::<3>().0.iter().map(|p| p.map(Into::into)).collect(),
        None => view.outer_iter().map(|row| [0, 1, 2].map(|i| row[i].into())).collect(),
    }
}

/// N rows of three numbers.
pub fn rows(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; 3]>> {
    let array = numbers(name, value)?;
    if array.ndim() != 2 || array.shape()[1] != 3 {
        return Err(unfit(name, array.shape(), "(N, 3): x, y, z of each point"));
    }
    with_floats(&array, |view| triples(&view), |view| triples(&view))
}

/// N points.
pub fn points(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Point3<f64>>> {
    Ok(rows(name, value)?.into_iter().map(Point3::from).collect())
}

/// N vectors.
pub fn vectors(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Vector3<f64>>> {
    Ok(rows(name, value)?.into_iter().map(Vector3::from).collect())
}

/// One position, not absurdly far away.
pub fn position(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Point3<f64>> {
    let array = numbers(name, value)?;
    if array.shape() != [3] {
        return Err(unfit(name, array.shape(), "(3,): x, y, z"));
    }
    let values = flat(&array)?;
    let position = Point3::new(values[0], values[1], values[2]);
    within_reach(name, &position)?;
    Ok(position)
}

/// Where a cloud was measured from: (3,), or (2, 3) for two points of a line scanner's path.
pub fn origin(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Origin> {
    let array = numbers(name, value)?;
    if array.shape() != [2, 3] {
        return Ok(Origin::Point(position(name, value)?.coords.into()));
    }
    let values = flat(&array)?;
    let path = [0, 3].map(|i| Point3::new(values[i], values[i + 1], values[i + 2]));
    path.iter().try_for_each(|p| within_reach(name, p))?;
    if path[0] == path[1] {
        return Err(Fault::Value(format!("{name}: a path needs two different points")).into());
    }
    Ok(Origin::Path(path.map(|p| p.coords.into())))
}

fn within_reach(name: &str, position: &Point3<f64>) -> PyResult<()> {
    if position.iter().all(|x| x.abs() <= FARTHEST_M) {
        return Ok(());
    }
    let [x, y, z] = position.coords.into();
    Err(Fault::Value(format!("{name}: ({x}, {y}, {z}) is not within a million metres of the origin")).into())
}

/// All numbers in row-major order.
pub fn flat(array: &Bound<'_, PyUntypedArray>) -> PyResult<Vec<f64>> {
    with_floats(array, |view| view.iter().map(|x| f64::from(*x)).collect(), |view| view.iter().copied().collect())
}

/// A rigid motion as a 4 x 4 matrix.
pub fn pose(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Isometry3<f64>> {
    let array = numbers(name, value)?;
    if array.shape() != [4, 4] {
        return Err(unfit(name, array.shape(), "(4, 4): world_from_camera"));
    }
    let values = flat(&array)?;
    let rows: [[f64; 4]; 4] = std::array::from_fn(|r| std::array::from_fn(|c| values[4 * r + c]));
    let pose = infer::load::rigid(&rows).map_err(Fault::Value)?;
    within_reach(name, &Point3::from(pose.translation.vector))?;
    Ok(pose)
}

/// fx, fy, cx, cy, from a 3 x 3 matrix without skew or from the four numbers.
pub fn intrinsics(name: &str, value: &Bound<'_, PyAny>) -> PyResult<[f64; 4]> {
    let array = numbers(name, value)?;
    let k = flat(&array)?;
    match array.shape() {
        [4] => Ok([k[0], k[1], k[2], k[3]]),
        [3, 3] if [k[1], k[3], k[6], k[7], k[8] - 1.0].iter().all(|x| x.abs() <= 1e-9) => Ok([k[0], k[4], k[2], k[5]]),
        [3, 3] => {
            let expected = "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: a camera without skew";
            Err(Fault::Value(format!("{name}: {}, {expected}", array.str()?)).into())
        }
        found => Err(unfit(name, found, "(3, 3), or (4,): fx, fy, cx, cy")),
    }
}

/// A camera of this size.
pub fn camera(width: u32, height: u32, intrinsics: [f64; 4]) -> Result<PinholeCamera, Fault> {
    let config = planning::config::CameraConfig { width, height, intrinsics: Some(intrinsics), ..Default::default() };
    let session = planning::SessionConfig { camera: config.clone(), ..Default::default() };
    session.check().map_err(|e| Fault::Value(e.to_string()))?;
    Ok(config.camera())
}

/// A depth image, as `formats` makes it of a file that holds these values.
pub fn depth(value: &Bound<'_, PyAny>, metres_per_unit: Option<f64>) -> PyResult<formats::depth::DepthFile> {
    let array = numbers("depth", value)?;
    let &[height, width] = array.shape() else {
        return Err(unfit("depth", array.shape(), "(height, width)"));
    };
    if let Some(unit) = metres_per_unit.filter(|unit| !(*unit > 0.0 && unit.is_finite())) {
        return Err(Fault::Value(format!("metres_per_unit: {unit}, expected a number above 0, such as 0.001")).into());
    }
    let bits = i32::try_from(8 * array.dtype().itemsize()).unwrap_or(64);
    let largest = match array.dtype().kind() {
        b'u' => Some(2f64.powi(bits) - 1.0),
        b'i' => Some(2f64.powi(bits - 1) - 1.0),
        _ => None,
    };
    let values = flat(&array)?;
    let image = formats::depth::image("depth".as_ref(), [width, height], values, largest, metres_per_unit);
    Ok(image.map_err(Fault::from)?)
}

/// A mesh whose triangles all have their corners.
pub fn mesh(vertices: &Bound<'_, PyAny>, faces: &Bound<'_, PyAny>) -> PyResult<Mesh> {
    let vertices = points("vertices", vertices)?;
    if let Some(i) = vertices.iter().position(|p| !p.iter().all(|x| x.abs() <= FARTHEST_M)) {
        return Err(Fault::Value(format!("vertices: number {i} is not within a million metres of the origin")).into());
    }
    let array = numbers("faces", faces)?;
    if array.dtype().kind() == b'f' && array.len() > 0 {
        return Err(PyTypeError::new_err("faces: an array of floats, expected whole numbers: indices of vertices"));
    }
    let mut triangles = Vec::new();
    for face in rows("faces", array.as_any())? {
        if let Some(index) = face.iter().find(|i| !(0.0..vertices.len() as f64).contains(*i)) {
            let found = format!("faces: an index {index}, expected 0 to {}", vertices.len().saturating_sub(1));
            return Err(Fault::Value(found).into());
        }
        triangles.push(face.map(|i| i as u32));
    }
    if triangles.is_empty() {
        return Err(Fault::Value("faces: none, expected at least one triangle".to_owned()).into());
    }
    Ok(Mesh { vertices, triangles })
}

/// N x 3, of the memory of what is given.
pub fn of_rows<'py>(py: Python<'py>, rows: impl IntoIterator<Item = [f64; 3]>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<[f64; 3]> = rows.into_iter().collect();
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, 3])
}

/// N x 3.
pub fn of_points(py: Python<'_>, points: Vec<Point3<f64>>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    of_rows(py, points.into_iter().map(|p| p.coords.into()))
}

/// N x 3.
pub fn of_vectors(py: Python<'_>, vectors: Vec<Vector3<f64>>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    of_rows(py, vectors.into_iter().map(Into::into))
}

/// Vertices (N, 3), and the triangles of their indices (M, 3).
pub fn of_mesh(py: Python<'_>, mesh: Mesh) -> PyResult<MeshArrays<'_>> {
    let count = mesh.triangles.len();
    let triangles = PyArray1::from_vec(py, mesh.triangles.into_flattened()).reshape([count, 3])?;
    Ok((of_points(py, mesh.vertices)?, triangles))
}

/// 4 x 4.
pub fn of_pose<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    of_matrix(py, &planning::pose::Pose::from(pose).matrix)
}

/// As (4, 4).
pub fn of_matrix<'py>(py: Python<'py>, rows: &[[f64; 4]; 4]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_vec(py, rows.as_flattened().to_vec()).reshape([4, 4])
}
