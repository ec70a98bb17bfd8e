//! Depth images: PNG, NumPy.

use crate::clouds::npy;
use crate::harness::{fuzz, seeds};
use formats::depth::parse_depth;
use geometry::DepthImage;
use std::path::Path;

#[test]
fn depth() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let image = DepthImage { origin: [0, 0], size: [4, 3], depth: (0..12).map(|i| i as f32 * 0.1).collect() };
    formats::depth::write_depth(&path, &image, 8, 6, 0.001).unwrap();
    let is_depth = |path: &Path, bytes: &[u8]| {
        parse_depth(path, bytes, None).is_ok_and(|file| {
            file.image.depth.len() as u64 == u64::from(file.image.size[0]) * u64::from(file.image.size[1])
        })
    };
    fuzz("png", &seeds("png", vec![std::fs::read(&path).unwrap()]), is_depth);
    fuzz(
        "npy-depth",
        &seeds("npy", vec![npy("<u2", "False", "(3, 4)", 24), npy("<f4", "False", "(3, 4)", 48)]),
        is_depth,
    );
}
