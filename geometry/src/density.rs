//! Local density of a cloud at candidate targets (method, 'Network input and output').

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

    #[test]
    fn densities_equal_the_published_ones() {
        let Some(golden) = Golden::open("g_density.safetensors") else { return };
        for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
            let targets = golden.points_f32(&format!("{name}.targets"));
            for (cloud, expected) in [("points", "density"), ("padded4096", "density_padded4096")] {
                let points = golden.points_f32(&format!("{name}.{cloud}"));
                let ours = densities(&points, &targets, 30);
                let largest = ours.iter().copied().fold(0.0, f64::max);
                for (a, b) in ours.iter().zip(golden.f32(&format!("{name}.{expected}"))) {
                    assert!((a / largest - f64::from(b)).abs() < 1e-6, "{name}.{cloud}: {} against {b}", a / largest);
                }
            }
        }
    }

    #[test]
    fn an_empty_cloud_has_no_density() {
        assert_eq!(densities(&[], &[Point3::origin()], 30), [0.0]);
        assert_eq!(densities(&[Point3::origin()], &[Point3::origin()], 30), [1e6]);
    }
}
