//! Coverage, overlap, and the score that weighs them (docs/method.md, 'Setting' and 'Score').

use crate::PointCloud;
use crate::neighbors::NeighborGrid;
use nalgebra::Point3;

/// What a candidate view brings.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ViewScore {
    /// Coverage after adding the scan, in [0, 1].
    pub coverage: f64,
    /// Overlap of the scan with the cloud before it; `None` if the scan is empty.
    pub overlap: Option<f64>,
    /// W C + (1 - W) OR(O).
    pub score: f64,
}

/// Share of the surface points that have a cloud point strictly closer than `tolerance` metres; 0 for an empty
/// surface.
pub fn coverage(cloud: &[Point3<f64>], surface: &[Point3<f64>], tolerance: f64) -> f64 {
    share_within(surface, &NeighborGrid::new(cloud, 2.0 * tolerance), tolerance).unwrap_or(0.0)
}

/// Share of the scan's points that have a point of the cloud strictly closer than `tolerance` metres; `None` for an
/// empty scan.
pub fn overlap(scan: &[Point3<f64>], cloud: &[Point3<f64>], tolerance: f64) -> Option<f64> {
    share_within(scan, &NeighborGrid::new(cloud, 2.0 * tolerance), tolerance)
}

/// Share of the points that have a point of the grid strictly closer than `tolerance` metres; `None` without points.
pub fn share_within(points: &[Point3<f64>], grid: &NeighborGrid, tolerance: f64) -> Option<f64> {
    let close = points.iter().filter(|p| grid.any_within(p, tolerance)).count();
    (!points.is_empty()).then(|| close as f64 / points.len() as f64)
}

/// The surface points that have a cloud point strictly closer than `tolerance` metres, in their order, each with the
/// normal of the nearest cloud point: what the published code keeps as its accumulated cloud (docs/method.md,
/// 'Setting').
pub fn matched_surface(cloud: &PointCloud, surface: &[Point3<f64>], tolerance: f64) -> PointCloud {
    let grid = NeighborGrid::new(&cloud.points, 2.0 * tolerance);
    let mut matched = PointCloud::default();
    for p in surface {
        if let Some(nearest) = grid.nearest_within(p, tolerance) {
            matched.points.push(*p);
            if cloud.has_normals() {
                matched.normals.push(cloud.normals[nearest.index]);
            }
        }
    }
    matched
}

/// OR(O): rewards an overlap between 0.4 and 0.5 with 1, falls to 0 at 0 and at 1.
pub fn overlap_response(overlap: f64) -> f64 {
    if overlap < 0.4 {
        -6.25 * overlap * overlap + 5.0 * overlap
    } else if overlap <= 0.5 {
        1.0
    } else {
        -4.0 * overlap * overlap + 4.0 * overlap
    }
}

/// W: weight of coverage against overlap, from the coverage before the scan.
pub fn coverage_weight(current_coverage: f64) -> f64 {
    1.0 / (1.0 + (-10.0 * (current_coverage - 0.5)).exp())
}

