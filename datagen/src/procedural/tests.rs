use super::*;

/// Number of handles of a closed surface of one piece, by Euler's formula.
fn genus(mesh: &Mesh) -> i64 {
    let edges = mesh.triangles.len() as i64 * 3 / 2;
    1 - (mesh.vertices.len() as i64 - edges + mesh.triangles.len() as i64) / 2
}

/// Share of the bounding box that is empty.
fn emptiness(mesh: &Mesh) -> f64 {
    let (low, high) = mesh.bounding_box();
    1.0 - volume(mesh) / (high - low).iter().product::<f64>()
}

#[test]
fn solids_are_closed_various_and_have_handles() {
    let time = std::time::Instant::now();
    let meshes: Vec<Mesh> = (0..24).map(|i| mesh(1, i)).collect();
    println!("{:.1} ms per object", time.elapsed().as_secs_f64() * 1e3 / 24.0);
    for (i, m) in meshes.iter().enumerate() {
        assert!(is_closed(m) && volume(m) > 0.0, "object {i}");
        assert!(m.vertices.iter().all(|v| v.coords.norm() < 1.7), "object {i}");
        let (low, high) = m.bounding_box();
        assert!((high - low).norm() > 0.7, "object {i}: {low} to {high}");
    }
    let with_handles = meshes.iter().filter(|m| genus(m) > 0).count();
    let hollow = meshes.iter().filter(|m| emptiness(m) > 0.6).count();
    let triangles: Vec<usize> = meshes.iter().map(|m| m.triangles.len()).collect();
    println!("{with_handles} of 24 with handles, {hollow} mostly empty, triangles {triangles:?}");
    assert!((6..23).contains(&with_handles), "{with_handles}");
    assert!(hollow > 12, "{hollow}");
}

#[test]
fn same_numbers_give_the_same_solid() {
    for index in [0, 7, 1 << 32] {
        assert_eq!(mesh(3, index), mesh(3, index));
    }
    assert_ne!(mesh(3, 0), mesh(4, 0));
    assert_ne!(mesh(3, 0), mesh(3, 1));
}

#[test]
fn broken_surfaces_are_refused() {
    let mut open = mesh(1, 0);
    open.triangles.pop();
    assert!(!is_closed(&open));
    let whole = mesh(1, 0);
    let mut twice = whole.clone();
    let n = twice.vertices.len() as u32;
    twice.vertices.extend(whole.vertices.iter().map(|v| v + nalgebra::Vector3::x()));
    twice.triangles.extend(whole.triangles.iter().map(|t| t.map(|i| i + n)));
    assert!(largest_component(&twice).is_none(), "half of it would be lost");
    assert!(mesh_of(Solid::sphere([0.0; 3], -1.0)).is_none(), "nothing there");
}
