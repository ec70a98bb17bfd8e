use super::*;
use crate::cloud::write_ply;
use crate::depth::write_depth;
use geometry::PointCloud;
use nalgebra::Matrix4;
use std::fs;

const SCAN: &str = r#"{"cloud": "a.ply", "camera_position_m": [1, 0, 0]}"#;

/// A folder with a sheet at x = 0, `a.ply`, seen from +x, and its depth image `a.png`.
fn folder() -> (tempfile::TempDir, View, PinholeCamera) {
    let dir = tempfile::tempdir().expect("a folder");
    let view = View { target: Point3::origin(), position: Point3::new(1.0, 0.0, 0.0) };
    let camera = PinholeCamera { width: 40, height: 30, fx: 200.0, fy: 200.0, cx: 19.5, cy: 14.5 };
    let depth = DepthImage { origin: [0, 0], size: [40, 30], depth: vec![1.0; 1200] };
    let points = depth.to_points(&camera, &view.world_from_camera_with_up(&Vector3::z()));
    write_ply(&dir.path().join("a.ply"), &PointCloud { points, normals: Vec::new() }).expect("written");
    write_depth(&dir.path().join("a.png"), &depth, 40, 30, 0.001).expect("written");
    (dir, view, camera)
}

fn read(dir: &Path, text: &str) -> Result<Sequence, FormatError> {
    let path = dir.join(SEQUENCE);
    fs::write(&path, text).expect("written");
    read_sequence(&path)
}

#[test]
fn positions_and_poses_are_read() {
    let (dir, view, _) = folder();
    let pose = view.world_from_camera_with_up(&Vector3::z());
    let m = pose.to_homogeneous();
    let rows: Vec<Vec<f64>> = (0..4).map(|r| (0..4).map(|c| m[(r, c)]).collect()).collect();
    let text = format!(
        "{{\"object\": \"sheet\", \"working_distance_m\": 0.5, \"tolerance_m\": 0.003, \"scans\": [{SCAN}, {{\"cloud\": \
         \"a.ply\", \"recorded\": \"second\", \"depth\": \"a.png\", \"intrinsics\": [200, 200, 19.5, 14.5], \
         \"world_from_camera\": {rows:?}}}]}}\r\n"
    );
    let sequence = read(dir.path(), &text).expect("good");
    assert_eq!((sequence.working_distance_m, sequence.tolerance_m, sequence.scans.len()), (0.5, Some(0.003), 2));
    // Known by its position alone, it looks at the middle of the sheet, which is the origin, z up.
    for scan in &sequence.scans {
        assert_eq!(scan.points.len(), 1200);
        let off = (scan.world_from_camera.to_homogeneous() - m).amax();
        assert!(off < 1e-3, "{off}: {:?}", scan.world_from_camera);
    }
    assert!(sequence.scans[0].image.is_none() && sequence.scans[1].image.is_some());
}

