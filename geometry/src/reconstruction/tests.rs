use super::*;
use crate::{Neighborhoods, mean_spacing, rng::stream};
use rand::RngExt;
use std::collections::HashMap;

/// Points on a ball of 0.1 m with outward normals, kept where `keep` says so.
fn ball(count: usize, keep: impl Fn(&Vector3<f64>) -> bool) -> PointCloud {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let normals: Vec<Vector3<f64>> = (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * (golden * i as f64).cos(), r * (golden * i as f64).sin(), z)
        })
        .filter(keep)
        .collect();
    PointCloud { points: normals.iter().map(|n| Point3::from(0.1 * n)).collect(), normals }
}

/// How often each edge is used in one direction less the other, and how often at all.
fn edges(mesh: &Mesh) -> HashMap<[u32; 2], (i32, usize)> {
    let mut edges = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let (turn, times) = edges.entry([from.min(to), from.max(to)]).or_insert((0, 0));
            *turn += if from < to { 1 } else { -1 };
            *times += 1;
        }
    }
    edges
}

/// Signed: positive where triangles face outwards.
fn volume(mesh: &Mesh) -> f64 {
    let of = |&t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(t).map(|p| p.coords);
        a.dot(&b.cross(&c)) / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

#[test]
fn a_ball_is_closed_and_has_its_volume_area_and_radius() {
    let cloud = ball(4000, |_| true);
    let spacing = mean_spacing(&cloud.points, &Neighborhoods::of(&cloud.points, 2));
    let made = reconstruct(&cloud, spacing);
    let edges = edges(&made.mesh);
    assert!(edges.values().all(|e| *e == (0, 2)), "closed, and every triangle faces the same side");
    assert!(made.rim.iter().all(|rim| !rim));
    let (v, e, f) = (made.mesh.vertices.len() as i64, edges.len() as i64, made.mesh.triangles.len() as i64);
    assert_eq!(v - e + f, 2, "one ball (Euler)");
    let of = std::f64::consts::PI * 1e-3;
    assert!((volume(&made.mesh) / (4.0 / 3.0 * of) - 1.0).abs() < 0.01, "{}", volume(&made.mesh) / (4.0 / 3.0 * of));
    assert!((made.mesh.area() / (40.0 * of) - 1.0).abs() < 0.01, "{}", made.mesh.area() / (40.0 * of));
    for (vertex, normal) in made.mesh.vertices.iter().zip(&made.normals) {
        // Averaged planes lie outside of a ball by the mean square of the weighted distance over its diameter.
        let bias = (SUPPORT * spacing).powi(2) / 6.0 / 0.2;
        assert!((vertex.coords.norm() - 0.1).abs() < 2.0 * bias && bias < 3e-4, "{vertex} {bias}");
        assert!(normal.dot(&vertex.coords.normalize()) > 0.995);
    }
}

#[test]
fn where_nothing_was_measured_the_surface_ends() {
    let cloud = ball(4000, |n| n.z < 0.6);
    let spacing = mean_spacing(&cloud.points, &Neighborhoods::of(&cloud.points, 2));
    let made = reconstruct(&cloud, spacing);
    let rim: Vec<f64> = made.mesh.vertices.iter().zip(&made.rim).filter(|(_, r)| **r).map(|(v, _)| v.z).collect();
    assert!(rim.len() > 50);
    assert!(rim.iter().all(|z| (z - 0.06).abs() < 2.0 * spacing), "{rim:?}");
    assert!(
        edges(&made.mesh).values().all(|(turn, times)| (*turn, *times) == (0, 2) || (turn.abs(), *times) == (1, 1))
    );
    let share = made.mesh.area() / (0.8 * 4.0 * std::f64::consts::PI * 0.01);
    assert!((share - 1.0).abs() < 0.03, "{share}");
}

#[test]
fn both_sides_of_a_thin_plate_stay_apart_and_edges_of_a_box_close() {
    // A plate of 100 x 100 x 6 mm, its points 2 mm apart, with noise along the normals.
    let mut rng = stream(1, "plate");
    let mut cloud = PointCloud::default();
    let size = [0.1, 0.1, 0.006];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let steps = [u, v].map(|k| (size[k] / 0.002) as usize);
        for (i, j, side) in (0..steps[0]).flat_map(|i| (0..steps[1]).flat_map(move |j| [(i, j, 0.0), (i, j, 1.0)])) {
            let (mut p, mut n) = (Point3::origin(), Vector3::zeros());
            (p[u], p[v]) = ((i as f64 + 0.5) * 0.002, (j as f64 + 0.5) * 0.002);
            n[axis] = 2.0 * side - 1.0;
            p[axis] = side * size[axis] + rng.random_range(-1e-4..1e-4);
            cloud.points.push(p);
            cloud.normals.push(n);
        }
    }
    let made = reconstruct(&cloud, 0.002);
    assert!(edges(&made.mesh).values().all(|e| *e == (0, 2)), "closed");
    let share = volume(&made.mesh) / size.iter().product::<f64>();
    assert!((share - 1.0).abs() < 0.08, "volume {share}");
}

#[test]
fn what_has_no_surface_has_no_mesh() {
    let of = |points: Vec<[f64; 3]>, spacing: f64| {
        let cloud = PointCloud {
            normals: vec![Vector3::z(); points.len()],
            points: points.into_iter().map(Point3::from).collect(),
        };
        reconstruct(&cloud, spacing)
    };
    assert_eq!(of(vec![], 0.1), Reconstruction::default());
    assert_eq!(of(vec![[0.0; 3]], 0.1), Reconstruction::default());
    assert_eq!(of(vec![[0.0; 3]; 9], 0.0), Reconstruction::default());
    assert_eq!(of(vec![[0.0; 3], [1e30, 0.0, 0.0]], 1e-3), Reconstruction::default());
    assert!(of(vec![[0.0; 3], [f64::NAN; 3], [1.0, 0.0, 0.0]], 0.1).mesh.triangles.is_empty());
    let bare = PointCloud { points: vec![Point3::origin(); 4], normals: vec![] };
    assert_eq!(reconstruct(&bare, 0.1), Reconstruction::default());
}
