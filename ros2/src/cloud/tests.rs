use super::*;
use crate::messages::ByteArray;
use formats::cloud::{CloudFile, parse_cloud};
use nalgebra::{Translation3, UnitQuaternion};
use serde_json::Value;

/// A cloud of these columns of float32, `step` bytes a point.
fn cloud(names: &[&str], rows: &[&[f32]], step: u32, height: u32) -> PointCloud2 {
    let mut data = Vec::new();
    for row in rows {
        let start = data.len();
        data.extend(row.iter().flat_map(|x| x.to_le_bytes()));
        data.resize(start + step as usize, 0xab);
    }
    let field = |(i, name): (usize, &&str)| PointField {
        name: (*name).to_owned(),
        offset: 4 * i as u32,
        datatype: 7,
        count: 1,
    };
    let width = rows.len() as u32 / height;
    PointCloud2 {
        height,
        width,
        fields: names.iter().enumerate().map(field).collect(),
        point_step: step,
        row_step: step * width,
        data: ByteArray(data),
        ..PointCloud2::default()
    }
}

/// Turned by 90 degrees about z, then moved by (1, 2, 3).
fn placement() -> Placement {
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let pose = Isometry3::from_parts(Translation3::new(1.0, 2.0, 3.0), turn);
    Placement { base_from_frame: pose, base_from_sensor: Some(pose) }
}

/// What the request holds: the file, as its reader reads it, and the body.
fn sent(request: &ScanRequest) -> (CloudFile, Value) {
    let body: Value = serde_json::from_slice(&request.body).expect("JSON");
    let bytes = STANDARD.decode(body["cloud_base64"].as_str().expect("text")).expect("base64");
    (parse_cloud("cloud.pcd".as_ref(), &bytes).expect("a PCD"), body)
}

fn near(p: &Point3<f64>, expected: [f64; 3]) {
    assert!((p - Point3::from(expected)).norm() < 1e-6, "{p}, expected {expected:?}");
}

#[test]
fn columns_of_any_order_and_padding_are_brought_into_the_base_frame() {
    let rows: [&[f32]; 2] = [&[9.0, 0.3, 0.2, 0.1], &[9.0, 3.0, 2.0, 1.0]];
    let made = request(&cloud(&["intensity", "z", "y", "x"], &rows, 32, 1), &placement()).expect("a scan");
    let (file, body) = sent(&made);
    near(&file.cloud.points[0], [1.0 - 0.2, 2.0 + 0.1, 3.0 + 0.3]);
    near(&file.cloud.points[1], [1.0 - 2.0, 2.0 + 1.0, 3.0 + 3.0]);
    assert_eq!(body["from"], json!([1.0, 2.0, 3.0]));
    assert_eq!(made.made_of, MadeOf { kind: "cloud", returns: 2, ..MadeOf::default() });
}

#[test]
fn doubles_far_away_keep_their_digits() {
    let mut wide = cloud(&["x", "y", "z"], &[&[0.0; 6]], 24, 1);
    let bytes = [500_000.125, 0.000_1, 2.0f64].iter().flat_map(|x| x.to_le_bytes()).collect();
    wide.data = ByteArray(bytes);
    wide.fields.iter_mut().enumerate().for_each(|(i, f)| (f.datatype, f.offset) = (8, 8 * i as u32));
    let still = Placement { base_from_frame: Isometry3::identity(), base_from_sensor: None };
    let made = request(&wide, &still).expect("a scan");
    let (file, body) = sent(&made);
    assert_eq!(file.cloud.points[0], Point3::new(500_000.125, 0.000_1, 2.0));
    assert_eq!(body.get("from"), None, "where the camera was is not known");
}

#[test]
fn points_that_are_no_numbers_are_left_out_and_normals_turned() {
    let rows: [&[f32]; 3] = [
        &[0.1, 0.2, 0.3, 1.0, 0.0, 0.0],
        &[f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0],
        &[0.3, 0.2, f32::INFINITY, 0.0, 0.0, 0.0],
    ];
    let names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"];
    let made = request(&cloud(&names, &rows, 24, 1), &placement()).expect("a scan");
    let (file, _) = sent(&made);
    assert_eq!((file.cloud.len(), made.made_of.returns, made.made_of.without), (1, 1, 2));
    assert!((file.cloud.normals[0] - Vector3::y()).norm() < 1e-6, "{}", file.cloud.normals[0]);
}

