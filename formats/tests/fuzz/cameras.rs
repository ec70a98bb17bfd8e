//! Calibrations of cameras.

use crate::harness::fuzz;
use formats::camera::parse_camera;
use geometry::{DepthImage, PinholeCamera, undistort_depth};
use nalgebra::Isometry3;
use std::path::PathBuf;

/// Calibrations in every dialect that is read.
mod calibrations {
    pub const ROS: &str = "image_width: 640
image_height: 480
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0., 320.25, 0., 501, 239, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 1.0e-3, -0.002, 0.05]
projection_matrix:
  rows: 3
  cols: 4
  data: [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.]
";

    pub const MESSAGE: &str = "header:\n  stamp:\n    sec: 3\n  frame_id: optical\nheight: 480\nwidth: 640\n\
distortion_model: rational_polynomial\nd:\n- 0.1\n- -0.2\n- 0.001\n- -0.002\n- 0.05\n- 0.3\n- 0.4\n- 0.5\n\
k:\n- 500.5\n- 0.0\n- 320.25\n- 0.0\n- 501.0\n- 239.0\n- 0.0\n- 0.0\n- 1.0\n\
binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  do_rectify: false\n---\n";

    pub const OPENCV: &str = "%YAML:1.0
---
calibration_time: \"Sat Nov 28\"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.0050000000000000e+02, 0., 3.2025000000000000e+02, 0.,
       501., 239., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.0000000000000001e-01, -2.0000000000000001e-01, 1.e-03, -2.e-03, 5.e-02 ]
";

    pub const KALIBR: &str = "cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [500.5, 501.0, 320.25, 239.0]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.2, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [500.5, 501.0, 320.25, 239.0]
  resolution: [640, 480]
";

    pub const REALSENSE: &str = r#"{"width": 640, "height": 480, "ppx": 320.25, "ppy": 239.0, "fx": 500.5, "fy": 501.0,
    "model": "distortion.brown_conrady", "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05]}"#;

    pub const OPEN3D: &str =
        r#"{"width": 640, "height": 480, "intrinsic_matrix": [500.5, 0, 0, 0, 501.0, 0, 320.25, 239.0, 1]}"#;
}

/// Through the lens to the points that a planner would see.
#[test]
fn cameras() {
    use calibrations::{KALIBR, MESSAGE, OPEN3D, OPENCV, REALSENSE, ROS};
    let yaml = [ROS, MESSAGE, OPENCV, KALIBR].map(|text| (PathBuf::from("made.yaml"), text.as_bytes().to_vec()));
    let json = [REALSENSE, OPEN3D].map(|text| (PathBuf::from("made.json"), text.as_bytes().to_vec()));
    let seeds: Vec<_> = yaml.into_iter().chain(json).collect();
    let image = DepthImage { origin: [0, 0], size: [16, 12], depth: vec![0.7; 192] };
    fuzz("cameras", &seeds, |path, bytes| {
        let Ok(file) = parse_camera(path, bytes, None).or_else(|_| parse_camera(path, bytes, Some("cam0"))) else {
            return false;
        };
        let [fx, fy, cx, cy] = file.intrinsics;
        assert!(file.intrinsics.iter().all(|x| x.is_finite()) && fx > 0.0 && fy > 0.0, "{:?}", file.intrinsics);
        // Of the size of the image, for speed: the lens is what it is of.
        let camera = PinholeCamera { width: 16, height: 12, fx, fy, cx, cy };
        let seen = undistort_depth(&image, &camera, &file.lens);
        let points = seen.image.to_points(&seen.camera, &Isometry3::identity());
        assert!(points.iter().all(|p| p.iter().all(|x| x.is_finite())), "a point that is not finite");
        true
    });
}
