use super::predict::{Forecast, bounded_stride};
use super::tiles::{TILE, Tiles};
use super::*;
use crate::{NoReturn, Seen, SensorConfig};
use geometry::{DepthImage, NeighborGrid, PointCloud, View, rng};

mod backs;
mod belief;
mod outlines_and_areas;

/// A ball of 8 cm seen from +z, by its analytic depth image.
fn ball(misses: NoReturn) -> ScanState {
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
    let seen = Seen::Depth { camera, depth, misses };
    let scan = PastScan { world_from_camera: pose, seen, pose: Default::default(), veil: None };
    ScanState {
        cloud,
        scans: vec![Arc::new(scan)],
        of_scan: Vec::new(),
        num_scans: 1,
        grid_size: 0.0023,
        working_distance: 1.2,
        tolerance: 0.002,
        reach: 0.002,
        camera,
        sensor: Default::default(),
        support: None,
        given_views: Default::default(),
        roll: Default::default(),
        near: Default::default(),
        budget: Default::default(),
    }
}

#[test]
fn the_other_side_of_a_ball_is_expected_and_chosen() {
    for misses in [NoReturn::Free, NoReturn::Unknown] {
        let state = ball(misses);
        let mut planner = VolumetricPlanner::new(VolumetricConfig { gain_only: true, ..Default::default() });
        let ranked = planner.rank_views(&state, &mut rng::stream(1, "planner")).expect("views");
        assert!(ranked.len() > 30, "{}", ranked.len());
        assert!(ranked.windows(2).all(|r| r[0].score >= r[1].score));
        // The most new surface is seen from the side or from behind, not from where the first camera stood.
        assert!(ranked[0].view.direction().z < 0.5, "{misses:?}: {:?}", ranked[0]);
        assert!(ranked[0].gain.unwrap() > 0.1, "{misses:?}: {:?}", ranked[0]);
        let again = VolumetricPlanner::new(VolumetricConfig { gain_only: true, ..Default::default() })
            .rank_views(&state, &mut rng::stream(1, "planner"))
            .expect("views");
        assert_eq!(ranked, again);
    }
}

/// The grid after the state's scans, ready to be looked through.
fn prepared(state: &ScanState) -> VoxelGrid {
    prepared_with_area(state).0
}

/// The same with the area of the measured surface.
fn prepared_with_area(state: &ScanState) -> (VoxelGrid, f64) {
    let mut grid = VolumetricPlanner::default().carved_grid(state);
    let near = NeighborGrid::new(&state.cloud.points, 0.0).neighborhoods(state.cloud.len(), 30);
    grid.set_cloud(&state.cloud);
    let known_m2 = grid.estimate_covered(&state.cloud, &near, state.tolerance);
    grid.relax();
    (grid, known_m2)
}

#[test]
fn voxels_are_as_wide_as_what_a_point_covers_and_rays_as_far_apart() {
    let mut state = ball(NoReturn::Free);
    state.grid_size = 0.0;
    let pixel = |distance: f64| PinholeCamera::default().pixel_size(distance);
    let mut expect = |distance: f64, tolerance: f64, voxel: f64, stride: u32| {
        (state.working_distance, state.tolerance) = (distance, tolerance);
        let grid = VolumetricPlanner::default().new_grid(&state);
        assert!((grid.voxel - voxel).abs() < 1e-12, "{} instead of {voxel} at {distance} m", grid.voxel);
        assert_eq!(ray_stride(&state.camera, distance, grid.voxel), stride, "at {distance} m");
    };
    expect(0.6, 0.002, 0.004, 3);
    expect(1.2, 0.002, 0.004, 2);
    expect(1.5, 0.002, 0.004, 1);
    expect(3.0, 0.002, 1.25 * pixel(3.0), 1);
    expect(1.2, 0.02, 3.5 * pixel(1.2), 4);
}

fn from_z(z: f64) -> View {
    View { target: Point3::origin(), position: Point3::new(0.0, 0.0, z) }
}