/// s = W C + (1 - W) OR(O) with W from the coverage before the scan. An empty scan (`None`) has no overlap: OR = 0.
pub fn score_view(coverage: f64, overlap: Option<f64>, current_coverage: f64) -> ViewScore {
    let weight = coverage_weight(current_coverage);
    let response = overlap.map_or(0.0, overlap_response);
    ViewScore { coverage, overlap, score: weight * coverage + (1.0 - weight) * response }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VoxelOrigin;
    use crate::golden::Golden;

    #[test]
    fn response_is_one_on_the_plateau_and_zero_at_the_ends() {
        for (o, expected) in [(0.0, 0.0), (0.2, 0.75), (0.4, 1.0), (0.45, 1.0), (0.5, 1.0), (0.75, 0.75), (1.0, 0.0)] {
            assert!((overlap_response(o) - expected).abs() < 1e-12, "OR({o})");
        }
        assert_eq!(coverage_weight(0.5), 0.5);
        assert_eq!(score_view(0.3, None, 0.5).score, 0.15);
    }

    #[test]
    fn coverage_counts_strictly_closer_points() {
        let cloud = [Point3::origin()];
        let surface = [Point3::new(0.0019, 0.0, 0.0), Point3::new(0.0021, 0.0, 0.0), Point3::new(f64::NAN, 0.0, 0.0)];
        assert!((coverage(&cloud, &surface, 0.002) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(coverage(&cloud, &[], 0.002), 0.0);
        assert_eq!(coverage(&[], &surface, 0.002), 0.0);
        assert_eq!(overlap(&[], &cloud, 0.002), None);
        assert_eq!(overlap(&cloud, &[], 0.002), Some(0.0));
    }

    fn scores_equal(golden: &Golden, rows: usize) {
        let [c, o, now, score] = ["coverage", "overlap", "current_coverage", "score"].map(|name| golden.f64(name));
        assert_eq!(score.len(), rows);
        for i in 0..score.len() {
            let ours = score_view(c[i], Some(o[i]), now[i]).score;
            assert!((ours - score[i]).abs() < 1e-9, "row {i}: {ours} against {}", score[i]);
        }
    }

    #[test]
    fn scores_equal_the_definition() {
        scores_equal(&Golden::open("scores.safetensors"), 443);
    }

    #[test]
    fn bonus_scores_equal_the_published_ones() {
        Golden::bonus("d_score.safetensors").into_iter().for_each(|golden| scores_equal(&golden, 1720));
    }

    #[test]
    fn coverage_overlap_and_matches_equal_those_of_open3d() {
        let golden = Golden::open("scans.safetensors");
        for object in ["sphere", "torus"] {
            let name = |field: &str| format!("{object}.{field}");
            let (existing, scan) = (golden.cloud(&name("existing")), golden.cloud(&name("scan")));
            let mut merged = existing.clone();
            merged.merge(&scan);
            merged = merged.voxel_downsample(golden.f64(&name("grid_size"))[0], VoxelOrigin::CloudMinimum);
            let surface = golden.points(&name("model"));
            assert_eq!(coverage(&merged.points, &surface, 0.002), golden.f64(&name("coverage"))[0], "{object}");
            assert_eq!(overlap(&scan.points, &existing.points, 0.002), Some(golden.f64(&name("overlap"))[0]));
            let matched = matched_surface(&merged, &surface, 0.002);
            let expected: Vec<_> = golden.indices(&name("matched")).into_iter().map(|i| surface[i]).collect();
            assert_eq!(matched.points, expected, "{object}");
            let normals = golden.cloud(&name("merged")).normals;
            let expected = golden.indices(&name("matched_to")).into_iter().map(|i| normals[i]);
            for (ours, expected) in matched.normals.iter().zip(expected) {
                assert!((ours - expected).norm() < 1e-6, "{object}: normal {ours} for {expected}");
            }
        }
    }

    #[test]
    fn bonus_merged_cloud_coverage_and_overlap_equal_the_published_ones() {
        let Some(golden) = Golden::bonus("f_metrics.safetensors") else { return };
        for object in ["bunny", "teapot"] {
            let name = |field: &str| format!("{object}.{field}");
            let surface = golden.points(&name("model_points_60k_voxelised"));
            let merged = golden.cloud(&name("merged_voxelised"));
            let (existing, scan) = (golden.cloud(&name("existing")), golden.cloud(&name("scan")));
            assert_eq!(coverage(&merged.points, &surface, 0.002), golden.f64(&name("coverage"))[0]);
            assert_eq!(overlap(&scan.points, &existing.points, 0.002), Some(golden.f64(&name("overlap"))[0]));
            let (matched, expected) = (matched_surface(&merged, &surface, 0.002), golden.cloud(&name("matched")));
            assert_eq!(matched, expected, "{object}: matched surface");
        }
    }
}
