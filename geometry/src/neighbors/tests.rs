//! Tests of the neighbour grid against brute force.

use super::*;
use crate::rng::stream;
use proptest::prelude::*;
use rand::RngExt;

fn random_points(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = stream(seed, "neighbors");
    // A coarse lattice, so that ties and duplicates occur.
    (0..n).map(|_| Point3::from([0; 3].map(|_| f64::from(rng.random_range(-20..20i32)) * 0.004))).collect()
}

/// All keys by brute force, in the arithmetic of the grid.
fn brute_force(grid: &NeighborGrid, query: &Point3<f64>) -> Vec<u64> {
    let q = grid.query_point(query).unwrap();
    let mut keys: Vec<u64> = (0..grid.len()).map(|i| key(grid.distance2(q, i), grid.ids[i])).collect();
    keys.sort_unstable();
    keys
}

fn spacing(points: &[Point3<f64>]) -> f64 {
    mean_spacing(points, &Neighborhoods::of(points, 2))
}

#[test]
fn all_cores_find_the_same() {
    let mut points = random_points(1700, 5);
    points[3].y = f64::NAN;
    for k in [0, 1, 30] {
        let grid = NeighborGrid::new(&points, 0.0);
        let [one, all] = [grid.neighborhoods(1700, k), grid.neighborhoods_in_parallel(1700, k)];
        assert_eq!((one.k(), &one.ids, &one.distances2), (all.k(), &all.ids, &all.distances2));
    }
    assert!(NeighborGrid::default().neighborhoods_in_parallel(0, 30).is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn every_query_equals_brute_force(n in 1usize..300, k in 1usize..40, cell in 0.0f64..0.03, seed in 0u64..1000) {
        let points = random_points(n, seed);
        let grid = NeighborGrid::new(&points, cell);
        let queries = random_points(10, seed + 1).into_iter().chain([Point3::new(5.0, -3.0, 0.1)]);
        for query in queries {
            let expected: Vec<Neighbor> = brute_force(&grid, &query).into_iter().map(neighbor).collect();
            prop_assert_eq!(&grid.k_nearest(&query, k)[..], &expected[..k.min(n)]);
            prop_assert_eq!(grid.nearest(&query), Some(expected[0]));
            let radius = 0.013;
            let inside: Vec<Neighbor> =
                expected.iter().copied().filter(|n| n.distance2 < (radius * radius) as f32).collect();
            prop_assert_eq!(grid.any_within(&query, radius), !inside.is_empty());
            for n in &expected {
                prop_assert_eq!(grid.is_within(&query, &points[n.index], radius), inside.contains(n));
            }
            prop_assert_eq!(grid.within(&query, radius), inside);
        }
        let all = grid.neighborhoods(n, k);
        for (i, p) in points.iter().enumerate() {
            let expected: Vec<u32> = brute_force(&grid, p)[..k.min(n)].iter().map(|&k| k as u32).collect();
            prop_assert_eq!(all.ids(i), &expected[..]);
        }
    }
}

#[test]
fn non_finite_points_and_queries_are_ignored() {
    let nan = Point3::new(f64::NAN, 0.0, 0.0);
    let points = [nan, Point3::origin(), Point3::new(f64::INFINITY, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0)];
    let grid = NeighborGrid::new(&points, 0.1);
    assert_eq!(grid.len(), 2);
    assert!(grid.k_nearest(&nan, 3).is_empty() && grid.nearest(&nan).is_none() && !grid.any_within(&nan, 1.0));
    let all = grid.neighborhoods(points.len(), 5);
    assert_eq!(all.k(), 2);
    assert_eq!(all.ids(0), [u32::MAX; 2]);
    assert_eq!(all.ids(1), [1, 3]);
    assert!((spacing(&points) - 1.0).abs() < 1e-12);
    assert_eq!(spacing(&[nan]), 0.0);
    assert!(NeighborGrid::new(&[], 0.1).nearest(&Point3::origin()).is_none());
    assert_eq!(NeighborGrid::new(&[], 0.1).neighborhoods(0, 30).mean_distance(), 0.0);
}

#[test]
fn points_too_far_for_squares_of_distances_are_ignored_and_nothing_waits_for_them() {
    let at = |x: f64| Point3::new(x, 0.0, 0.0);
    let points: Vec<_> = [0.0, 2e19, 1.0, -1e39, f64::MAX].map(at).to_vec();
    let grid = NeighborGrid::new(&points, 0.1);
    assert_eq!(grid.len(), 2);
    assert_eq!(grid.neighborhoods(points.len(), 5).ids(0), [0, 2]);
    assert!((spacing(&points) - 1.0).abs() < 1e-12);
    // The square of its distance overflows.
    let found: Vec<_> = grid.k_nearest(&at(1e30), 5).iter().map(|n| n.index).collect();
    assert_eq!(found, [0, 2]);
    assert!(NeighborGrid::new(&[at(1e39)], 0.1).k_nearest(&at(0.0), 1).is_empty());
}

#[test]
fn degenerate_and_far_flung_clouds_stay_exact_and_small() {
    let same = vec![Point3::new(1.0, 2.0, 3.0); 50];
    assert_eq!(NeighborGrid::new(&same, 0.0).neighborhoods(50, 30).ids(40), (0..30).collect::<Vec<u32>>());
    assert_eq!(spacing(&same), 0.0);
    // Survey coordinates with an outlier a thousand kilometres away.
    let mut far: Vec<_> = random_points(3000, 3).iter().map(|p| p + nalgebra::Vector3::new(5.6e6, -2e5, 1e3)).collect();
    far.push(Point3::new(6.6e6, 0.0, 0.0));
    let grid = NeighborGrid::new(&far, 0.004);
    assert!(grid.starts.len() as f64 <= MAX_CELLS + 1.0);
    for i in [0, 10, 3000] {
        let expected: Vec<Neighbor> = brute_force(&grid, &far[i]).into_iter().map(neighbor).take(5).collect();
        assert_eq!(grid.k_nearest(&far[i], 5), expected);
    }
}

#[test]
fn spacing_of_a_lattice_is_its_pitch() {
    let points: Vec<_> =
        (0..400).map(|i| Point3::new(f64::from(i % 20) * 0.01, f64::from(i / 20) * 0.01, 0.3)).collect();
    assert!((spacing(&points) - 0.01).abs() < 1e-9);
}

#[test]
fn kept_neighborhoods_equal_those_found_anew() {
    let mut rng = stream(7, "growing");
    let mut points = random_points(400, 4);
    points.sort_by_key(|p| [p.x, p.y, p.z].map(f64::to_bits));
    points.dedup();
    let mut growing = GrowingNeighborhoods::default();
    for step in 0..60 {
        match step % 6 {
            // A small scan in a corner: appended, or in between.
            0 | 1 => {
                for p in random_points(20, 100 + step) {
                    let at = if step % 6 == 0 { points.len() } else { rng.random_range(0..=points.len()) };
                    points.insert(at, Point3::from(0.2 * p.coords.add_scalar(0.3)));
                }
            }
            2 => points[..15].iter_mut().for_each(|p| p.x += 1e-3),
            3 => drop(points.drain(30..33)),
            4 => points.swap(20, 70),
            _ => {}
        }
        if step == 31 {
            points[50].y = f64::NAN;
        }
        if step == 59 {
            points.truncate(12);
        }
        let k = if step % 24 < 20 { 30 } else { 5 };
        let grid = NeighborGrid::new(&points, 0.009);
        let expected = grid.neighborhoods(points.len(), k);
        let found = growing.update(&grid, &points, k);
        assert_eq!(found.len(), points.len());
        for i in 0..points.len() {
            assert_eq!((found.ids(i), found.distances2(i)), (expected.ids(i), expected.distances2(i)), "step {step}");
        }
        assert_eq!(found.mean_distance(), expected.mean_distance());
    }
}
