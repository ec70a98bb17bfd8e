use super::*;

fn gather(points: &[[f64; 3]], size: Option<(usize, usize)>) -> CloudFile {
    let rows = points.iter().map(|p| (*p, Some([p[0], 0.0, 1.0])));
    CloudFile::gather(Path::new("a.xyz"), rows, size).unwrap()
}

#[test]
fn zeros_are_pixels_without_a_return() {
    let some = [[0.0; 3], [1.0, 0.0, 0.0], [-0.0, 0.0, 0.0], [0.0, 0.0, 2.0]];
    for size in [None, Some((2, 2))] {
        let file = gather(&some, size);
        assert_eq!((file.cloud.len(), file.dropped, file.notes.len()), (2, 2, 1), "{size:?}");
        assert_eq!(file.cloud.normals[0].x, 1.0, "normals go with their points");
    }
    assert_eq!(gather(&some, Some((2, 2))).grid.unwrap().pixels, [1, 3]);
    let corner = gather(&some[..2], None);
    assert_eq!((corner.cloud.len(), corner.notes.len()), (2, 0), "one point at the origin is a point");
}

#[test]
fn normals_are_unit_vectors_that_differ() {
    let is = |columns: &[[f64; 3]]| are_normals(columns.iter());
    let x = [1.0, 0.0, 0.0];
    assert!(is(&[x, [0.0, 0.6, 0.8]]) && is(&[x, [0.0; 3], [0.0, 0.99, 0.0], [f64::NAN; 3]]));
    assert!(!is(&[x, x]) && !is(&[x, [0.2, 0.5, 0.1]]) && !is(&[x, [0.0; 3], [0.0; 3]]) && !is(&[[255.0, 0.0, 0.0]]));
}

#[test]
fn missing_normals_are_zero() {
    let rows = [([1.0; 3], Some([0.0, 0.0, 1.0])), ([2.0; 3], Some([f64::NAN; 3])), ([3.0; 3], Some([0.0; 3]))];
    let cloud = CloudFile::gather(Path::new("a.ply"), rows.into_iter(), None).unwrap().cloud;
    assert_eq!(cloud.normals, [Vector3::z(), Vector3::zeros(), Vector3::zeros()]);
    let cloud = CloudFile::gather(Path::new("a.ply"), rows[1..].iter().copied(), None).unwrap().cloud;
    assert!(!cloud.has_normals(), "none at all");
}
