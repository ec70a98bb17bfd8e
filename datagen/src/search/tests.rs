use super::*;
use crate::episode::{Episode, run_episode_with};
use crate::testing::{ball, ball_samples};
use geometry::rng::stream;

/// Share of `of` with a point of `near` closer than 2 mm, the slow way.
fn share(of: &[Point3<f64>], near: &[Point3<f64>]) -> f64 {
    let close = of.iter().filter(|p| near.iter().any(|q| (*p - q).norm() < 0.002)).count();
    close as f64 / of.len() as f64
}

/// An episode of three decisions whose scores are checked against brute force.
fn checked_episode(config: &EpisodeConfig) -> Episode {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let search = SearchConfig::of(config, CandidateConfig { num_targets: 4, ..CandidateConfig::default() });
    let mut planner = SearchPlanner::new(&scene, &samples, search.clone());
    let mut checked = 0;
    let episode =
        run_episode_with(&scene, &samples, &mut planner, config, &mut stream(1, "search"), |planner, decision| {
            let (state, found) = (decision.state, planner.last_decision());
            assert!((found.current_coverage - decision.current_coverage).abs() < 1e-12);
            assert_eq!(found.candidates.len(), found.scores.len());
            for (candidate, score) in found.candidates.iter().zip(&found.scores) {
                let pose = candidate.view.world_from_camera();
                let scan = scene.depth_image(&state.camera, &pose, &search.render).to_points(&state.camera, &pose);
                assert!((score.overlap.unwrap() - share(&scan, &state.cloud.points)).abs() < 1e-3);
                let mut all = state.cloud.points.clone();
                all.extend(scan);
                if search.accumulate == Accumulate::Matched {
                    let merged = PointCloud { points: all, normals: Vec::new() };
                    all = merged.voxel_downsample(state.grid_size, search.accumulate.voxel_origin()).points;
                }
                assert!((score.coverage - share(decision.reference, &all)).abs() < 1e-3);
                assert_eq!(*score, score_view(score.coverage, score.overlap, found.current_coverage));
                checked += 1;
            }
            let best = found.scores.iter().map(|s| s.score).fold(f64::NEG_INFINITY, f64::max);
            assert_eq!(decision.ranked[0].score, best);
        })
        .unwrap();
    assert_eq!(checked, 12);
    episode
}

#[test]
fn scores_equal_brute_force() {
    for config in [EpisodeConfig::default(), EpisodeConfig::paper()] {
        let episode = checked_episode(&EpisodeConfig { num_views: 3, ..config });
        assert_eq!(episode.views.len(), 4);
    }
}

#[test]
fn shifted_images_are_scored_by_their_mean() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let state = ScanState {
        cloud: PointCloud { points: samples[..samples.len() / 3].to_vec(), normals: Vec::new() },
        grid_size: 0.0023,
        tolerance: 0.002,
        num_scans: 1,
        ..ScanState::default()
    };
    let view = View { target: Point3::new(0.0, 0.0, 0.1), position: Point3::new(0.3, 0.2, 1.2) };
    let of = |shifted, cx: f64, cy: f64| {
        let mut state = state.clone();
        state.camera.cx += cx;
        state.camera.cy += cy;
        let (_, scores) = score_views(
            &scene,
            &samples,
            &state,
            &state.grid(),
            &[view],
            &SearchConfig { shifted, ..SearchConfig::default() },
        );
        (scores[0].coverage, scores[0].overlap.unwrap())
    };
    let parts = [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)].map(|(x, y)| of(false, x, y));
    let (coverage, overlap) = of(true, 0.0, 0.0);
    assert!((coverage - parts.iter().map(|p| p.0).sum::<f64>() / 4.0).abs() < 1e-12);
    assert!((overlap - parts.iter().map(|p| p.1).sum::<f64>() / 4.0).abs() < 1e-12);
    assert!(parts.iter().any(|p| p.0 != coverage), "the images differ: {parts:?}");
}

#[test]
fn degenerate_views_score_as_empty_scans() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let config = SearchConfig::default();
    let state = ScanState { grid_size: 0.0023, tolerance: 0.002, num_scans: 1, ..ScanState::default() };
    let nowhere = View { target: Point3::origin(), position: Point3::origin() };
    let (current, scores) = score_views(&scene, &samples, &state, &state.grid(), &[nowhere], &config);
    assert_eq!((current, scores[0].coverage, scores[0].overlap), (0.0, 0.0, None));
    let mut planner = SearchPlanner::new(&scene, &samples, config);
    let none = planner.rank_views(&state, &mut stream(2, "search"));
    assert_eq!(none, Err(PlanError::NoBoundary), "no cloud, no boundary, no view");
}
