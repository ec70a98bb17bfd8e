use super::*;
use crate::{DepthImage, PastScan, PinholeCamera, PointCloud, View, rng};

/// A ball of 8 cm seen from +z, by its analytic depth image.
fn ball(misses: Misses) -> ScanState {
    let camera = PinholeCamera::default();
    let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.2) };
    let pose = view.world_from_camera();
    let (origin, size) = ([600, 320], [80, 80]);
    let depth = (0..6400u32)
        .map(|i| {
            let d = camera.unproject(f64::from(600 + i % 80), f64::from(320 + i / 80), 1.0).coords;
            let (a, b, c) = (d.norm_squared(), -1.2 * d.z, 1.44 - 0.0064);
            let disc = b * b - a * c;
            if disc < 0.0 { 0.0 } else { ((-b - disc.sqrt()) / a) as f32 }
        })
        .collect();
    let depth = DepthImage { origin, size, depth };
    let points = depth.to_points(&camera, &pose);
    let cloud = PointCloud { normals: points.iter().map(|p| p.coords.normalize()).collect(), points };
    let scan = PastScan { world_from_camera: pose, seen: Seen::Depth { camera, depth, misses } };
    ScanState {
        cloud,
        scans: vec![scan],
        num_scans: 1,
        grid_size: 0.0023,
        working_distance: 1.2,
        tolerance: 0.002,
        camera,
    }
}

#[test]
fn the_other_side_of_a_ball_is_expected_and_chosen() {
    for misses in [Misses::Free, Misses::Unknown] {
        let state = ball(misses);
        let mut planner = VolumetricPlanner::new(VolumetricConfig { gain_only: true, ..Default::default() });
        let ranked = planner.rank_views(&state, &mut rng::stream(1, "planner"));
        assert!(ranked.len() > 30, "{}", ranked.len());
        assert!(ranked.windows(2).all(|r| r[0].score >= r[1].score));
        // The most new surface is seen from the side or from behind, not from where the first camera stood.
        assert!(ranked[0].view.direction().z < 0.5, "{misses:?}: {:?}", ranked[0]);
        assert!(ranked[0].gain.unwrap() > 0.1, "{misses:?}: {:?}", ranked[0]);
        let again = VolumetricPlanner::new(VolumetricConfig { gain_only: true, ..Default::default() })
            .rank_views(&state, &mut rng::stream(1, "planner"));
        assert_eq!(ranked, again);
    }
}

/// The grid after the state's scans, ready to be looked through.
fn prepared(state: &ScanState) -> VoxelGrid {
    let mut grid = VolumetricPlanner::default().carved_grid(state);
    let near = NeighborGrid::new(&state.cloud.points, 0.0).neighborhoods(state.cloud.len(), 30);
    grid.set_cloud(&state.cloud);
    grid.estimate_covered(&state.cloud, &near, state.tolerance);
    grid.relax();
    grid
}

fn from_z(z: f64) -> View {
    View { target: Point3::origin(), position: Point3::new(0.0, 0.0, z) }
}

#[test]
fn a_view_from_the_same_place_overlaps_wholly() {
    let state = ball(Misses::Free);
    let grid = prepared(&state);
    let leaps = Leaps::new(&grid);
    let same = leaps.forecast(&state.camera, &from_z(1.2), 2);
    let behind = leaps.forecast(&state.camera, &from_z(-1.2), 2);
    assert!(same.overlap().unwrap() > 0.9, "{same:?}");
    assert!(behind.overlap().unwrap() < 0.2 && behind.expected > 500.0, "{behind:?}");
}

#[test]
fn without_cameras_there_is_no_view() {
    let mut state = ball(Misses::Free);
    state.scans.clear();
    assert!(VolumetricPlanner::default().rank_views(&state, &mut rng::stream(1, "planner")).is_empty());
}
