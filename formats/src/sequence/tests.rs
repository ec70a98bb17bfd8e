use super::*;
use crate::cloud::write_ply;
use crate::depth::write_depth;
use geometry::PointCloud;
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
