use super::super::silhouette::Silhouette;
use super::*;

#[test]
fn outside_of_the_outline_is_background_and_a_dropout_is_not() {
    let state = ball(NoReturn::Unknown);
    let mut scan = (*state.scans[0]).clone();
    let points = PastScan { seen: Seen::Points(state.cloud.points.clone()), ..scan.clone() };
    if let Seen::Depth { depth, .. } = &mut scan.seen {
        (0..6400)
            .filter(|i| (35..45).contains(&(i % 80)) && (35..45).contains(&(i / 80)))
            .for_each(|i| depth.depth[i] = 0.0);
    }
    for (scan, name) in [(&scan, "depth"), (&points, "points")] {
        let outline = Silhouette::of(scan, 0.004).expect("it saw something");
        let is = |x: f64, z: f64| outline.is_background(&Point3::new(x, 0.0, z));
        assert!(is(0.12, 0.0) && is(-0.12, -0.1) && is(0.11, 0.3), "{name}: beside the ball");
        assert!(!is(0.0, 0.0) && !is(0.0, -0.3) && !is(0.06, 0.0), "{name}: the ball, behind it, a dropout on it");
        assert!(!is(0.0, 2.0), "{name}: behind the camera");
    }
    let outline = Silhouette::of(&scan, 0.004).expect("it saw something");
    assert!(!outline.is_background(&Point3::new(5.0, 0.0, 0.0)), "beyond the image nothing is known");
    let empty = PastScan { seen: Seen::Points(Vec::new()), ..points };
    assert!(Silhouette::of(&empty, 0.004).is_none());
}

#[test]
fn an_outline_that_others_contradict_is_no_longer_trusted() {
    let mut state = ball(NoReturn::Unknown);
    let mut planner = VolumetricPlanner::default();
    planner.carved_grid(&state);
    assert!(planner.carved[0].background().is_some(), "nothing speaks against it");
    for i in 0..state.cloud.len() / 10 {
        state.cloud.points.push(Point3::new(0.09, 0.0001 * i as f64 - 0.02, 0.0));
        state.cloud.normals.push(Vector3::x());
    }
    planner.carved_grid(&state);
    assert!(planner.carved[0].background().is_none(), "surface in its background");
}

/// Half of a ball of 8 cm is 402 cm2; from 1.2 m a little less of it shows: 2 pi r^2 (1 - r / d) = 375 cm2.
#[test]
fn areas_are_those_of_the_ball() {
    let cap = 2.0 * std::f64::consts::PI * 0.08 * 0.08 * (1.0 - 0.08 / 1.2);
    let state = ball(NoReturn::Free);
    let (grid, known_m2) = prepared_with_area(&state);
    let leaps = Leaps::new(&grid, true);
    let marcher = Marcher::new(&grid, &leaps, &SensorConfig::default());
    // At the limb its points are too far apart to tell.
    assert!(known_m2 > 0.82 * cap && known_m2 < 1.05 * cap, "measured: {known_m2:.4} m2, true {cap:.4}");
    for camera in [PinholeCamera::default(), PinholeCamera::from_fov_y(640, 480, 0.6)] {
        let stride = |distance: f64| ray_stride(&camera, distance, grid.voxel);
        for distance in [0.5, 1.2, 2.0] {
            let seen = marcher.forecast(&camera, &from_z(distance).world_from_camera(), stride(distance), 0.002).area;
            // From farther away no more of it is known.
            let shown = 2.0 * std::f64::consts::PI * 0.08 * 0.08 * (1.0 - 0.08 / distance.min(1.2));
            // Of the limb as little as was measured.
            let ratio = seen.known / shown;
            assert!((0.82..1.1).contains(&ratio), "{distance} m: {:.4} m2, true {shown:.4}", seen.known);
        }
        let stride = stride(1.2);
        let behind = marcher.forecast(&camera, &from_z(-1.2).world_from_camera(), stride, 0.002).area;
        assert!(behind.expected < 2.0 * cap && behind.expected > 0.3 * cap, "{behind:?}");
        // A slope has more surface than the pixels that see it are wide.
        let wide = marcher.forecast(&camera, &from_z(-1.2).world_from_camera(), stride, 1.0);
        let across = wide.expected * camera.pixel_size(1.2).powi(2);
        assert!(wide.area.covered > 1.15 * across, "{} m2 of {across} m2 across", wide.area.covered);
        assert!(behind.known == 0.0 && behind.covered > 0.0, "{behind:?}");
    }
}

#[test]
fn what_a_scan_covers_of_a_surface_follows_from_its_pixels() {
    let share = predict::covered_share;
    assert_eq!(share(1.0, 1.0, 1.0), 1.0, "pixels as wide as the tolerance");
    let alone = share(4.0, 1.0, 1.0);
    assert!((alone - std::f32::consts::PI / 16.0).abs() < 1e-6, "discs that do not touch: {alone}");
    assert!(share(1.0, 0.3, 1.0) < 0.6, "a slope is seen in rows");
    let falls = (1..60).map(|k| share(0.1 * k as f32, 0.8, 1.0)).collect::<Vec<_>>();
    assert!(falls.windows(2).all(|w| w[1] <= w[0] + 0.12), "without a jump up: {falls:?}");
}

#[test]
fn given_views_are_scored_and_none_is_invented() {
    let mut state = ball(NoReturn::Free);
    let poses = [from_z(1.2), from_z(-1.2), View { target: Point3::origin(), position: Point3::new(1.2, 0.0, 0.0) }];
    state.given_views = poses.iter().map(View::world_from_camera).collect();
    let mut planner = VolumetricPlanner::new(VolumetricConfig { gain_only: true, ..Default::default() });
    let ranked = planner.rank_views(&state, &mut rng::stream(1, "planner")).expect("views");
    let place = |r: &RankedView| state.given().iter().position(|v| *v == r.view).expect("one of those given");
    let order: Vec<usize> = ranked.iter().map(place).collect();
    assert_eq!((order.len(), order[2]), (3, 0), "where the camera was comes last: {order:?}");
    assert!(ranked[2].overlap > Some(0.7) && ranked[2].gain < Some(0.05), "{:?}", ranked[2]);
}

#[test]
fn misses_are_not_free_space_where_another_scan_saw_surface() {
    let mut state = ball(NoReturn::Free);
    let mut planner = VolumetricPlanner::default();
    planner.rank_views(&state, &mut rng::stream(1, "planner")).expect("views");
    assert!(planner.scans_with_distrusted_misses().is_empty(), "nothing speaks against it");
    // The sensor failed on a fifth of the ball, which a second look from the same place saw.
    let mut dark = (*state.scans[0]).clone();
    let Seen::Depth { depth, .. } = &mut dark.seen else { unreachable!("a depth image") };
    let rows = depth.depth.len() / 5 * 2..depth.depth.len() / 5 * 3;
    depth.depth[rows].fill(0.0);
    state.scans = vec![Arc::new(dark), Arc::clone(&state.scans[0])];
    state.num_scans = 2;
    let mut planner = VolumetricPlanner::default();
    planner.rank_views(&state, &mut rng::stream(1, "planner")).expect("views");
    assert_eq!(planner.scans_with_distrusted_misses(), [0], "the first alone");
}
