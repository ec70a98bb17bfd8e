//! Reference surfaces kept beside the shards: safetensors with one tensor `points` [N, 3] f32, and the SHA-256 of
//! its bytes in the metadata.

use crate::FormatError;
use crate::checksum::sha256;
use crate::error::{Place, REMAKE};
use crate::run::atomic_write;
use nalgebra::Point3;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::HashMap;
use std::path::Path;

/// Writes surface samples, rounded to f32.
///
/// # Errors
/// What the operating system refuses.
pub fn write_surface(path: &Path, points: &[Point3<f64>]) -> Result<(), FormatError> {
    let data: Vec<u8> = points.iter().flat_map(|p| p.iter().flat_map(|&x| (x as f32).to_le_bytes())).collect();
    let metadata = HashMap::from([("sha256".to_owned(), sha256(&data))]);
    let bytes = TensorView::new(Dtype::F32, vec![points.len(), 3], &data)
        .and_then(|tensor| serialize([("points", tensor)], Some(metadata)))
        .map_err(|e| FormatError::syntax(path, Place::File, e.to_string(), "what safetensors can hold"))?;
    atomic_write(path, &bytes)
}

/// Reads surface samples.
///
/// # Errors
/// An unreadable, foreign or damaged file.
pub fn read_surface(path: &Path) -> Result<Vec<Point3<f64>>, FormatError> {
    let bytes = crate::file::read(path)?;
    let refuse =
        |found: String| FormatError::syntax(path, Place::File, found, "a tensor points of shape (N, 3) in f32");
    let foreign = |e: safetensors::SafeTensorError| refuse(e.to_string());
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(foreign)?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(foreign)?;
    let tensor = tensors.tensor("points").map_err(foreign)?;
    if tensor.dtype() != Dtype::F32 || tensor.shape().len() != 2 || tensor.shape()[1] != 3 {
        return Err(refuse(format!("{:?} {:?}", tensor.dtype(), tensor.shape())));
    }
    let expected = header.metadata().as_ref().and_then(|m| m.get("sha256")).cloned().unwrap_or_default();
    let found = sha256(tensor.data());
    if found != expected {
        return Err(FormatError::Damaged { path: path.to_owned(), found, expected, way_out: REMAKE });
    }
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(tensor
        .data()
        .chunks_exact(12)
        .map(|b| Point3::new(number(&b[..4]), number(&b[4..8]), number(&b[8..])))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_damage_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bunny.safetensors");
        let points: Vec<_> = (0..9).map(|i| Point3::new(f64::from(i) / 8.0, 0.5, -1.0)).collect();
        write_surface(&path, &points).unwrap();
        assert_eq!(read_surface(&path).unwrap(), points);
        let good = std::fs::read(&path).unwrap();
        let mut bad = good.clone();
        *bad.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &bad).unwrap();
        let text = read_surface(&path).expect_err("damaged").to_string();
        assert!(text.contains("damaged") && text.contains("bunny"), "{text}");
        crate::checksum::tests::every_flip_is_noticed(&good, 200, |bad| {
            std::fs::write(&path, bad).unwrap();
            read_surface(&path).map(drop).map_err(|e| e.to_string())
        });
        for length in 0..good.len() {
            std::fs::write(&path, &good[..length]).unwrap();
            assert!(read_surface(&path).is_err(), "{length} bytes");
        }
    }
}
