use super::super::silhouette::Silhouette;
use super::*;
use crate::scan::Veil;
use crate::scan::veil::LeftOut;

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
        let is = |x: f64, z: f64| outline.is_background(scan, &Point3::new(x, 0.0, z));
        assert!(is(0.12, 0.0) && is(-0.12, -0.1) && is(0.11, 0.3), "{name}: beside the ball");
        assert!(!is(0.0, 0.0) && !is(0.0, -0.3) && !is(0.06, 0.0), "{name}: the ball, behind it, a dropout on it");
        assert!(!is(0.0, 2.0), "{name}: behind the camera");
    }
    let outline = Silhouette::of(&scan, 0.004).expect("it saw something");
    assert!(!outline.is_background(&scan, &Point3::new(5.0, 0.0, 0.0)), "beyond the image nothing is known");
    let empty = PastScan { seen: Seen::Points(Vec::new()), ..points };
    assert!(Silhouette::of(&empty, 0.004).is_none());
}

#[test]
fn no_pixel_that_measured_something_is_background() {
    let plain = (*ball(NoReturn::Unknown).scans[0]).clone();
    for turn in 0..20 {
        let roll = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, 0.05) * f64::from(turn));
        let scan = PastScan { world_from_camera: roll * plain.world_from_camera, ..plain.clone() };
        let Seen::Depth { camera, depth, .. } = &scan.seen else { unreachable!("a depth image") };
        let outline = Silhouette::of(&scan, 0.004).expect("it saw something");
        // Anywhere within the pixel.
        let within = [[-0.4, -0.4], [0.4, -0.4], [-0.4, 0.4], [0.4, 0.4]].map(|[u, v]| [u / camera.fx, v / camera.fy]);
        depth.for_each_point(camera, &scan.world_from_camera, |p| {
            let local = scan.world_from_camera.inverse() * p;
            for [x, y] in within {
                let beside = scan.world_from_camera * (local + Vector3::new(x, y, 0.0) * local.z);
                assert!(!outline.is_background(&scan, &beside), "turned {turn} times: {p}");
            }
        });
    }
}

/// Metres between the ball's pixels in the plane through its middle.
const PIXEL: f64 = 1.2 / 514.133;

#[test]
fn pixels_that_are_not_believed_are_no_background_and_hide_none() {
    let state = ball(NoReturn::Unknown);
    let plain = &*state.scans[0];
    let without = |taken: &dyn Fn(i32, i32) -> bool| {
        let mut scan = plain.clone();
        let Seen::Depth { depth, .. } = &mut scan.seen else { unreachable!("a depth image") };
        for (i, z) in depth.depth.iter_mut().enumerate() {
            if taken(i as i32 % 80 - 40, i as i32 / 80 - 40) {
                *z = f32::NAN;
            }
        }
        scan
    };
    let at = |column: i32, row: i32| Point3::new(PIXEL * f64::from(column), -PIXEL * f64::from(row), 0.0);
    // A closed ring of them, as around an image without its distortion.
    let ring = |column: i32, row: i32| {
        let (least, most) = (column.min(row), column.max(row));
        least >= -40 && most < 40 && (least == -40 || most == 39)
    };
    let ringed = without(&ring);
    let [open, closed] = [plain, &ringed].map(|scan| Silhouette::of(scan, 0.004).expect("it saw something"));
    for (column, row) in (-60..60).flat_map(|column| (-60..60).map(move |row| (column, row))) {
        let expected = open.is_background(plain, &at(column, row)) && !ring(column, row);
        assert_eq!(closed.is_background(&ringed, &at(column, row)), expected, "{column} {row}");
    }
    assert!(closed.is_background(&ringed, &at(37, 0)) && !closed.is_background(&ringed, &at(39, 0)));
    assert!(closed.is_deep_background(&ringed, &at(50, 0)) && !closed.is_deep_background(&ringed, &at(41, 0)));
    // Something too near, across the edge of the ball: what it hides is not known.
    let hidden = without(&|column, row| column >= 0 && row.abs() <= 20);
    let outline = Silhouette::of(&hidden, 0.004).expect("it saw something");
    let is = |column: i32, behind: f64| {
        let p = at(column, 0) * (1.0 + behind / 1.2);
        outline.is_background(&hidden, &Point3::new(p.x, p.y, -behind))
    };
    assert!(!is(17, 0.0) && !is(17, 0.3) && !is(37, 0.1), "before and behind it");
    assert!(is(-50, 0.0) && is(50, 0.1), "beside it");
}