#[test]
fn an_organised_cloud_keeps_its_pixels_and_its_sensor() {
    let rows: Vec<[f32; 3]> = (0..6).map(|i| if i == 4 { [0.0; 3] } else { [i as f32, 1.0, 2.0] }).collect();
    let rows: Vec<&[f32]> = rows.iter().map(|r| &r[..]).collect();
    let made = request(&cloud(&["x", "y", "z"], &rows, 16, 2), &placement()).expect("a scan");
    let (file, _) = sent(&made);
    let grid = file.grid.expect("a grid");
    assert_eq!((grid.width, grid.height, grid.pixels), (3, 2, vec![0, 1, 2, 3, 5]));
    let viewpoint = file.viewpoint.expect("the sensor's pose");
    assert!((viewpoint.inverse() * placement().base_from_frame).translation.vector.norm() < 1e-12);
    assert_eq!(made.made_of.kind, "organised cloud");
    assert!(made.made_of.notes[0].contains("1 points at exactly (0, 0, 0)"), "{:?}", made.made_of.notes);
}

#[test]
fn rows_may_be_padded_and_a_single_row_needs_no_step() {
    let rows: [&[f32]; 4] = [&[1.0, 0.0, 1.0], &[2.0, 0.0, 1.0], &[3.0, 0.0, 1.0], &[4.0, 0.0, 1.0]];
    let mut padded = cloud(&["x", "y", "z"], &rows, 12, 2);
    padded.row_step = 30;
    padded.data.0.splice(24..24, [0xcd; 6]);
    let still = Placement { base_from_frame: Isometry3::identity(), base_from_sensor: None };
    let (file, _) = sent(&request(&padded, &still).expect("a scan"));
    assert_eq!(file.cloud.points.iter().map(|p| p.x).collect::<Vec<_>>(), [1.0, 2.0, 3.0, 4.0]);
    let mut single = cloud(&["x", "y", "z"], &rows, 12, 1);
    single.row_step = 0;
    assert_eq!(request(&single, &still).expect("a scan").made_of.returns, 4);
}

#[test]
fn what_is_wrong_is_named() {
    let good = cloud(&["x", "y", "z"], &[&[0.1, 0.2, 0.3], &[0.2, 0.2, 0.3]], 12, 1);
    type Change = fn(&mut PointCloud2);
    let refused = |change: Change| {
        let mut cloud = good.clone();
        change(&mut cloud);
        request(&cloud, &placement()).expect_err("refused").to_string()
    };
    let cases: [(Change, &str); 11] = [
        (|c| c.is_bigendian = true, "is_bigendian: found true"),
        (
            |c| c.fields[2].name = "depth".to_owned(),
            r#"fields: found ["x", "y", "depth"], expected x, y and z among them"#,
        ),
        (|c| c.fields[1].datatype = 4, "field y: found uint16, expected float32 or float64"),
        (|c| c.fields[1].datatype = 77, "field y: found type 77"),
        (|c| c.fields[1].count = 3, "field y: found 3 numbers"),
        (|c| c.fields[2].offset = 9, "field z: found offset 9 in points of 12 bytes"),
        (|c| c.fields[2].offset = u32::MAX, "field z: found offset 4294967295"),
        (|c| c.fields.push(c.fields[0].clone()), "field x: found it twice"),
        (|c| c.width = 0, "width and height: found 0 x 1"),
        (|c| (c.height, c.row_step) = (2, 20), "row_step: found 20 bytes for 2 points of 12"),
        (|c| (c.width, c.height, c.row_step) = (u32::MAX, u32::MAX, u32::MAX), "row_step: found 4294967295 bytes"),
    ];
    for (change, expected) in cases {
        let said = refused(change);
        assert!(said.starts_with("PointCloud2: ") && said.contains(expected), "{said}: expected {expected}");
    }
    let said = refused(|c| c.data.0.truncate(23));
    assert_eq!(said, "PointCloud2: data: found 23 bytes for 2 x 1 points of 12, expected row_step times height");
}

#[test]
fn a_frame_that_looks_elsewhere_is_told() {
    let behind = cloud(&["x", "y", "z"], &[&[1.0, 0.2, -0.3], &[1.0, 0.2, -0.1], &[1.0, 0.0, 0.2]], 12, 1);
    let made = request(&behind, &placement()).expect("a scan");
    assert!(made.made_of.notes[0].starts_with("33 % of the points lie ahead"), "{:?}", made.made_of.notes);
}

#[test]
fn normals_of_another_type_are_left_out_and_told() {
    let rows: [&[f32]; 1] = [&[0.1, 0.2, 0.3, 1.0, 0.0, 0.0]];
    let mut odd = cloud(&["x", "y", "z", "normal_x", "normal_y", "normal_z"], &rows, 24, 1);
    odd.fields[4].datatype = 2;
    let made = request(&odd, &placement()).expect("a scan");
    assert!(sent(&made).0.cloud.normals.is_empty());
    assert!(made.made_of.notes[0].contains("field normal_y: found uint8"), "{:?}", made.made_of.notes);
}
