//! Figures of merit of an episode (docs/method.md, 'Metrics').

use crate::neighbors::NeighborGrid;
use nalgebra::Point3;

/// Distances between two clouds, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SurfaceDistances {
    /// Half the sum of the two mean nearest-neighbour distances.
    pub chamfer: f64,
    /// The larger of the two largest nearest-neighbour distances.
    pub hausdorff: f64,
}

/// Chamfer and Hausdorff distance between two clouds. Both infinite if exactly one of them is empty, 0 if both are.
pub fn surface_distances(a: &[Point3<f64>], b: &[Point3<f64>]) -> SurfaceDistances {
    let (a_mean, a_max) = directed_distances(a, b);
    let (b_mean, b_max) = directed_distances(b, a);
    SurfaceDistances { chamfer: 0.5 * (a_mean + b_mean), hausdorff: a_max.max(b_max) }
}

/// Mean and maximum of the distances from each point of `from` to the nearest of `to`.
fn directed_distances(from: &[Point3<f64>], to: &[Point3<f64>]) -> (f64, f64) {
    let grid = NeighborGrid::new(to, 0.0);
    let (mut sum, mut largest, mut count) = (0.0, 0f64, 0usize);
    for p in from.iter().filter(|p| p.iter().all(|x| x.is_finite())) {
        // Found in f32, measured in f64.
        let distance = grid.nearest(p).map_or(f64::INFINITY, |n| (to[n.index] - p).norm());
        sum += distance;
        largest = largest.max(distance);
        count += 1;
    }
    match (count, grid.is_empty()) {
        (0, true) => (0.0, 0.0),
        (0, false) => (f64::INFINITY, f64::INFINITY),
        _ => (sum / count as f64, largest),
    }
}

/// 100 x standard deviation (population) / mean of the overlaps that exist, in percent; `None` with fewer than two or if
/// their mean is 0. `cv3` is this of next views 1 to 3, `cv_all` of all.
pub fn overlap_variation(overlaps: &[Option<f64>]) -> Option<f64> {
    let known: Vec<f64> = overlaps.iter().copied().flatten().collect();
    let n = known.len() as f64;
    let mean = known.iter().sum::<f64>() / n;
    let variance = known.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / n;
    (known.len() > 1 && mean > 0.0).then(|| 100.0 * variance.sqrt() / mean)
}

/// Number of views, the first scan being view 1, until the coverage first reaches `level`; `coverages[0]` is that of
/// the first scan. `None` if it never does (a table counts that as 17, the `paper` preset as 16).
pub fn views_to(coverages: &[f64], level: f64) -> Option<usize> {
    coverages.iter().position(|&c| c >= level).map(|i| i + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Golden;

    #[test]
    fn distances_of_two_points_and_of_nothing() {
        let (a, b) = ([Point3::origin()], [Point3::new(3.0, 4.0, 0.0), Point3::new(0.0, 0.0, 1.0)]);
        let d = surface_distances(&a, &b);
        assert!((d.chamfer - 0.5 * (1.0 + 3.0)).abs() < 1e-12 && (d.hausdorff - 5.0).abs() < 1e-12, "{d:?}");
        assert_eq!(surface_distances(&a, &[]).hausdorff, f64::INFINITY);
        assert_eq!(surface_distances(&[], &[]), SurfaceDistances::default());
    }

    fn distances_equal(golden: &Golden, object: &str, a: &[Point3<f64>], b: &[Point3<f64>], pair: &str) {
        let ours = surface_distances(a, b);
        for (value, metric) in [(ours.chamfer, "cd"), (ours.hausdorff, "hd")] {
            let expected = golden.f64(&format!("{object}.{metric}_{pair}_m"))[0];
            assert!((value - expected).abs() < 1e-9, "{object} {metric} {pair}: {value} against {expected}");
        }
    }

    #[test]
    fn distances_equal_those_of_open3d() {
        let golden = Golden::open("scans.safetensors");
        for object in ["sphere", "torus"] {
            let name = |field: &str| format!("{object}.{field}");
            let model = golden.points(&name("model"));
            let matched: Vec<_> = golden.indices(&name("matched")).into_iter().map(|i| model[i]).collect();
            let [existing, scan] = ["existing", "scan"].map(|f| golden.cloud(&name(f)).points);
            distances_equal(&golden, object, &matched, &model, "matched_model");
            distances_equal(&golden, object, &scan, &existing, "scan_existing");
        }
    }

    #[test]
    fn bonus_distances_equal_the_published_ones() {
        let Some(golden) = Golden::bonus("f_metrics.safetensors") else { return };
        for object in ["bunny", "teapot"] {
            let name = |field: &str| format!("{object}.{field}");
            let model = golden.points(&name("model_points_60k_voxelised"));
            let [matched, existing, scan] = ["matched", "existing", "scan"].map(|f| golden.cloud(&name(f)).points);
            distances_equal(&golden, object, &matched, &model, "matched_model");
            distances_equal(&golden, object, &scan, &existing, "scan_existing");
        }
    }

    #[test]
    fn variation_and_views() {
        assert_eq!(overlap_variation(&[Some(0.4), None, Some(0.4)]), Some(0.0));
        assert!((overlap_variation(&[Some(0.2), Some(0.4)]).unwrap() - 100.0 / 3.0).abs() < 1e-9);
        for too_few in [&[None][..], &[Some(0.4)], &[None, Some(0.4), None]] {
            assert_eq!(overlap_variation(too_few), None, "one value does not vary");
        }
        assert_eq!(views_to(&[0.3, 0.8, 0.95], 0.9), Some(3));
        assert_eq!(views_to(&[0.3], 0.9), None);
    }
}