#[test]
fn what_points_left_out_is_no_background() {
    let state = ball(NoReturn::Unknown);
    let pose = state.scans[0].world_from_camera;
    // The left half of the ball, and something in front of the other.
    let points: Vec<Point3<f64>> = state.cloud.points.iter().filter(|p| p.x < 0.0).copied().collect();
    let without = |z: f64, believed: bool| {
        let at = |i: u32| pose * state.camera.unproject(f64::from(640 + i % 60), f64::from(340 + i / 60), z);
        let left_out: Vec<LeftOut> = (0..2400).map(|i| LeftOut { point: at(i), believed }).collect();
        let veil = Veil::of(&pose, &points, &left_out).map(Arc::new);
        assert!(veil.is_some());
        PastScan { seen: Seen::Points(points.clone()), veil, ..(*state.scans[0]).clone() }
    };
    let bare = PastScan { veil: None, ..without(0.2, false) };
    let is = |scan: &PastScan, column: f64, z: f64| {
        let outline = Silhouette::of(scan, 0.004).expect("it saw something");
        outline.is_background(scan, &Point3::new(PIXEL * column * (1.2 - z) / 1.2, 0.0, z))
    };
    let near = without(0.2, false);
    for (column, z) in [(20.0, 0.0), (20.0, -0.3), (45.0, 0.0)] {
        assert!(is(&bare, column, z) && !is(&near, column, z), "{column} {z}: behind what was too near");
    }
    assert!(is(&near, -50.0, 0.0) && is(&near, 70.0, 0.0), "beside it");
    assert!(!is(&near, -20.0, -0.3), "behind the ball");
    let wall = without(1.5, true);
    assert!(is(&wall, 45.0, 0.0) && !is(&wall, 45.0, -0.6), "free up to a wall that was cut away");
    // The same of the voxels.
    let cloud = PointCloud { points: points.clone(), normals: Vec::new() };
    let unknown = |scan: PastScan| {
        let state = ScanState { scans: vec![Arc::new(scan)], cloud: cloud.clone(), ..state.clone() };
        let grid = VolumetricPlanner::default().carved_grid(&state);
        let i = grid.index(&Point3::new(0.03, 0.0, -0.05)).expect("in the cube");
        grid.unknown.contains(&(i as u32))
    };
    assert!(unknown(near) && !unknown(bare));
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
fn where_pixels_leave_gaps_a_second_look_overlaps_and_another_side_is_new() {
    let mut state = ball(NoReturn::Free);
    // Points that cover a seventh of what they are looked at.
    (state.tolerance, state.reach) = (0.0005, 0.0005);
    let poses = [from_z(1.2), View { target: Point3::origin(), position: Point3::new(1.2, 0.0, 0.0) }];
    state.given_views = poses.iter().map(View::world_from_camera).collect();
    let forecasts = VolumetricPlanner::default().forecast(&state, &mut rng::stream(1, "planner"));
    let [again, beside] = &forecasts.views[..] else { panic!("{forecasts:?}") };
    assert!(again.overlap > Some(0.7) && again.gain < 0.05, "{again:?}");
    assert!(beside.overlap < Some(0.6) && beside.gain > 0.2, "{beside:?}");
    let gapless = ScanState { tolerance: 0.002, reach: 0.002, ..state.clone() };
    let fine = VolumetricPlanner::default().forecast(&gapless, &mut rng::stream(1, "planner"));
    assert!((beside.overlap.unwrap() - fine.views[1].overlap.unwrap()).abs() < 0.15, "{beside:?} {:?}", fine.views[1]);
    // What of it lies within the tolerance is told beside it.
    let dense = [again.dense, fine.views[0].dense];
    assert!((0.1..0.2).contains(&dense[0]) && dense[1] > 0.9, "{dense:?}");
}

#[test]
fn gains_told_swell_less_with_the_voxels_than_outlines_do() {
    let told = |tolerance: f64| {
        let mut state = ScanState { tolerance, reach: tolerance, ..ball(NoReturn::Free) };
        let beside = View { target: Point3::origin(), position: Point3::new(1.2, 0.0, 0.0) };
        state.given_views = [beside.world_from_camera()].into_iter().collect();
        VolumetricPlanner::default().forecast(&state, &mut rng::stream(1, "planner")).views[0].reported_gain
    };
    let [fine, coarse] = [0.0015, 0.004].map(told);
    // A ball's flat membrane is seen from its edge: as marched, 1.75 times as much with voxels of 8 mm as with 3.
    assert!((1.0..1.6).contains(&(coarse / fine)), "{fine} {coarse}");
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
    assert!(ranked.iter().all(|r| r.given == Some(place(r))), "each says which it is");
    assert_eq!((order.len(), order[2]), (3, 0), "where the camera was comes last: {order:?}");
    assert!(ranked[2].overlap > Some(0.7) && ranked[2].gain < Some(0.05), "{:?}", ranked[2]);
}

#[test]
fn a_forecast_is_of_the_image_as_it_is_turned() {
    use crate::pose::{CameraRoll, PoseConfig};
    let mut state = ball(NoReturn::Free);
    // Half as wide again as the ball, and low.
    state.camera = PinholeCamera { width: 100, height: 20, cx: 50.0, cy: 10.0, ..state.camera };
    let told = |state: &ScanState| VolumetricPlanner::default().forecast(state, &mut rng::stream(1, "planner")).views;
    let upright = told(&state);
    let sideways = PoseConfig { extra_roll_deg: 90.0, ..Default::default() };
    state.roll = CameraRoll::new(&sideways, &Vector3::z());
    let turned = told(&state);
    let off = |a: &[ViewForecast], b: &[ViewForecast]| {
        // Those at the boundary; where they see little, others follow.
        assert!(a.len() > 50 && b.len() > 50);
        a.iter().zip(b).map(|(a, b)| (a.reported_gain - b.reported_gain).abs()).fold(0.0, f64::max)
    };
    assert!(off(&upright, &turned) > 0.01, "other parts are in the image");
    state.given_views = turned.iter().map(|f| state.pose(&f.view, None)).collect();
    assert!(off(&turned, &told(&state)) < 1e-9, "as of the same poses, given");
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

#[test]
fn what_is_measured_but_not_covered_counts_where_pixels_leave_no_gaps() {
    let state = ball(NoReturn::Free);
    let mut grid = prepared(&state);
    let mut seen = |covered: f32, distance: f64| {
        grid.surface.iter_mut().for_each(|s| s.covered = covered);
        let leaps = Leaps::new(&grid, true);
        let marcher = Marcher::new(&grid, &leaps, &SensorConfig::default());
        marcher.forecast(&state.camera, &from_z(distance).world_from_camera(), 1, 0.002).area
    };
    let [all, half] = [1.0, 0.5].map(|covered| seen(covered, 1.2));
    let more = (half.covered - all.covered) / all.known;
    // Half of what a look covers: of a half ball seven to eight tenths, since its points cover 1.6 times the cosine, and at most all.
    assert!(half.known == all.known && (0.34..0.41).contains(&more), "{more} of {all:?}");
    // Pixels of 3.9 mm, of points that cover 2 mm.
    assert_eq!(seen(0.5, 2.0), seen(1.0, 2.0));
}