/// The grid of a cloud in the plane z = 0, and how far its covered shares are from the true ones on the mean.
fn error_of_covered(points: Vec<Point3<f64>>) -> f64 {
    let mut state = ball(NoReturn::Unknown);
    let tolerance = state.tolerance;
    state.cloud.normals = vec![Vector3::z(); points.len()];
    state.cloud.points = points;
    Arc::make_mut(&mut state.scans[0]).seen = Seen::Points(state.cloud.points.clone());
    let grid = prepared(&state);
    let within = NeighborGrid::new(&state.cloud.points, tolerance);
    let zero = grid.local(&Point3::origin());
    let mut errors = Vec::new();
    for s in &grid.surface {
        // The true share, by 256 places of the voxel.
        let low = Vector3::from(grid.coordinates(s.index).map(|c| c as f64)) - Vector3::from(zero).cast();
        let low = low * grid.voxel;
        let place = |k: usize| (k as f64 + 0.5) / 16.0 * grid.voxel;
        let places = (0..256).map(|k| Point3::new(low.x + place(k % 16), low.y + place(k / 16), 0.0));
        let covered = places.filter(|p| within.any_within(p, tolerance)).count() as f64 / 256.0;
        if low.x.abs().max(low.y.abs()) < 0.04 {
            errors.push(f64::from(s.covered) - covered);
        }
    }
    assert!(errors.len() > 200, "{}", errors.len());
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn the_covered_share_of_a_sparse_plane_is_that_of_its_discs() {
    let lattice = |pitch: f64, from: i32, to: i32| {
        (from..to)
            .flat_map(move |x| (-30..30).map(move |y| Point3::new(pitch * f64::from(x), pitch * f64::from(y), 0.0)))
    };
    let error = error_of_covered(lattice(0.0042, -30, 30).collect());
    assert!(error.abs() < 0.05, "discs that do not touch: {error}");
    // Stripes of many points between stripes of few: the many must not speak for the few.
    let mut rng = rng::stream(8, "stripes");
    let mut striped = Vec::new();
    for _ in 0..20_000 {
        let [x, y] = [(); 2].map(|()| rand::RngExt::random_range(&mut rng, -0.06..0.06));
        if (x / 0.002_f64).rem_euclid(5.0) < 1.0 || rand::RngExt::random_bool(&mut rng, 0.05) {
            striped.push(Point3::new(x, y, 0.0));
        }
    }
    let error = error_of_covered(striped);
    assert!(error.abs() < 0.05, "stripes: {error}");
}

#[test]
fn a_view_from_the_same_place_overlaps_wholly() {
    let state = ball(NoReturn::Free);
    let grid = prepared(&state);
    let leaps = Leaps::new(&grid, true);
    let marcher = Marcher::new(&grid, &leaps, &SensorConfig::default());
    let same = marcher.forecast(&state.camera, &from_z(1.2).world_from_camera(), 2, 0.002);
    let behind = marcher.forecast(&state.camera, &from_z(-1.2).world_from_camera(), 2, 0.002);
    // The expectation is cautious by a sixth.
    assert_eq!(predict::trust(0.004, 0.002), 0.83);
    assert!(same.overlap(0.83).unwrap() > 0.77, "{same:?}");
    assert!(behind.overlap(0.83).unwrap() < 0.2 && behind.expected > 500.0, "{behind:?}");
}

/// The same by looking at every step of every ray of the image part.
fn every_step(grid: &VoxelGrid, camera: &PinholeCamera, view: &View, stride: u32) -> Forecast {
    use super::grid::{FREE, HOLLOW, SOLID};
    let pose = view.world_from_camera();
    let eye = grid.local(&view.position);
    let mut sum = Forecast::default();
    for row in (0..camera.height).step_by(stride as usize) {
        for column in (0..camera.width).step_by(stride as usize) {
            let ray = pose * camera.unproject(f64::from(column), f64::from(row), 1.0) - view.position;
            let ray = ray.normalize().cast::<f32>();
            let mut hidden = false;
            for n in 0..1000 {
                let cell = [0, 1, 2].map(|k| eye[k] + ray[k] * n as f32 * 0.75);
                if !cell.iter().all(|&c| c >= 0.0 && c < grid.side as f32) {
                    continue;
                }
                let [x, y, z] = cell.map(|c| c as usize);
                let i = (z * grid.side + y) * grid.side + x;
                match grid.code[i] {
                    FREE => continue,
                    HOLLOW => hidden = true,
                    SOLID => {
                        (sum.expected, hidden) = (sum.expected + 1.0, true);
                        break;
                    }
                    _ => {
                        let s = grid.surface_at(i).unwrap();
                        if s.normal.iter().zip(ray.iter()).map(|(a, b)| a * b).sum::<f32>() < 0.0 {
                            *if hidden { &mut sum.known_behind } else { &mut sum.known } += 1.0;
                            sum.covered += f64::from(s.covered);
                        }
                        break;
                    }
                }
            }
            sum.hidden += f64::from(u8::from(hidden));
        }
    }
    sum
}

#[test]
fn leaps_and_tiles_change_nothing() {
    let state = ball(NoReturn::Free);
    let grid = prepared(&state);
    let leaps = Leaps::new(&grid, true);
    let marcher = Marcher::new(&grid, &leaps, &SensorConfig::default());
    let camera = PinholeCamera::from_fov_y(80, 60, 0.5);
    // From far, from the side, off the axis, and from among the voxels.
    for at in [[0.0, 0.0, 1.2], [1.0, 0.3, 0.1], [-0.4, 0.5, -0.6], [0.1, 0.1, 0.15], [0.02, -0.01, -0.12]] {
        let view = View { target: Point3::new(0.01, 0.02, 0.0), position: at.into() };
        // Of points that leave no gaps.
        let (fast, slow) =
            (marcher.forecast(&camera, &view.world_from_camera(), 1, 1.0), every_step(&grid, &camera, &view, 1));
        let pairs = [
            (fast.hidden, slow.hidden),
            (fast.expected, slow.expected),
            (fast.known, slow.known),
            (fast.known_behind, slow.known_behind),
            (fast.covered, slow.covered),
        ];
        assert!(slow.hidden + slow.known > 50.0, "{at:?} sees {slow:?}");
        // Rounding moves a sample across a face now and then.
        assert!(pairs.iter().all(|(a, b)| (a - b).abs() <= 2.0 + 0.002 * b), "{at:?}: {fast:?} {slow:?}");
    }
}

#[test]
fn where_misses_mean_nothing_the_same_stops_the_rays() {
    let state = ball(NoReturn::Unknown);
    let grid = prepared(&state);
    let leaps = [true, false].map(|carves| Leaps::new(&grid, carves));
    let [told, untold] = leaps.each_ref().map(|leaps| Marcher::new(&grid, leaps, &SensorConfig::default()));
    for at in [[0.0, 0.0, 1.2], [1.0, 0.3, 0.1], [-0.4, 0.5, -0.6]] {
        let view = View { target: Point3::new(0.01, 0.02, 0.0), position: at.into() };
        let [a, b] = [&told, &untold].map(|m| m.forecast(&state.camera, &view.world_from_camera(), 4, 0.002));
        let pairs = [(a.expected, b.expected), (a.known + a.known_behind, b.known_behind), (a.covered, b.covered)];
        assert!(a.expected + a.known > 500.0 && b.known == 0.0, "{at:?} sees {a:?}, {b:?}");
        assert!(pairs.iter().all(|(a, b)| (a - b).abs() <= 32.0 + 0.002 * b), "{at:?}: {a:?} {b:?}");
    }
}

#[test]
fn rays_carve_the_cube_wherever_they_end() {
    let unknown_after = |end: Option<[f64; 3]>| {
        let mut grid = VoxelGrid::new(&Point3::origin(), 0.1, 0.01);
        let seen = Seen::Points(end.into_iter().map(Point3::from).collect());
        let scan = PastScan { seen, ..(*ball(NoReturn::Free).scans[0]).clone() };
        grid.carve(&scan, NoReturn::Unknown);
        grid.unknown.len()
    };
    let carved = |end| unknown_after(None) - unknown_after(Some(end));
    assert_eq!(carved([0.005, 0.005, 0.005]), 10, "up to the point, which is surface");
    assert_eq!(carved([0.005, 0.005, -50.0]), 20, "through the whole cube");
    assert_eq!(carved([0.005, 0.005, 0.5]), 0, "in front of it");
    assert_eq!(carved([0.5, 0.005, 0.0]), 0, "beside it");
}

#[test]
fn the_membrane_is_that_of_relaxing_voxel_by_voxel() {
    use super::grid::{HOLLOW, SOLID};
    for misses in [NoReturn::Free, NoReturn::Unknown] {
        let state = ball(misses);
        let mut grid = VolumetricPlanner::default().carved_grid(&state);
        grid.set_cloud(&state.cloud);
        let s = grid.side;
        let hollow = |i: &usize| grid.code[*i] == HOLLOW;
        let colored =
            |c: usize| (0..s.pow(3)).filter(hollow).filter(move |i| (i % s + i / s % s + i / (s * s)) % 2 == c);
        let order: Vec<usize> = colored(0).chain(colored(1)).collect();
        let mut chi: Vec<f32> = (0..s.pow(3)).map(|i| grid.membrane.get(i)).collect();
        for _ in 0..40 {
            for &i in &order {
                let around = [i - 1, i + 1, i - s, i + s, i - s * s, i + s * s].map(|j| chi[j]);
                chi[i] += 1.8 * (around.iter().sum::<f32>() / 6.0 - chi[i]);
            }
        }
        grid.relax();
        let passed = grid.expected.len();
        let solid = order.iter().filter(|&&i| chi[i] > 0.5).count();
        let wrong = order.iter().filter(|&&i| (grid.code[i] == SOLID) != (chi[i] > 0.5)).count();
        let off = order.iter().map(|&i| (grid.membrane.get(i) - chi[i]).abs()).fold(0.0, f32::max);
        assert!(passed > 200 && solid > 2000, "{misses:?}: {solid} solid, the membrane passes {passed}");
        assert!(off < 0.02 && wrong * 500 < solid, "{misses:?}: up to {off} off, {wrong} of {solid} wrong");
    }
}

#[test]
fn without_cameras_there_is_no_view() {
    let mut state = ball(NoReturn::Free);
    state.scans.clear();
    let error = VolumetricPlanner::default().rank_views(&state, &mut rng::stream(1, "planner")).expect_err("none");
    assert!(!error.is_end() && error.to_string().contains("the cameras of 0 of 1 scans are known"), "{error}");
}

#[test]
fn novelty_is_the_angle_to_the_nearest_past_camera() {
    let state = ball(NoReturn::Free);
    let of = |position: [f64; 3]| novelty(&View { target: Point3::origin(), position: position.into() }, &state.scans);
    assert!(of([0.0, 0.0, 0.7]).abs() < 1e-9, "where the camera was");
    assert!((of([0.5, 0.0, 0.0]) - 0.5).abs() < 1e-9, "a quarter turn");
    assert!((of([0.0, 0.0, -1.2]) - 1.0).abs() < 1e-9, "behind");
}

#[test]
fn no_gain_exceeds_what_is_missing() {
    let state = ball(NoReturn::Free);
    let mut planner = VolumetricPlanner::new(VolumetricConfig::default());
    let ranked = planner.rank_views(&state, &mut rng::stream(1, "test")).expect("views");
    let missing = 1.0 - planner.surface().covered();
    assert!(ranked.iter().all(|r| (0.0..=1.0).contains(&r.score)), "a score is a share");
    assert!(!ranked.is_empty() && ranked.iter().all(|r| r.gain.is_some_and(|g| g <= missing)), "{missing}");
    let novel = |weight| {
        let config = VolumetricConfig { novelty: weight, ..Default::default() };
        VolumetricPlanner::new(config).rank_views(&state, &mut rng::stream(1, "test")).expect("views")[0].view
    };
    assert!(novel(10.0) != novel(0.0), "a large weight decides");
}

#[test]
fn a_scene_that_fills_the_image_is_sampled_coarser() {
    let state = ball(NoReturn::Free);
    let grid = prepared(&state);
    let leaps = Leaps::new(&grid, true);
    let marcher = Marcher::new(&grid, &leaps, &SensorConfig::default());
    // The ball from near, at two resolutions: the finer one is over the limit.
    let [coarse, fine] = [(320, 240), (1280, 960)].map(|(w, h)| {
        let camera = PinholeCamera::from_fov_y(w, h, 1.0);
        let f = marcher.forecast(&camera, &from_z(0.3).world_from_camera(), 1, 0.002);
        [f.hidden, f.known, f.covered].map(|n| n / f64::from(w * h))
    });
    for (a, b) in coarse.iter().zip(fine) {
        assert!(*a > 0.005 && (a - b).abs() < 0.05 * a, "{coarse:?} {fine:?}");
    }
}

#[test]
fn rays_of_a_view_are_bounded() {
    // An object of 0.2 m at 1.2 m shows in some 225 tiles, a full image of 1280 x 720 in 14,400.
    assert_eq!(bounded_stride(2, 225), 2, "few rays stay as asked");
    for stride in 1..=4 {
        let s = bounded_stride(stride, 14_400);
        assert!(s >= TILE || 14_400 * TILE.div_ceil(s).pow(2) <= 16_000, "{stride} becomes {s}");
    }
    assert_eq!(bounded_stride(16, 14_400), 16, "coarser than a tile is coarse enough");
}

#[test]
fn every_tile_shows_a_block_around_the_eye() {
    let camera = PinholeCamera::from_fov_y(160, 120, 0.5);
    let tiles = |blocks: &[[usize; 3]]| Tiles::new(&camera, &[6.0, 6.0, 3.0], &nalgebra::Matrix3::identity(), blocks);
    let around = tiles(&[[4, 4, 4]]);
    assert_eq!(around.spans().count(), 20 * 15, "all tiles");
    assert!(around.spans().all(|s| s.near < 1.0 && s.far > 6.0), "from before to behind the block");
    // One far ahead beside it must not narrow what they show; alone it shows in the middle only.
    assert!(tiles(&[[4, 4, 4], [4, 4, 80]]).spans().all(|s| s.near < 1.0 && s.far > 6.0));
    let ahead = tiles(&[[4, 4, 80]]).spans().count();
    assert!(ahead > 0 && ahead < 20, "{ahead} tiles");
    assert_eq!(Tiles::new(&camera, &[6.0, 6.0, 30.0], &nalgebra::Matrix3::identity(), &[[4, 4, 4]]).spans().count(), 0);
}

#[test]
fn a_least_overlap_reckons_with_surface_that_nothing_told_of() {
    let forecast = Forecast { hidden: 140.0, expected: 40.0, known: 60.0, ..Forecast::default() };
    assert_eq!(forecast.seen_again(1.0), Some(0.6));
    // A tenth of the 100 pixels that meet nothing in unknown space.
    let cautious = forecast.seen_again_at_least(1.0, true).unwrap();
    assert!((cautious - 60.0 / 110.0).abs() < 1e-12, "{cautious}");
    assert_eq!(forecast.seen_again_at_least(1.0, false), Some(0.6), "unknown space is everywhere there");
    assert_eq!(Forecast::default().seen_again_at_least(1.0, true), None);

    let mut planner = VolumetricPlanner::new(VolumetricConfig { min_overlap: 0.3, ..Default::default() });
    let state = ball(NoReturn::Free);
    let mut forecasts = planner.forecast(&state, &mut rng::stream(1, "cautious"));
    let first = planner.rank(&forecasts)[0];
    let (counted, told) = (first.cautious_overlap.unwrap(), first.overlap.unwrap());
    assert!(counted >= 0.4 && counted < told, "{counted} of {told}");
    forecasts.views.iter_mut().for_each(|f| f.dense = 1.0);
    // The same view, once more surface may turn up, or where gaps between points leave less of it within the tolerance, however wide they are.
    let mut comes_first = |cautious, dense| {
        let change = |f: &mut ViewForecast| (f.cautious_overlap, f.dense) = (Some(cautious), dense);
        forecasts.views.iter_mut().filter(|f| f.view == first.view).for_each(change);
        planner.rank(&forecasts)[0].view == first.view
    };
    let found = [(0.41, 1.0), (0.39, 1.0), (0.5, 0.9), (0.5, 0.75), (0.59, 0.1), (0.61, 0.1)];
    assert_eq!(found.map(|(cautious, dense)| comes_first(cautious, dense)), [true, false, true, false, false, true]);
    forecasts.views.iter_mut().for_each(|f| f.dense = 1.0);
    // None has enough: the one with the most.
    forecasts.views.iter_mut().enumerate().for_each(|(i, f)| f.cautious_overlap = Some(1e-3 * i as f64));
    assert_eq!(planner.rank(&forecasts)[0].view, forecasts.views.last().unwrap().view);
}
