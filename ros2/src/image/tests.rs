use super::*;
use crate::messages::{ByteArray, Header};
use formats::depth::parse_depth;
use serde_json::Value;

fn header() -> Header {
    Header { frame_id: "optical".to_owned(), ..Header::default() }
}

fn millimetres(values: &[u16], width: u32) -> Image {
    Image {
        header: header(),
        height: values.len() as u32 / width,
        width,
        encoding: "16UC1".to_owned(),
        is_bigendian: 0,
        step: 2 * width,
        data: ByteArray(values.iter().flat_map(|v| v.to_le_bytes()).collect()),
    }
}

fn info(width: u32, height: u32) -> CameraInfo {
    let k = [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0];
    let p = [490.0, 0.0, 318.0, 0.0, 0.0, 495.0, 239.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let d = vec![0.1, -0.2, 0.001, 0.002, 0.3];
    CameraInfo {
        header: header(),
        height,
        width,
        distortion_model: "plumb_bob".to_owned(),
        d,
        k,
        p,
        ..CameraInfo::default()
    }
}

fn depth(request: &ScanRequest) -> Value {
    serde_json::from_slice::<Value>(&request.body).expect("JSON")["depth"].clone()
}

fn metres(depth: &Value) -> Vec<f32> {
    let bytes = STANDARD.decode(depth["npy_base64"].as_str().expect("text")).expect("base64");
    parse_depth("depth.npy".as_ref(), &bytes, depth["metres_per_unit"].as_f64()).expect("an NPY").image.depth
}

#[test]
fn integers_are_millimetres_and_rows_may_be_padded() {
    let mut image = millimetres(&[1000, 0, 2500, 65_535], 2);
    image.step = 7;
    image.data.0.splice(4..4, [0xee; 3]);
    let pose = Isometry3::translation(0.1, 0.2, 0.3);
    let made = request(&image, &info(2, 2), &pose, false).expect("a scan");
    let depth = depth(&made);
    assert_eq!(metres(&depth), [1.0, 0.0, 2.5, 0.0]);
    assert_eq!(depth["intrinsics"], json!([500.0, 510.0, 320.0, 240.0]));
    assert_eq!(depth["distortion"]["model"], "brown_conrady");
    assert_eq!(depth["distortion"]["coefficients"][4], 0.3);
    assert_eq!(
        (&depth["translation_m"], &depth["quaternion_xyzw"]),
        (&json!([0.1, 0.2, 0.3]), &json!([0.0, 0.0, 0.0, 1.0]))
    );
    assert_eq!((made.made_of.returns, made.made_of.without), (2, 2));
}

#[test]
fn floats_are_metres() {
    let mut image = millimetres(&[0; 4], 1);
    (image.encoding, image.height, image.step) = ("32FC1".to_owned(), 2, 4);
    image.data = ByteArray([1.25, f32::NAN].iter().flat_map(|x: &f32| x.to_le_bytes()).collect());
    let made = request(&image, &info(1, 2), &Isometry3::identity(), false).expect("a scan");
    assert_eq!(metres(&depth(&made)), [1.25, 0.0]);
    assert_eq!(made.made_of.returns, 1);
}

#[test]
fn a_rectified_image_has_the_camera_of_p_and_no_distortion() {
    let made = request(&millimetres(&[900; 4], 2), &info(2, 2), &Isometry3::identity(), true).expect("a scan");
    let depth = depth(&made);
    assert_eq!(depth["intrinsics"], json!([490.0, 495.0, 318.0, 239.0]));
    assert_eq!(depth["distortion"], json!({ "model": "none", "coefficients": [] }));
}

#[test]
fn a_part_of_the_image_with_joined_pixels_has_its_own_camera() {
    let mut part = info(640, 480);
    (part.roi.x_offset, part.roi.y_offset, part.roi.width, part.roi.height) = (100, 40, 4, 2);
    (part.binning_x, part.binning_y) = (2, 1);
    let made = request(&millimetres(&[900; 4], 2), &part, &Isometry3::identity(), false).expect("a scan");
    assert_eq!(depth(&made)["intrinsics"], json!([250.0, 510.0, 110.0, 200.0]));
}

#[test]
fn lenses_of_ros_are_known() {
    for (model, d, expected) in [
        ("rational_polynomial", vec![0.1; 8], "brown_conrady"),
        ("equidistant", vec![0.1; 4], "fisheye"),
        ("", vec![], "none"),
        ("", vec![0.0; 5], "none"),
    ] {
        let lens = CameraInfo { distortion_model: model.to_owned(), d, ..info(2, 2) };
        let made = request(&millimetres(&[900; 4], 2), &lens, &Isometry3::identity(), false).expect("a scan");
        assert_eq!(depth(&made)["distortion"]["model"], expected, "{model}");
    }
}

#[test]
fn what_is_wrong_is_named() {
    type Change = fn(&mut Image, &mut CameraInfo);
    let cases: [(Change, &str); 11] = [
        (|i, _| i.encoding = "rgb8".to_owned(), "Image: encoding: found \"rgb8\", expected depth"),
        (|i, _| i.is_bigendian = 1, "Image: is_bigendian: found 1"),
        (|i, _| i.step = 3, "Image: step: found 3 bytes for 2 pixels of 2"),
        (|i, _| i.data.0.truncate(7), "Image: data: found 7 bytes for 2 rows of 4"),
        (|i, _| i.height = 0, "Image: width and height: found 2 x 0"),
        (|_, c| c.header.frame_id = "colour".to_owned(), "CameraInfo: header.frame_id: found \"colour\""),
        (|_, c| c.k[0] = 0.0, "CameraInfo: k: found fx, fy, cx, cy = [0.0, 510.0, 320.0, 240.0]"),
        (|_, c| (c.k[2], c.k[6]) = (0.0, 320.0), "CameraInfo: k: found 0, 320, 0 to the left of its diagonal"),
        (|_, c| c.k[1] = 3.0, "CameraInfo: k: found a skew of 3"),
        (|_, c| c.width = 3, "CameraInfo: width, height, roi and binning: found 3 x 2 pixels"),
        (|_, c| c.distortion_model = "magic".to_owned(), "CameraInfo: distortion_model and d: found model magic"),
    ];
    for (change, expected) in cases {
        let (mut image, mut camera) = (millimetres(&[900; 4], 2), info(2, 2));
        change(&mut image, &mut camera);
        let said = request(&image, &camera, &Isometry3::identity(), false).expect_err("refused").to_string();
        assert!(said.starts_with(expected), "{said}: expected {expected}");
    }
}