#[test]
fn poses_come_from_files_too() {
    let (dir, view, _) = folder();
    fs::copy(dir.path().join("a.ply"), dir.path().join("b.ply")).expect("copied");
    let m = view.world_from_camera_with_up(&Vector3::z()).to_homogeneous();
    let rows: Vec<String> =
        (0..4).map(|r| format!("{} {} {} {}", m[(r, 0)], m[(r, 1)], m[(r, 2)], m[(r, 3)])).collect();
    let put = |count| fs::write(dir.path().join("poses.txt"), (rows.join("\n") + "\n").repeat(count)).expect("written");
    let by = |poses: &str| {
        format!(
            "{{\"working_distance_m\": 1, {poses}, \"scans\": [{{\"cloud\": \"a.ply\"}}, {{\"cloud\": \"b.ply\"}}]}}"
        )
    };
    put(2);
    let sequence = read(dir.path(), &by("\"poses\": \"poses.txt\"")).expect("one each");
    assert!(sequence.scans.iter().all(|s| (s.world_from_camera.to_homogeneous() - m).amax() < 1e-9));
    put(3);
    let error = read(dir.path(), &by("\"poses\": \"poses.txt\"")).expect_err("which?").to_string();
    assert!(error.contains("poses.txt") && error.contains("found 3 poses, expected 2"), "{error}");
    // Half a turn about z and 2 m along y: the sheet at x = 0 seen from (1, 0, 0) is then seen from (-1, 2, 0).
    fs::write(dir.path().join("all.conf"), "bmesh b.ply 0 2 0 0 0 1 0\nbmesh a.ply 0 0 0 0 0 0 1\n").expect("written");
    let placed = by("\"placed_by\": \"all.conf\", \"camera_in_scan_m\": [1, 0, 0]");
    let sequence = read(dir.path(), &placed).expect("placed");
    let position = |i: usize| Point3::from(sequence.scans[i].world_from_camera.translation.vector);
    assert!((position(0) - Point3::new(1.0, 0.0, 0.0)).norm() < 1e-9);
    assert!((position(1) - Point3::new(-1.0, 2.0, 0.0)).norm() < 1e-9, "{}", position(1));
    let (a, b) = (sequence.scans[0].points[0], sequence.scans[1].points[0]);
    assert!((b - Point3::new(-a.x, 2.0 - a.y, a.z)).norm() < 1e-9, "{a} {b}");
    let wrong = read(dir.path(), &by("\"poses\": \"all.conf\"")).expect_err("places").to_string();
    assert!(wrong.contains("placed_by"), "{wrong}");
    fs::write(dir.path().join("all.conf"), "bmesh b.ply 0 2 0 0 0 1 0\n").expect("written");
    assert!(read(dir.path(), &placed).expect_err("one is missing").to_string().contains("no line of a.ply"));
}

