//! Golden values for tests. Those in `tests/data` travel with the repository and must be there; larger ones of the
//! published code may lie beside a checkout.

use crate::PointCloud;
use nalgebra::{Point3, Vector3};
use safetensors::{Dtype, SafeTensors};

/// One golden file in memory.
pub struct Golden(Vec<u8>);

impl Golden {
    /// A file of `tests/data`.
    pub fn open(name: &str) -> Self {
        let path = format!("{}/../tests/data/{name}", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(&path);
        Self(bytes.unwrap_or_else(|e| panic!("{path}: {e}; tests/reference/make_geometry.py makes it")))
    }

    /// A larger file of the published code; `None`, said in words, where it does not lie beside the checkout.
    pub fn bonus(name: &str) -> Option<Self> {
        let path = format!("{}/../../shared/golden/{name}", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(&path).ok();
        if bytes.is_none() {
            println!("bonus test skipped: {name} of the published code is not beside this checkout");
        }
        bytes.map(Self)
    }

    fn bytes<const N: usize, T>(data: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
        data.as_chunks().0.iter().map(|bytes| read(*bytes)).collect()
    }

    fn values<T>(&self, name: &str, read: impl Fn(Dtype, &[u8]) -> Option<Vec<T>>) -> Vec<T> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap_or_else(|e| panic!("{name}: {e}"));
        read(tensor.dtype(), tensor.data()).unwrap_or_else(|| panic!("{name} is {:?}", tensor.dtype()))
    }

    /// Values of an f64 or f32 tensor.
    pub fn f64(&self, name: &str) -> Vec<f64> {
        self.values(name, |dtype, data| match dtype {
            Dtype::F64 => Some(Self::bytes(data, f64::from_le_bytes)),
            Dtype::F32 => Some(Self::bytes(data, |b| f64::from(f32::from_le_bytes(b)))),
            _ => None,
        })
    }

    /// Values of an i32 tensor.
    pub fn i32(&self, name: &str) -> Vec<i32> {
        self.values(name, |dtype, data| (dtype == Dtype::I32).then(|| Self::bytes(data, i32::from_le_bytes)))
    }

    /// Values of an i32 tensor that count or number something.
    pub fn indices(&self, name: &str) -> Vec<usize> {
        self.i32(name).into_iter().map(|i| usize::try_from(i).unwrap()).collect()
    }

    /// Values of a u8 tensor.
    pub fn u8(&self, name: &str) -> Vec<u8> {
        self.values(name, |dtype, data| (dtype == Dtype::U8).then(|| data.to_vec()))
    }

    /// Rows of an N x 3 tensor.
    pub fn points(&self, name: &str) -> Vec<Point3<f64>> {
        self.f64(name).chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect()
    }

    /// Rows of an N x 6 tensor: positions and normals.
    pub fn cloud(&self, name: &str) -> PointCloud {
        let values = self.f64(name);
        let rows = || values.chunks_exact(6);
        PointCloud {
            points: rows().map(|r| Point3::new(r[0], r[1], r[2])).collect(),
            normals: rows().map(|r| Vector3::new(r[3], r[4], r[5])).collect(),
        }
    }

    /// Rows of two N x 3 tensors, `{name}.points` and `{name}.normals`.
    pub fn cloud_of(&self, name: &str) -> PointCloud {
        let normals = self.points(&format!("{name}.normals"));
        PointCloud {
            points: self.points(&format!("{name}.points")),
            normals: normals.iter().map(|n| n.coords).collect(),
        }
    }
}
