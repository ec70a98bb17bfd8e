//! Meshes: OFF, OBJ, STL.

use crate::harness::{fuzz, only_readable, seeds};
use formats::mesh::parse_mesh;
use std::path::Path;

pub(crate) fn is_mesh(path: &Path, bytes: &[u8]) -> bool {
    match parse_mesh(path, bytes) {
        Ok(mesh) => {
            assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.vertices.len()), "index out of range");
            assert!(mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite())), "a vertex is not finite");
            true
        }
        Err(error) => {
            assert_eq!(error.path(), path, "an error must name its file");
            false
        }
    }
}

#[test]
fn off() {
    let text = "OFF4 2 0\n0 0 0\n1 0 0 # c\n0 1 0\n0 0 1\n3 0 1 2\n4 0 1 3 2 255 0 0\n";
    fuzz("off", &only_readable(seeds("off", vec![text.into()]), is_mesh), is_mesh);
}

#[test]
fn obj() {
    let text =
        "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvn 1 0 0\nf 1//1 2/1/1 3\nf -1//-1 -2 \\\n-3 -4\ng f\n";
    fuzz("obj", &only_readable(seeds("obj", vec![text.into()]), is_mesh), is_mesh);
}

#[test]
fn stl() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let mut binary = vec![b' '; 80];
    binary.extend(2u32.to_le_bytes());
    for k in 0..24 {
        binary.extend((k as f32 * 0.37 % 1.0).to_le_bytes());
        if k % 12 == 11 {
            binary.extend([0, 0]);
        }
    }
    let made = vec![format!("solid a\n{facet}endsolid a\n").into(), binary];
    fuzz("stl", &only_readable(seeds("stl", made), is_mesh), is_mesh);
}