#[test]
fn what_cannot_be_replayed_is_refused_with_its_place() {
    let (dir, view, _) = folder();
    let two = |scan: &str| format!("{{\"working_distance_m\": 1, \"scans\": [{SCAN}, {scan}]}}");
    let rows = |pose: &Isometry3<f64>| {
        let m = pose.to_homogeneous();
        let row = |r: usize| format!("[{}, {}, {}, {}]", m[(r, 0)], m[(r, 1)], m[(r, 2)], m[(r, 3)]);
        format!("[{}, {}, {}, {}]", row(0), row(1), row(2), row(3))
    };
    let pose = view.world_from_camera_with_up(&Vector3::z());
    let with_pose = |pose: &Isometry3<f64>, more: &str| {
        two(&format!("{{\"cloud\": \"a.ply\", \"world_from_camera\": {}{more}}}", rows(pose)))
    };
    let away = pose * Isometry3::rotation(Vector3::y() * std::f64::consts::PI);
    let farther = Isometry3::translation(0.2, 0.0, 0.0) * pose;
    let image = ", \"depth\": \"a.png\", \"intrinsics\": [200, 200, 19.5, 14.5]";
    for (text, said) in [
        (two(r#"{"cloud": "a.ply"}"#), "scan 1 (a.ply): found neither of both, expected its camera"),
        (two(r#"{"cloud": "b.ply", "camera_position_m": [1, 0, 0]}"#), "b.ply"),
        (two(r#"{"cloud": "a.ply", "position": [1, 0, 0]}"#), "line 1: found unknown field `position`"),
        (format!("{{\"working_distance_m\": 1, \"scans\": [{SCAN}]}}"), "scans: found 1 scans, expected at least 2"),
        (format!("{{\"scans\": [{SCAN}, {SCAN}]}}"), "missing field `working_distance_m`"),
        (format!("{{\"working_distance_m\": 0, \"scans\": [{SCAN}, {SCAN}]}}"), "working_distance_m: found 0"),
        (with_pose(&away, ""), "scan 1 (a.ply): found 0 % of its points ahead of its camera"),
        (with_pose(&farther, image), "scan 1 (a.ply): found 0 % of its points where its depth image has them"),
        (with_pose(&pose, ", \"depth\": \"a.png\""), "depth without intrinsics"),
        (with_pose(&pose, ", \"camera_position_m\": [1, 0.1, 0]"), "0.100 m away"),
        (two(&format!("{}{image}}}", SCAN.trim_end_matches('}'))), "depth without a pose"),
    ] {
        let error = read(dir.path(), &text).expect_err(said).to_string();
        assert!(error.contains(said) && error.contains(dir.path().to_str().expect("a name")), "{said:?}: {error}");
    }
    assert!(read(dir.path(), &with_pose(&pose, image)).is_ok(), "the right pose is taken");
}

/// A pose as `sequence.json` has it.
fn as_rows(pose: &Matrix4<f64>) -> String {
    let rows: Vec<Vec<f64>> = (0..4).map(|r| (0..4).map(|c| pose[(r, c)]).collect()).collect();
    format!("{rows:?}")
}

#[test]
fn units_of_columns_are_heeded_and_notes_of_readers_told() {
    let (dir, _, _) = folder();
    let metres = crate::cloud::read_cloud(&dir.path().join("a.ply")).expect("written").cloud.points;
    let rows: String = metres.iter().map(|p| format!("{},{},{}\n", 1e3 * p.x, 1e3 * p.y, 1e3 * p.z)).collect();
    fs::write(dir.path().join("mm.csv"), format!("x_mm,y_mm,z_mm\n{rows}nan,0,0\n")).expect("written");
    let scan = SCAN.replace("a.ply", "mm.csv");
    let path = dir.path().join(SEQUENCE);
    fs::write(&path, format!("{{\"working_distance_m\": 1, \"scans\": [{SCAN}, {scan}]}}")).expect("written");
    let (sequence, notes) = read_with_notes(&path).expect("good");
    let points = &sequence.scans[1].points;
    assert_eq!(points.len(), metres.len());
    assert!(points.iter().zip(&metres).all(|(p, q)| (p - q).norm() < 1e-9), "{} for {}", points[0], metres[0]);
    assert_eq!(
        notes,
        [
            "mm.csv: 1 points have a non-finite coordinate and were dropped",
            "mm.csv: read in units of 0.001 m, as its columns say"
        ]
    );
}

#[test]
fn poses_off_a_rotation_are_told() {
    let (dir, view, _) = folder();
    let path = dir.path().join(SEQUENCE);
    let mut pose = view.world_from_camera_with_up(&Vector3::z()).to_homogeneous();
    let good = as_rows(&pose);
    pose.fixed_view_mut::<3, 3>(0, 0).scale_mut(1.01);
    let off = as_rows(&pose);
    let scans = |second: &str| format!("[{{\"cloud\": \"a.ply\", \"world_from_camera\": {good}}}, {second}]");
    fs::write(dir.path().join("poses.json"), format!("[{good}, {off}]")).expect("written");
    for text in [
        format!("\"scans\": {}", scans(&format!("{{\"cloud\": \"a.ply\", \"world_from_camera\": {off}}}"))),
        format!("\"poses\": \"poses.json\", \"scans\": {}", scans("{\"cloud\": \"a.ply\"}")),
    ] {
        fs::write(&path, format!("{{\"working_distance_m\": 1, {text}}}")).expect("written");
        let (_, notes) = read_with_notes(&path).expect("good");
        let said = "poses deviate from rotations by up to 1.0e-2 (scan 1); the nearest rotations are used";
        assert_eq!(notes, [said], "{text}");
    }
}

#[test]
fn depths_of_floats_are_metres_and_a_wrong_unit_is_named() {
    let (dir, view, _) = folder();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (30, 40), }\n";
    let values: Vec<u8> = [1f32; 1200].iter().flat_map(|z| z.to_le_bytes()).collect();
    let bytes = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &values].concat();
    fs::write(dir.path().join("a.npy"), bytes).expect("written");
    let rows = as_rows(&view.world_from_camera_with_up(&Vector3::z()).to_homogeneous());
    let scan = format!(
        "{{\"cloud\": \"a.ply\", \"depth\": \"a.npy\", \"intrinsics\": [200, 200, 19.5, 14.5], \"world_from_camera\": {rows}}}"
    );
    let text = |unit: &str| format!("\u{feff}{{\"working_distance_m\": 1, {unit}\"scans\": [{SCAN}, {scan}]}}");
    let sequence = read(dir.path(), &text("")).expect("metres");
    assert_eq!(sequence.scans[1].image.as_ref().and_then(|(_, depth)| depth.at(3, 5)), Some(1.0));
    let error = read(dir.path(), &text("\"depth_unit_m\": 0.001, ")).expect_err("a thousandth").to_string();
    assert!(error.contains("where its depth image has them") && error.contains("depth_unit_m"), "{error}");
}

#[test]
fn poses_go_to_the_scans_that_they_are_called_like() {
    let (dir, view, _) = folder();
    for copy in ["b.ply", "00.ply", "10.ply", "l/00.ply", "r/00.ply"] {
        let copy = dir.path().join(copy);
        fs::create_dir_all(copy.parent().expect("a folder")).expect("made");
        fs::copy(dir.path().join("a.ply"), copy).expect("copied");
    }
    // The pose that is listed first is 1 m from the sheet, the second one 2 m.
    let pose = |x: f64| {
        let ahead = Isometry3::translation(x, 0.0, 0.0);
        as_rows(&(ahead * view.world_from_camera_with_up(&Vector3::z())).to_homogeneous())
    };
    let positions = |names: [&str; 2], clouds: [&str; 2], own: &str| {
        let named = |x: f64, name: &str| format!("{{\"world_from_camera\": {}, \"name\": \"{name}\"}}", pose(x));
        let poses = format!("[{}, {}]", named(0.0, names[0]), named(1.0, names[1]));
        fs::write(dir.path().join("poses.json"), poses).expect("written");
        let [a, b] = clouds;
        let scans = format!("[{{\"cloud\": \"{a}\"}}, {{\"cloud\": \"{b}\"{own}}}]");
        let text = format!("{{\"working_distance_m\": 1, \"poses\": \"poses.json\", \"scans\": {scans}}}");
        let position = |scan: &SequenceScan| scan.world_from_camera.translation.vector.x;
        read(dir.path(), &text).map(|sequence| sequence.scans.iter().map(position).collect::<Vec<_>>())
    };
    for (names, clouds) in [
        (["b.ply", "a.ply"], ["a.ply", "b.ply"]),
        (["b", "a"], ["a.ply", "b.ply"]),
        (["b.png", "a.png"], ["a.ply", "b.ply"]),
        (["images/b.png", "images/a.png"], ["a.ply", "b.ply"]),
        (["10", "0"], ["00.ply", "10.ply"]),
        (["000010.png", "000000.png"], ["00.ply", "10.ply"]),
        (["r/00.png", "l/00.png"], ["l/00.ply", "r/00.ply"]),
        (["a.png", "a"], ["a.ply", "a.ply"]),
    ] {
        let found = positions(names, clouds, "").unwrap_or_else(|e| panic!("{names:?}: {e}"));
        let expected = if clouds[0] == clouds[1] { [2.0, 2.0] } else { [2.0, 1.0] };
        assert!(found.iter().zip(expected).all(|(x, y)| (x - y).abs() < 1e-9), "{names:?}: {found:?}");
    }
    let in_order = positions(["left", "right"], ["a.ply", "b.ply"], "").expect("no name fits");
    assert!((in_order[0] - 1.0).abs() < 1e-9 && (in_order[1] - 2.0).abs() < 1e-9, "{in_order:?}");
    let error = positions(["a.png", "c.png"], ["a.ply", "b.ply"], "").expect_err("one is missing").to_string();
    assert!(error.contains("poses.json") && error.contains("called like b.ply"), "{error}");
    let own = format!(", \"world_from_camera\": {}", pose(2.0));
    let found = positions(["c.png", "a.png"], ["a.ply", "b.ply"], &own).expect("it tells its own");
    assert!((found[0] - 2.0).abs() < 1e-9 && (found[1] - 3.0).abs() < 1e-9, "{found:?}");
}

#[test]
fn what_a_file_of_poses_says_of_the_images_counts() {
    let (dir, view, _) = folder();
    let m = view.world_from_camera_with_up(&Vector3::z()).inverse().to_homogeneous();
    let r: Vec<f64> = (0..9).map(|i| m[(i / 3, i % 3)]).collect();
    let t: Vec<f64> = (0..3).map(|k| 1000.0 * m[(k, 3)]).collect();
    let image = DepthImage { origin: [0, 0], size: [40, 30], depth: vec![1.0; 1200] };
    write_depth(&dir.path().join("tenths.png"), &image, 40, 30, 0.0001).expect("written");
    let k = "[200, 0, 19.5, 0, 200, 14.5, 0, 0, 1]";
    let camera = format!("{{\"cam_K\": {k}, \"depth_scale\": 0.1, \"cam_R_w2c\": {r:?}, \"cam_t_w2c\": {t:?}}}");
    fs::write(dir.path().join("bop.json"), format!("{{\"0\": {camera}, \"1\": {camera}}}")).expect("written");
    let text = |poses: &str, unit: &str, image: &str| {
        let scan = format!("{{\"cloud\": \"a.ply\", \"depth\": \"{image}\"}}");
        format!("{{\"working_distance_m\": 1, {unit}\"poses\": \"{poses}\", \"scans\": [{scan}, {scan}]}}")
    };
    let path = dir.path().join(SEQUENCE);
    fs::write(&path, text("bop.json", "", "tenths.png")).expect("written");
    let (sequence, notes) = read_with_notes(&path).expect("in tenths of a millimetre");
    assert_eq!(sequence.scans[0].image.as_ref().and_then(|(_, depth)| depth.at(3, 5)), Some(1.0));
    assert!(notes[0].contains("tenths.png: read in units of 0.0001 m"), "{notes:?}");
    fs::write(&path, text("bop.json", "\"depth_unit_m\": 0.001, ", "a.png")).expect("written");
    let (_, notes) = read_with_notes(&path).expect("in millimetres, as given");
    assert!(notes[0].contains("read in units of 0.001 m as depth_unit_m says"), "{notes:?}");

    let e: Vec<f64> = m.iter().copied().collect();
    let intrinsic = "{\"width\": 80, \"height\": 60, \"intrinsic_matrix\": [200, 0, 0, 0, 200, 0, 19.5, 14.5, 1]}";
    let camera = format!("{{\"extrinsic\": {e:?}, \"intrinsic\": {intrinsic}}}");
    fs::write(dir.path().join("o3d.json"), format!("{{\"parameters\": [{camera}, {camera}]}}")).expect("written");
    let error = read(dir.path(), &text("o3d.json", "", "a.png")).expect_err("of another size").to_string();
    assert!(error.contains("found 40 x 30 pixels in a.png, expected 80 x 60"), "{error}");
}

#[test]
fn a_cloud_in_an_unknown_unit_is_refused() {
    let (dir, ..) = folder();
    fs::write(dir.path().join("a.csv"), "x [px],y [px],z [px]\n1,2,3\n").expect("written");
    let error = read(
        dir.path(),
        &format!("{{\"working_distance_m\": 1, \"scans\": [{SCAN}, {}]}}", SCAN.replace("ply", "csv")),
    );
    let error = error.expect_err("how long?").to_string();
    assert!(error.contains("a.csv") && error.contains("found the unit \"px\""), "{error}");
}

#[test]
fn points_beyond_any_scene_are_dropped_and_counted() {
    let (dir, ..) = folder();
    fs::write(dir.path().join("wild.xyz"), "0 0 0.1\n0 0.1 0\n2e19 0 0\n").expect("written");
    fs::write(dir.path().join("survey.xyz"), "4e5 5.6e6 100\n").expect("written");
    let text =
        |cloud: &str| format!("{{\"working_distance_m\": 1, \"scans\": [{SCAN}, {}]}}", SCAN.replace("a.ply", cloud));
    let path = dir.path().join(SEQUENCE);
    fs::write(&path, text("wild.xyz")).expect("written");
    let (sequence, notes) = read_with_notes(&path).expect("good");
    assert_eq!(sequence.scans[1].points.len(), 2);
    assert!(notes.iter().any(|note| note.contains("wild.xyz: dropped 1 points farther away than 1e6 m")), "{notes:?}");
    let error = read(dir.path(), &text("survey.xyz")).expect_err("nothing is left").to_string();
    assert!(error.contains("survey.xyz") && error.contains("no point within 1e6 m"), "{error}");
}
