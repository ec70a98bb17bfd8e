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
