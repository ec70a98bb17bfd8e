//! Clouds: PLY, which may be a mesh too, PCD, text, NumPy.

use crate::harness::{fuzz, only_readable, seeds};
use crate::meshes::is_mesh;
use formats::cloud::parse_cloud;
use std::path::Path;

fn is_cloud(path: &Path, bytes: &[u8]) -> bool {
    parse_cloud(path, bytes).is_ok_and(|file| {
        assert!(file.cloud.points.iter().all(|p| p.iter().all(|x| x.is_finite())), "a point is not finite");
        assert!(file.cloud.normals.is_empty() || file.cloud.has_normals(), "normals for some points only");
        true
    })
}

#[test]
fn ply() {
    let head = "element vertex 3\nproperty float x\nproperty double y\nproperty float z\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n";
    let text = format!("ply\nformat ascii 1.0\ncomment c\n{head}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    let mut made = vec![text.into_bytes()];
    for big in [false, true] {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{head}").into_bytes();
        let mut put = |mut value: Vec<u8>| {
            if big {
                value.reverse();
            }
            bytes.extend(value);
        };
        for [x, y, z] in [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            put(x.to_le_bytes().into());
            put(f64::from(y).to_le_bytes().into());
            put(z.to_le_bytes().into());
        }
        put(vec![3]);
        (0..3i32).for_each(|i| put(i.to_le_bytes().into()));
        made.push(bytes);
    }
    let both = |path: &Path, bytes: &[u8]| is_mesh(path, bytes) | is_cloud(path, bytes);
    fuzz("ply", &only_readable(seeds("ply", made), both), both);
}

#[test]
fn pcd() {
    let head = |kind: &str| {
        format!(
            "# .PCD v.7\nVERSION .7\nFIELDS x y z _ normal_x normal_y normal_z\nSIZE 4 4 4 1 4 4 8\nTYPE F F F U F F F\n\
             COUNT 1 1 1 4 1 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 1 1 0 0 0\nPOINTS 4\nDATA {kind}\n"
        )
        .into_bytes()
    };
    let mut ascii = head("ascii");
    (0..4).for_each(|i| ascii.extend(format!("{i} 0.5 {} 0 0 0 0 nan 0 1\n", i * i).bytes()));
    let record: Vec<u8> = (0..32u8).collect();
    let mut binary = head("binary");
    (0..4).for_each(|_| binary.extend(&record));
    let mut packed = head("binary_compressed");
    packed.extend((4 * 33u32).to_le_bytes());
    packed.extend((4 * 32u32).to_le_bytes());
    for _ in 0..4 {
        packed.push(31); // a literal run of 32
        packed.extend(&record);
    }
    fuzz("pcd", &seeds("pcd", vec![ascii, binary, packed]), is_cloud);
}

#[test]
fn xyz() {
    let made =
        vec![b"x y z nx ny nz\n1 2 3 0 0 1\n4,5,6,1,0,0\n".to_vec(), b"2\n1 2 3 // c\n5600000.25;1;2 label\n".to_vec()];
    fuzz("xyz", &seeds("xyz", made), is_cloud);
}

pub(crate) fn npy(descr: &str, fortran: &str, shape: &str, size: usize) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..size).map(|i| i as u8 % 60));
    bytes
}

#[test]
fn npy_clouds() {
    let made = vec![
        npy("<f8", "False", "(4, 6)", 192),
        npy(">f4", "True", "(5, 3)", 60),
        npy("|u1", "False", "(2, 3, 3)", 18),
    ];
    fuzz("npy", &seeds("npy", made), is_cloud);
}
