use super::*;

fn parse(text: &str) -> Result<CameraFile, String> {
    parse_camera(Path::new("camera.yaml"), text.as_bytes(), None).map_err(|e| e.to_string())
}

const BROWN: [f64; 8] = [0.1, -0.2, 0.001, -0.002, 0.05, 0.0, 0.0, 0.0];

fn expected(lens: Lens) -> CameraFile {
    CameraFile { size: Some([640, 480]), intrinsics: [500.5, 501.0, 320.25, 239.0], lens, metres_per_unit: None }
}

const ROS: &str = "image_width: 640
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

const MESSAGE: &str = "header:\n  stamp:\n    sec: 3\n  frame_id: optical\nheight: 480\nwidth: 640\n\
distortion_model: rational_polynomial\nd:\n- 0.1\n- -0.2\n- 0.001\n- -0.002\n- 0.05\n- 0.3\n- 0.4\n- 0.5\n\
k:\n- 500.5\n- 0.0\n- 320.25\n- 0.0\n- 501.0\n- 239.0\n- 0.0\n- 0.0\n- 1.0\n\
binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  do_rectify: false\n---\n";

const OPENCV: &str = "%YAML:1.0
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

const KALIBR: &str = "cam0:
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

const REALSENSE: &str = r#"{"width": 640, "height": 480, "ppx": 320.25, "ppy": 239.0, "fx": 500.5, "fy": 501.0,
    "model": "distortion.brown_conrady", "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05]}"#;

const OPEN3D: &str =
    r#"{"width": 640, "height": 480, "intrinsic_matrix": [500.5, 0, 0, 0, 501.0, 0, 320.25, 239.0, 1]}"#;

#[test]
fn each_format_says_the_same_camera() {
    let brown = expected(Lens::BrownConrady(BROWN));
    assert_eq!(parse(ROS), Ok(brown.clone()));
    assert_eq!(parse(OPENCV), Ok(brown.clone()));
    assert_eq!(parse(REALSENSE), Ok(brown));
    let rational = Lens::BrownConrady([0.1, -0.2, 0.001, -0.002, 0.05, 0.3, 0.4, 0.5]);
    assert_eq!(parse(MESSAGE), Ok(expected(rational)));
    assert_eq!(parse(OPEN3D), Ok(expected(Lens::Pinhole)));
    let fisheye = expected(Lens::Fisheye([0.01, 0.02, 0.03, 0.04]));
    let of = |name| parse_camera(Path::new("chain.yaml"), KALIBR.as_bytes(), Some(name)).expect("named");
    assert_eq!(of("cam0"), fisheye);
    assert_eq!(of("cam1"), expected(Lens::BrownConrady([0.1, -0.2, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0])));
    let marked = OPENCV.replace("flags: 0", "flags: 0\nfisheye_model: 1").replace(", 5.e-02", "");
    assert_eq!(parse(&marked), Ok(expected(Lens::Fisheye([0.1, -0.2, 0.001, -0.002]))));
    let bare = ROS.replace("image_width: 640\nimage_height: 480\n", "");
    assert_eq!(parse(&bare).map(|c| c.size), Ok(None), "the size is not known");
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let refused = |text: &str, says: &str| {
        let error = parse(text).expect_err(says);
        assert!(error.contains(says) && error.contains("camera.yaml"), "{says}: {error}");
    };
    refused(&ROS.replace("plumb_bob", "thin_prism"), "thin_prism");
    refused(&ROS.replace("0., 0., 1.]\ndistortion_m", "0., 0.]\ndistortion_m"), "8 numbers");
    refused(&ROS.replace("data: [500.5, 0.,", "data: [500.5, 3.,"), "skew of 3");
    refused(&ROS.replace("data: [500.5", "data: [-500.5"), "fx and fy positive");
    refused(&ROS.replace("image_width: 640", "image_width: 0"), "0 x 480");
    refused(&ROS.replace("0.1, -0.2,", "0.1, oops,"), "distortion_coefficients");
    refused(&MESSAGE.replace("binning_x: 0", "binning_x: 2"), "binning_x");
    refused(&MESSAGE.replace("y_offset: 0", "y_offset: 12"), "y_offset of 12");
    refused(KALIBR, "cam0, cam1");
    let one = KALIBR.split("cam1:").next().expect("cam0");
    refused(&one.replace("camera_model: pinhole", "camera_model: omni"), "omni");
    refused(&one.replace("equidistant", "fov"), "fov");
    refused(
        &REALSENSE.replace("distortion.brown_conrady", "distortion.inverse_brown_conrady"),
        "inverse_brown_conrady",
    );
    refused(&REALSENSE.replace("\"fx\"", "\"f\""), "fx, fy, ppx, ppy");
    refused("<?xml version=\"1.0\"?><opencv_storage/>", "XML");
    refused("just text", "line 1");
    refused("a: &a [1, 2]\nb: *a\n", "anchor");
    refused("a: 1\na: 2\n", "a second time");
    refused("a: [1, 2\nb: 3\n", "never closed");
    refused("a: 1\n   b: 2\n", "line 2");
    refused(&"[".repeat(100_000), "never closed");
    refused(&format!("{}{}", "[".repeat(100_000), "]".repeat(100_000)), "levels");
    refused(&"- ".repeat(100_000), "too many nested levels");
    refused("{\"width\": ", "line 1");
    let zeros = REALSENSE.replace("distortion.brown_conrady", "distortion.inverse_brown_conrady");
    let zeros = zeros.replace("[0.1, -0.2, 0.001, -0.002, 0.05]", "[0.0, 0.0, 0.0, 0.0, 0.0]");
    assert_eq!(parse(&zeros), Ok(expected(Lens::Pinhole)), "no coefficients, no distortion");
}

