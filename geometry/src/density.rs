//! Local density of a cloud at candidate targets (docs/method.md, 'Network input and output').

use crate::neighbors::NeighborGrid;
use nalgebra::Point3;

/// 1 / (mean distance to the `neighbors` nearest points + 1e-6) at each target, in 1/m; a target that is itself a
/// point of the cloud counts as one of them. 0 where the cloud is empty.
pub fn densities(points: &[Point3<f64>], targets: &[Point3<f64>], neighbors: usize) -> Vec<f64> {
    let grid = NeighborGrid::new(points, 0.0);
    targets
        .iter()
        .map(|target| {
            let near = grid.k_nearest(target, neighbors);
            let sum: f64 = near.iter().map(|n| f64::from(n.distance2).sqrt()).sum();
            density_from(sum, near.len())
        })
        .collect()
}

/// Density from the sum of the distances to `count` neighbours; 0 without any.
pub fn density_from(distance_sum: f64, count: usize) -> f64 {
    if count == 0 { 0.0 } else { 1.0 / (distance_sum / count as f64 + 1e-6) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Golden;

    fn densities_equal(points: &[Point3<f64>], targets: &[Point3<f64>], expected: &[f64]) {
        let ours = densities(points, targets, 30);
        assert_eq!(ours.len(), expected.len());
        let largest = ours.iter().copied().fold(0.0, f64::max);
        for (a, b) in ours.iter().zip(expected) {
            assert!((a / largest - b).abs() < 1e-6, "{} against {b}", a / largest);
        }
    }

    #[test]
    fn densities_equal_those_of_scipy() {
        let (clouds, golden) = (Golden::open("boundary.safetensors"), Golden::open("views.safetensors"));
        for name in ["sphere", "torus"] {
            let field = |f: &str| format!("{name}.{f}");
            let mut points = clouds.points(&field("points"));
            let chosen = golden.indices(&field("representative_index"));
            let order = golden.indices(&field("nearest_sort_order"));
            let targets: Vec<_> = order.into_iter().map(|i| points[chosen[i]]).collect();
            densities_equal(&points, &targets, &golden.f64(&field("density")));
            points.resize(4096, Point3::origin());
            densities_equal(&points, &targets, &golden.f64(&field("density_padded4096")));
        }
        let at = |z: f64| Point3::new(0.0, 0.0, z);
        let absolute = densities(&[at(0.0), at(0.1), at(0.3)], &[at(0.0)], 3)[0];
        assert!((absolute - 1.0 / (0.4 / 3.0 + 1e-6)).abs() < 1e-5, "{absolute}");
    }

    #[test]
    fn bonus_densities_equal_the_published_ones() {
        let Some(golden) = Golden::bonus("g_density.safetensors") else { return };
        for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
            let targets = golden.points(&format!("{name}.targets"));
            for (cloud, expected) in [("points", "density"), ("padded4096", "density_padded4096")] {
                let points = golden.points(&format!("{name}.{cloud}"));
                densities_equal(&points, &targets, &golden.f64(&format!("{name}.{expected}")));
            }
        }
    }

    #[test]
    fn an_empty_cloud_has_no_density() {
        assert_eq!(densities(&[], &[Point3::origin()], 30), [0.0]);
        assert_eq!(densities(&[Point3::origin()], &[Point3::origin()], 30), [1e6]);
    }
}
