//! Golden values for tests: safetensors files beside the checkout, absent in a plain clone.

use crate::PointCloud;
use nalgebra::{Point3, Vector3};
use safetensors::{Dtype, SafeTensors};

/// One golden file in memory.
pub struct Golden(Vec<u8>);

impl Golden {
    /// The file of this name; `None`, said in words, where it is absent.
    pub fn open(name: &str) -> Option<Self> {
        let path = format!("{}/../../shared/golden/{name}", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(&path).ok();
        if bytes.is_none() {
            println!("skipped: {path} is not there");
        }
        bytes.map(Self)
    }

    fn values<const N: usize, T>(&self, name: &str, dtype: Dtype, read: impl Fn([u8; N]) -> T) -> Vec<T> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap();
        assert_eq!(tensor.dtype(), dtype, "{name}");
        tensor.data().chunks_exact(N).map(|bytes| read(bytes.try_into().unwrap())).collect()
    }

    /// Values of an f64 tensor.
    pub fn f64(&self, name: &str) -> Vec<f64> {
        self.values(name, Dtype::F64, f64::from_le_bytes)
    }

    /// Values of an f32 tensor.
    pub fn f32(&self, name: &str) -> Vec<f32> {
        self.values(name, Dtype::F32, f32::from_le_bytes)
    }

    /// Values of an i32 tensor.
    pub fn i32(&self, name: &str) -> Vec<i32> {
        self.values(name, Dtype::I32, i32::from_le_bytes)
    }

    /// Values of a u8 tensor.
    pub fn u8(&self, name: &str) -> Vec<u8> {
        self.values(name, Dtype::U8, |[b]: [u8; 1]| b)
    }

    /// Rows of an N x 3 f64 tensor.
    pub fn points(&self, name: &str) -> Vec<Point3<f64>> {
        self.f64(name).chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2])).collect()
    }

    /// Rows of an N x 3 f32 tensor.
    pub fn points_f32(&self, name: &str) -> Vec<Point3<f64>> {
        self.f32(name).chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2]).cast()).collect()
    }

    /// Rows of an N x 6 f64 tensor: positions and normals.
    pub fn cloud(&self, name: &str) -> PointCloud {
        let values = self.f64(name);
        let rows = || values.chunks_exact(6);
        PointCloud {
            points: rows().map(|r| Point3::new(r[0], r[1], r[2])).collect(),
            normals: rows().map(|r| Vector3::new(r[3], r[4], r[5])).collect(),
        }
    }
}