#[test]
fn a_key_given_twice_is_no_calibration() {
    let text = r#"{"width": 32, "height": 24, "ppx": 16, "ppy": 12, "fx": 40, "fx": 80, "fy": 40, "model": "none", "coeffs": []}"#;
    let error = parse_camera(Path::new("a.json"), text.as_bytes(), None).expect_err("which fx?").to_string();
    assert!(error.contains("a.json\", line 1: found key \"fx\" a second time"), "{error}");
    assert!(parse_camera(Path::new("a.json"), text.replace("\"fx\": 80, ", "").as_bytes(), None).is_ok());
}

#[test]
fn text_of_any_system_is_read() {
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(ROS.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let latin = [b"# f\xfcr alle\n", ROS.as_bytes()].concat();
    let fortran = ROS.replace("500.5", "5.005D+02").replace("-0.2", "-.2d0");
    for bytes in [wide, latin, ROS.replace('\n', "\r").into_bytes(), fortran.into_bytes()] {
        let read = parse_camera(Path::new("camera.yaml"), &bytes, None).unwrap_or_else(|e| panic!("{bytes:?}: {e}"));
        assert_eq!(read, expected(Lens::BrownConrady(BROWN)));
    }
    let json = format!("\u{feff}{OPEN3D}");
    let wide: Vec<u8> = json.encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert_eq!(parse_camera(Path::new("a.json"), &wide, None).expect("a camera"), expected(Lens::Pinhole));
}

/// A JSON camera of a tool of one's own, with more in it.
fn with(more: &str) -> String {
    format!("{{\"width\": 640, \"height\": 480, \"fx\": 500.5, \"fy\": 501.0, \"cx\": 320.25, \"cy\": 239.0, {more}}}")
}

#[test]
fn a_lens_is_read_under_any_of_its_keys() {
    let brown = expected(Lens::BrownConrady(BROWN));
    for key in ["dist_coeff", "dist_coeffs", "distortion_coeffs", "dist", "distortion"] {
        assert_eq!(parse(&ROS.replace("distortion_coefficients", key)), Ok(brown.clone()), "{key}");
        assert_eq!(parse(&OPENCV.replace("distortion_coefficients", key)), Ok(brown.clone()), "{key}");
        let json = REALSENSE.replace("\"coeffs\"", &format!("\"{key}\""));
        assert_eq!(parse(&json), Ok(brown.clone()), "{key}");
    }
    for key in ["D", "d"] {
        let json = REALSENSE.replace("\"coeffs\"", &format!("\"{key}\""));
        assert_eq!(parse(&json), Ok(brown.clone()), "{key}");
    }
    let beside = format!("{{\"intrinsics\": {OPEN3D}, \"D\": [0.1, 0, 0, 0]}}");
    assert!(parse(&beside).expect_err("not left out").contains("under a key not known here"), "D beside the camera");
    let fisheye = expected(Lens::Fisheye([0.01, 0.02, 0.03, 0.04]));
    let one = KALIBR.split("cam1:").next().expect("cam0");
    assert_eq!(parse(&one.replace("distortion_coeffs", "distortion_coefficients")), Ok(fisheye.clone()));
    let each = "\"p2\": -0.002, \"p1\": 1e-3, \"k1\": 0.1, \"k3\": 0.05, \"k2\": -0.2";
    assert_eq!(parse(&with(each)), Ok(brown), "tangential ones are of this model alone");
    let four = "\"k1\": 0.01, \"k2\": 0.02, \"k3\": 0.03, \"k4\": 0.04";
    assert_eq!(parse(&with(&format!("{four}, \"model\": \"fisheye\""))), Ok(fisheye));
    assert!(parse(&with(four)).expect_err("of which model?").contains("coefficients without a model"));
    let typed = ROS.replace("distortion_model: plumb_bob", "distortion_type: thin_prism");
    assert!(parse(&typed).expect_err("a model").contains("thin_prism"));
}

#[test]
fn coefficients_under_another_key_are_refused_by_it() {
    let one = KALIBR.split("cam1:").next().expect("cam0");
    let nested = format!("{{\"intrinsics\": {}, \"lens_distortion\": [0.1, 0.2, 0, 0]}}", with("\"model\": \"none\""));
    for text in [
        OPENCV.replace("distortion_coefficients", "lens_distortion"),
        one.replace("distortion_coeffs", "lens_distortion"),
        REALSENSE.replace("\"coeffs\"", "\"lens_distortion\""),
        OPEN3D.replace("\"width\"", "\"lens_distortion\": [0.1], \"width\""),
        with("\"lens_distortion\": {\"a\": 0.1}"),
        nested,
    ] {
        let error = parse(&text).expect_err(&text);
        assert!(error.contains("lens_distortion: found coefficients of a lens under a key not known here"), "{error}");
        assert!(error.contains("distortion_coefficients, "), "{error}");
    }
    let harmless = "\"working_distance\": 0.4, \"distortion_calibrated\": true, \"lens_dist\": [0, 0], \"dist\": null";
    assert_eq!(parse(&with(harmless)), Ok(expected(Lens::Pinhole)));
    let zeros = OPENCV.replace("distortion_coefficients", "lens_distortion");
    let zeros = zeros.split("1.0000000000000001e-01").next().expect("a list").to_owned() + "0, 0. ]\n";
    assert_eq!(parse(&zeros).map(|camera| camera.lens.is_pinhole()), Ok(true));
}

#[test]
fn bops_camera_has_the_unit_of_its_images() {
    let bop = CameraFile { metres_per_unit: Some(0.001 * 0.1), ..expected(Lens::Pinhole) };
    assert_eq!(parse(&with("\"depth_scale\": 0.1")), Ok(bop));
    for other in ["\"depth_scale\": 0.001, \"model\": \"none\"", "\"depth_scale\": 1000.0, \"serial\": 7"] {
        assert_eq!(parse(&with(other)), Ok(expected(Lens::Pinhole)), "of another unit: {other}");
    }
    for wrong in ["0", "-1", "\"0.1\""] {
        assert!(
            parse(&with(&format!("\"depth_scale\": {wrong}"))).expect_err(wrong).contains("depth_scale"),
            "{wrong}"
        );
    }
}

#[test]
fn matrices_may_be_lists_of_rows() {
    let flow = "camera_matrix: [[500.5, 0, 320.25], [0, 501, 239], [0, 0, 1]]\ndist_coeff: [[0.1, -0.2, 0.001, -0.002, 0.05]]\n";
    let rows = "camera_matrix:\n- [500.5, 0, 320.25]\n- [0, 501, 239]\n- [0, 0, 1]\ndist_coeff:\n- [0.1, -0.2, 0.001, -0.002, 0.05]\n";
    let dashes = "camera_matrix:\n- - 500.5\n  - 0.0\n  - 320.25\n- - 0.0\n  - 501\n  - 239\n- - 0.0\n  - 0.0\n  - 1.0\n\
                  dist_coeff:\n- - 0.1\n  - -0.2\n  - 0.001\n  - -0.002\n  - 0.05\n";
    let beside = format!("images:\n- name: a.png\n  corners:\n  - [1, 2]\n-   name: b.png\n    corners: []\n{flow}");
    for text in [flow, rows, dashes, &beside] {
        let camera = CameraFile { size: None, ..expected(Lens::BrownConrady(BROWN)) };
        assert_eq!(parse(text), Ok(camera), "{text}");
    }
}
