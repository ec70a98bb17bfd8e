//! Small whole files of everything that a scan comes in.

use geometry::{DepthImage, View};
use nalgebra::Point3;
use planning::pose::Pose;
use ros2::messages::{CameraInfo, Image, PointCloud2, PointField};
use serde_json::json;

/// Columns and rows of the images.
pub const SIZE: [u32; 2] = [12, 9];

/// A whole file, with the name that tells its format.
pub type File = (&'static str, Vec<u8>);

/// Points of a bent sheet of 12 x 9 cm, as a camera at the origin sees it, row by row.
pub fn sheet() -> Vec<[f32; 3]> {
    let at = |i: usize| {
        let (x, y) = ((i % 12) as f32 * 0.01 - 0.06, (i / 12) as f32 * 0.01 - 0.045);
        let z = 0.4 + x * x;
        [x * z / 0.4, y * z / 0.4, z]
    };
    (0..108).map(at).collect()
}

fn lines(separator: &str) -> String {
    let line = |p: [f32; 3]| p.map(|x| x.to_string()).join(separator) + "\n";
    sheet().into_iter().map(line).collect()
}

fn npy(descr: &str, shape: &str, values: impl Iterator<Item = u8>) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes().chain(values));
    bytes
}

/// A small file of every format that clouds come in.
pub fn clouds() -> Vec<File> {
    let floats = || sheet().into_iter().flatten().flat_map(f32::to_le_bytes);
    let ply = |format: &str, body: Vec<u8>| {
        let head = format!(
            "ply\nformat {format} 1.0\ncomment made\nelement vertex 108\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        );
        [head.into_bytes(), body].concat()
    };
    let pcd = |data: &str, body: Vec<u8>| {
        let head = format!(
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 12\nHEIGHT 9\nVIEWPOINT 0 0 0 1 0 0 0\n\
             POINTS 108\nDATA {data}\n"
        );
        [head.into_bytes(), body].concat()
    };
    let literal: Vec<u8> =
        floats().collect::<Vec<_>>().chunks(32).flat_map(|r| [&[r.len() as u8 - 1], r].concat()).collect();
    let sizes = [(literal.len() as u32).to_le_bytes(), 1296u32.to_le_bytes()].concat();
    vec![
        ("a.xyz", lines(" ").into_bytes()),
        (
            "a.csv",
            ("t,x,y,z\n".to_owned() + &lines(",").lines().map(|l| format!("1,{l}\n")).collect::<String>()).into_bytes(),
        ),
        ("b.csv", ("x;y;z\n".to_owned() + &lines(";").replace('.', ",")).into_bytes()),
        ("a.ply", ply("ascii", lines(" ").into_bytes())),
        ("b.ply", ply("binary_little_endian", floats().collect())),
        ("a.pcd", pcd("ascii", lines(" ").into_bytes())),
        ("b.pcd", pcd("binary", floats().collect())),
        ("c.pcd", pcd("binary_compressed", [sizes, literal].concat())),
        ("a.npy", npy("<f4", "(108, 3)", floats())),
        ("b.npy", npy("<f4", "(9, 12, 3)", floats())),
    ]
}

/// The sheet as a depth image, metres.
pub fn depth() -> DepthImage {
    let depth = (0..108).map(|i| (400 + i % 12) as f32 * 1e-3).collect();
    DepthImage { origin: [0, 0], size: SIZE, depth }
}

/// A small file of every format that depth images come in.
pub fn images() -> Vec<File> {
    let directory = tempfile::tempdir().expect("a temporary folder");
    let path = directory.path().join("d.png");
    formats::depth::write_depth(&path, &depth(), SIZE[0], SIZE[1], 0.001).expect("written");
    let integers = || depth().depth.into_iter().flat_map(|z| ((z * 1000.0).round() as u16).to_le_bytes());
    let floats = || depth().depth.into_iter().flat_map(|z| if z > 0.41 { f32::NAN } else { z }.to_le_bytes());
    vec![
        ("a.png", formats::file::read(&path).expect("read")),
        ("a.npy", npy("<u2", "(9, 12)", integers())),
        ("b.npy", npy("<f4", "(9, 12)", floats())),
    ]
}

/// Calibrations of the images' camera.
pub fn calibrations() -> Vec<File> {
    let ros = "image_width: 12\nimage_height: 9\ncamera_matrix: {rows: 3, cols: 3, data: [40, 0, 6, 0, 40, 4.5, 0, 0, 1]}\n\
               distortion_model: plumb_bob\n\
               distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.11, 0.001, -0.001, -0.02]}\n";
    let kalibr = "cam0:\n  camera_model: pinhole\n  intrinsics: [40, 40, 6, 4.5]\n  distortion_model: equidistant\n  \
                  distortion_coeffs: [0.01, 0.002, -0.001, 0.0005]\n  resolution: [12, 9]\n";
    let realsense = json!({
        "width": 12, "height": 9, "ppx": 6.0, "ppy": 4.5, "fx": 40.0, "fy": 40.0, "model": "brown_conrady",
        "coeffs": [0.1, 0.0, 0.0, 0.0, 0.0]
    });
    vec![
        ("ros.yaml", ros.into()),
        ("kalibr.yaml", kalibr.into()),
        ("realsense.json", realsense.to_string().into_bytes()),
    ]
}

/// Poses of the camera that took the images.
pub fn poses() -> Vec<File> {
    let rows = "1 0 0 0.01\n0 1 0 0.02\n0 0 1 0.03\n0 0 0 1\n";
    let json = json!({ "world_from_camera": Pose::from(&nalgebra::Isometry3::translation(0.01, 0.02, 0.03)).matrix });
    vec![
        ("rows.txt", rows.into()),
        ("a.tum", "1.5 0.01 0.02 0.03 0 0 0 1\n".into()),
        ("a.log", format!("0 0 1\n{rows}").into_bytes()),
        ("a.json", json.to_string().into_bytes()),
    ]
}

/// One merged cloud of a ball with its normals, seen from all sides but below.
pub fn merged() -> Vec<File> {
    let line = |i: usize| {
        let up = 1.0 - 1.6 * (i as f64 + 0.5) / 600.0;
        let (around, wide) = (2.399_963 * i as f64, (1.0 - up * up).sqrt());
        let n = [wide * around.cos(), wide * around.sin(), up];
        let cells: Vec<String> = n.iter().map(|x| (0.05 * x).to_string()).chain(n.map(|x| x.to_string())).collect();
        cells.join(" ") + "\n"
    };
    vec![("ball.xyz", ("x y z nx ny nz\n".to_owned() + &(0..600).map(line).collect::<String>()).into_bytes())]
}

/// Requests as HTTP carries them.
pub fn requests() -> Vec<File> {
    let view = View { target: Point3::new(0.0, 0.0, 0.4), position: Point3::origin() };
    let pose = Pose::from(&view.world_from_camera());
    let points = json!({ "points": sheet(), "from": [0, 0, 0], "unit": "m" });
    let mut image = Vec::new();
    image.extend(images().swap_remove(0).1);
    let depth = json!({ "depth": {
        "png_base64": base64(&image), "intrinsics": [40, 40, 6, 4.5], "translation_m": [0, 0, 0],
        "quaternion_xyzw": pose.quaternion_xyzw, "distortion": { "model": "brown_conrady", "coefficients": [0.1, 0, 0, 0, 0] },
        "misses": "free",
    } });
    vec![("points.json", points.to_string().into_bytes()), ("depth.json", depth.to_string().into_bytes())]
}

fn base64(bytes: &[u8]) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// A ROS 2 message of each kind: its fields as JSON in the first line, behind that its data.
pub fn messages() -> Vec<File> {
    let field = |(i, name): (u32, &str)| PointField { name: name.to_owned(), offset: 4 * i, datatype: 7, count: 1 };
    let mut cloud = PointCloud2 { width: 12, height: 9, point_step: 16, row_step: 192, ..PointCloud2::default() };
    cloud.fields = (0..).zip(["x", "y", "z"]).map(field).collect();
    let rows = sheet().into_iter().flat_map(|p| [p[0], p[1], p[2], 0.0]).flat_map(f32::to_le_bytes).collect();
    let image = Image { width: 12, height: 9, encoding: "32FC1".to_owned(), step: 48, ..Image::default() };
    let k = [40.0, 0.0, 6.0, 0.0, 40.0, 4.5, 0.0, 0.0, 1.0];
    let info = CameraInfo {
        width: 12,
        height: 9,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.1, -0.05, 0.001, 0.0, 0.0],
        k,
        ..CameraInfo::default()
    };
    let pixels = depth().depth.into_iter().flat_map(f32::to_le_bytes).collect();
    let with =
        |fields: serde_json::Value, data: Vec<u8>| [fields.to_string().into_bytes(), b"\n".to_vec(), data].concat();
    vec![
        ("cloud.msg", with(json!(without_data(&cloud)), rows)),
        ("image.msg", with(json!([without_data(&image), info]), pixels)),
    ]
}

/// A message whose data, which stand elsewhere, are empty text.
fn without_data(message: &impl serde::Serialize) -> serde_json::Value {
    let mut fields = json!(message);
    fields["data"] = "".into();
    fields
}
