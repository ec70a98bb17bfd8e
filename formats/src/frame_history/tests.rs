use super::*;

fn frame() -> Frame {
    let view = |i: usize| View { target: Point3::new(0.1, i as f64, 0.0), position: Point3::new(0.0, 0.0, 1.2) };
    Frame {
        cloud: PointCloud { points: vec![Point3::new(0.1, 0.2, 0.3); 5], normals: vec![Vector3::z(); 5] },
        current: view(1),
        next: view(2),
        candidates: (0..NUM_VIEWS).map(view).collect(),
        scores: (0..NUM_VIEWS).map(|i| i as f64 / 20.0).collect(),
    }
}

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bin");
    let frames = vec![frame(); 3];
    write_frame_history(&path, &frames).unwrap();
    assert_eq!(read_frame_history(&path).unwrap(), frames);
}

#[test]
fn a_frame_with_fewer_views_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bin");
    write_frame_history(&path, &vec![frame(); 3]).unwrap();
    let good = std::fs::read(&path).unwrap();
    let size = good.len() / 3;
    // Frame 1 with 19 views, as the authors' writer would write it: one view and one score are missing.
    let mut bad = good.clone();
    bad.drain(2 * size - 8..2 * size);
    bad.drain(2 * size - 8 - 19 * 8 - 48..2 * size - 8 - 19 * 8);
    let error = parse_frame_history(&path, &bad).expect_err("must be refused").to_string();
    assert!(error.contains("frame ") && error.contains("fewer than 20 views"), "{error}");
    let mut wide = good.clone();
    wide[size..size + 8].copy_from_slice(&1_000_000_000_000u64.to_le_bytes());
    let error = parse_frame_history(&path, &wide).expect_err("must be refused").to_string();
    assert!(error.contains("frame 1: found 1000000000000 points"), "{error}");
    let short = Frame { candidates: vec![], ..frame() };
    let error = write_frame_history(&path, &[frame(), short]).expect_err("must be refused").to_string();
    assert!(error.contains("frame 1"), "{error}");
}
