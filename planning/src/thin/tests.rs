use super::*;
use geometry::NeighborGrid;
use nalgebra::{Isometry3, Vector3};
use rand::RngExt;

fn random_sphere(count: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = rng::stream(seed, "test/sphere");
    let mut coordinate = || rng.random_range(-1.0..1.0f64);
    (0..count)
        .map(|_| {
            loop {
                let v = Vector3::new(coordinate(), coordinate(), coordinate());
                if v.norm() > 0.1 && v.norm() < 1.0 {
                    return Point3::from(v.normalize());
                }
            }
        })
        .collect()
}

#[test]
fn thinning_equals_the_quadratic_definition() {
    let points = random_sphere(1500, 1);
    for radius in [0.02, 0.1, 0.5] {
        let mut kept: Vec<usize> = Vec::new();
        for (i, p) in points.iter().enumerate() {
            if kept.iter().all(|&j| (points[j] - p).norm() >= radius) {
                kept.push(i);
            }
        }
        assert_eq!(thin(&points, radius), kept, "radius {radius}");
    }
}

#[test]
fn about_as_many_points_stay_as_asked_for() {
    for count in [1_001, 1_100, 2_000, 5_000, 30_000] {
        let points = random_sphere(count, 3);
        let kept = thin(&points, radius_for(&points, 1_000, spacing_of_all(&points, 1_000, 0), 0)).len();
        assert!((900..=1_100).contains(&kept), "{kept} of {count}");
    }
    // A lattice, where all neighbours are equally far: half of it goes at once.
    for side in [101, 104, 110, 130, 150, 200, 300] {
        let lattice: Vec<_> =
            (0..side * side).map(|i| Point3::new(f64::from(i % side), f64::from(i / side), 0.0) * 0.001).collect();
        let kept = thin_to(&lattice, radius_for(&lattice, 10_000, spacing_of_all(&lattice, 1_000, 0), 0), 10_000, 0);
        assert!((8_000..=11_000).contains(&kept.indices.len()), "{} of a lattice of {side}", kept.indices.len());
        assert!(kept.indices.is_sorted() && kept.duplicates == 0);
    }
    let twice: Vec<_> = random_sphere(700, 5).repeat(2);
    let kept = thin_to(&twice, radius_for(&twice, 1_000, spacing_of_all(&twice, 1_000, 0), 0), 1_000, 0);
    assert_eq!((kept.indices.len(), kept.duplicates), (700, 700), "given twice");
}

#[test]
fn thinning_moves_with_the_cloud_and_its_unit() {
    let points = random_sphere(3000, 2);
    let motion = Isometry3::new(Vector3::new(5.0, -3.0, 0.7), Vector3::new(0.3, 1.1, -0.4));
    let moved: Vec<_> = points.iter().map(|p| Point3::from((motion * p).coords * 1000.0)).collect();
    assert_eq!(thin(&points, 0.05), thin(&moved, 50.0), "the same points are kept");
    let (a, b) = (
        radius_for(&points, 500, spacing_of_all(&points, 1_000, 0), 7),
        radius_for(&moved, 500, spacing_of_all(&moved, 1_000, 0), 7),
    );
    assert!((b / a - 1000.0).abs() < 1e-6, "the radius scales: {a} {b}");
}

#[test]
fn the_radius_gives_about_the_number_asked_for() {
    let mut points = random_sphere(60_000, 3);
    for target in [500, 5_000, 10_000] {
        let count = thin(&points, radius_for(&points, target, spacing_of_all(&points, 1_000, 0), 0)).len();
        assert!((0.87..1.13).contains(&(count as f64 / target as f64)), "{count} for {target}");
    }
    points.extend_from_within(..);
    let count = thin(&points, radius_for(&points, 5_000, spacing_of_all(&points, 1_000, 0), 0)).len();
    assert!((4_500..5_500).contains(&count), "every point twice: {count}");
}

fn without_outliers(points: &[Point3<f64>], factor: f64) -> Vec<usize> {
    super::without_outliers(points, &NeighborGrid::new(points, 0.0).neighborhoods(points.len(), 30), factor)
}

#[test]
fn a_sparse_surface_beside_a_dense_one_stays() {
    let lattice = |side: u32, size: f64| {
        let at = move |i: u32| (f64::from(i) / f64::from(side - 1) - 0.5) * size;
        (0..side * side).map(move |i| {
            let (x, y) = (at(i % side), at(i / side));
            Point3::new(x, y, 0.1 + x * x + y * y)
        })
    };
    for (dense, size) in [(25, 0.02), (60, 0.02), (40, 0.01)] {
        let mut points: Vec<_> =
            lattice(20, 0.12).chain(lattice(dense, size).map(|p| p + Vector3::x() * 0.001)).collect();
        let surface = points.len();
        assert_eq!(without_outliers(&points, 6.0).len(), surface, "a patch of {dense} in a sheet of 20");
        // Scattered all about, alone, and in a few together.
        let mut rng = rng::stream(6, "test/stray");
        for _ in 0..40 {
            let mut at = || rng.random_range(0.3..2.0);
            points.push(Point3::new(at(), at(), at()));
        }
        points.extend((0..5).map(|i| Point3::new(-1.0, 0.001 * f64::from(i), -1.0)));
        let kept = without_outliers(&points, 6.0);
        let stray = kept.iter().filter(|&&i| i >= surface).count();
        assert!(kept.len() - stray == surface && stray <= 2, "{stray} of 45 stray points are left");
    }
}

#[test]
fn duplicates_and_outliers_go() {
    let mut points = random_sphere(500, 4);
    points.push(Point3::new(9.0, 0.0, 0.0));
    points.push(points[3]);
    assert_eq!(thin(&points, 0.0).len(), 501, "the duplicate goes");
    let kept = without_outliers(&points, 6.0);
    assert!(!kept.contains(&500), "the flying point goes");
    assert!(kept.len() >= 499, "the surface stays: {}", kept.len());
    assert_eq!(without_outliers(&points, 0.0).len(), points.len(), "0 keeps all");
}

#[test]
fn degenerate_clouds_survive() {
    assert!(thin(&[], 1.0).is_empty(), "no point");
    assert_eq!(thin(&[Point3::origin(); 9], 0.1), vec![0], "one place");
    assert_eq!(radius_for(&[Point3::origin(); 500], 100, 0.0, 0), 0.0, "one place has no spacing");
    assert_eq!(without_outliers(&[Point3::origin(); 20], 6.0).len(), 20, "no distance is far");
}
