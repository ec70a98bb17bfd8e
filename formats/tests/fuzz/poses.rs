//! Poses of cameras.

use crate::harness::{fuzz, only_readable};
use formats::camera::check_intrinsics;
use formats::poses::parse_poses;
use nalgebra::Isometry3;
use std::path::PathBuf;

#[test]
fn poses() {
    let row = |x: f64| format!("1 0 0 {x}\n0 0 -1 0.5\n0 1 0 0.25\n0 0 0 1\n");
    let made = [
        ("a.txt", row(1.0) + &row(2.0)),
        ("kitti.txt", "1 0 0 1 0 0 -1 0.5 0 1 0 0.25\n1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1\n".to_owned()),
        (
            "euroc.csv",
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n\
             15,0.1,0.2,0.3,1,0,0,0\n"
                .to_owned(),
        ),
        ("a.tum", "1.5 0.1 0.2 0.3 0 0 0 1\n2.5 0.1 0.2 0.3 0.7071068 0 0 0.7071068\n".to_owned()),
        ("a.log", format!("0 0 1\n{}1 1 2\n{}", row(1.0), row(2.0))),
        ("images.txt", "# Image list\n#   IMAGE_ID, QW, ...\n1 1 0 0 0 1 2 3 1 a.png\n10.5 20.5 -1\n".to_owned()),
        (
            "a.conf",
            "camera -0.01 0 0.75 0 0 0 1\nbmesh bun000.ply 0 0 0 0 0 0 1\nbmesh b.ply 0.1 0 0 0 1 0 0\n".to_owned(),
        ),
        ("a.json", "[[[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]]".to_owned()),
        (
            "scene_gt.json",
            "{\"0\": [{\"cam_R_m2c\": [0, -1, 0, 1, 0, 0, 0, 0, 1], \"cam_t_m2c\": [1000, 2000, 3000]}]}".to_owned(),
        ),
        (
            "scene_camera.json",
            "{\"0\": {\"cam_K\": [500, 0, 320, 0, 510, 240, 0, 0, 1], \"cam_R_w2c\": [0, -1, 0, 1, 0, 0, 0, 0, 1], \
             \"cam_t_w2c\": [1000, 2000, 3000], \"depth_scale\": 0.1}}"
                .to_owned(),
        ),
        (
            "camera.json",
            "{\"extrinsic\": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], \"intrinsic\": {\"height\": 480, \
             \"width\": 640, \"intrinsic_matrix\": [500, 0, 0, 0, 510, 0, 320, 240, 1]}}"
                .to_owned(),
        ),
    ];
    let seeds: Vec<_> = made.into_iter().map(|(name, text)| (PathBuf::from(name), text.into_bytes())).collect();
    let seeds = only_readable(seeds, |path, bytes| parse_poses(path, bytes).is_ok());
    assert!(seeds.len() >= 8, "{seeds:?}");
    fuzz("poses", &seeds, |path, bytes| match parse_poses(path, bytes) {
        Ok(file) => {
            let rigid = |pose: &Isometry3<f64>| pose.to_homogeneous().iter().all(|x| x.is_finite());
            assert!(file.poses.iter().all(|named| rigid(&named.world_from_camera)), "a pose that is not finite");
            let mut intrinsics = file.poses.iter().filter_map(|pose| pose.intrinsics);
            assert!(intrinsics.all(|k| check_intrinsics(k).is_ok()), "intrinsics that no camera has");
            true
        }
        Err(_) => false,
    });
}
