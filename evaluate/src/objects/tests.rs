use super::*;

/// A cube of this edge about the origin, its faces outwards.
fn cube(edge: f64) -> Mesh {
    let vertex = |i: usize| Point3::from([0, 1, 2].map(|k| edge * ((i >> k & 1) as f64 - 0.5)));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { vertices: (0..8).map(vertex).collect(), triangles }
}

#[test]
fn faces_that_no_camera_sees_are_left_out_of_the_reference_if_asked_for() {
    // A cube in a cube: a fifth of the surface is inside.
    let (outer, inner) = (cube(1.0), cube(0.5));
    let vertices = outer.vertices.iter().chain(&inner.vertices).copied().collect();
    let inside = inner.triangles.iter().map(|t| t.map(|i| i + 8));
    let mesh = Mesh { vertices, triangles: outer.triangles.iter().copied().chain(inside).collect() };
    let shares = [0, 100].map(|reference_views| {
        let config = EvaluateConfig { reference_views, surface_samples: 2_000, ..EvaluateConfig::default() };
        let object = prepare("cubes", None, &mesh, &config).expect("a surface");
        let object = object.mesh().expect("a mesh");
        let low = object.scene.mesh().bounding_box().0;
        let is_inside = |p: &&Point3<f64>| (0..3).all(|k| p[k].abs() < 0.9 * low[k].abs());
        (object.samples.iter().filter(is_inside).count(), object.samples.len())
    });
    assert!(shares[0].0 > 300, "they count as published: {shares:?}");
    assert_eq!(shares[1].0, 0, "no view sees them: {shares:?}");
    assert!(shares[1].1 * 100 > (shares[0].1 - shares[0].0) * 98, "what is outside stays: {shares:?}");
}
