use super::*;

/// The ball with a dropout in its middle, scanned so many times from the same side.
fn with_dropout(scans: usize) -> ScanState {
    let mut state = ball(NoReturn::Unknown);
    let mut scan = (*state.scans[0]).clone();
    let Seen::Depth { camera, depth, .. } = &mut scan.seen else { unreachable!("a depth image") };
    let inside = |i: &usize| (25..55).contains(&(i % 80)) && (25..55).contains(&(i / 80));
    (0..6400).filter(inside).for_each(|i| depth.depth[i] = 0.0);
    let points = depth.to_points(camera, &scan.world_from_camera);
    state.cloud = PointCloud { normals: points.iter().map(|p| p.coords.normalize()).collect(), points };
    state.scans = (0..scans).map(|_| Arc::new(scan.clone())).collect();
    state.num_scans = scans;
    state.given_views = [1.2, -1.2].map(|z| from_z(z).world_from_camera()).into();
    state
}

/// What the two views from the front and from the back are told to bring, and what they score by.
fn told(scans: usize) -> [(f64, f64); 2] {
    let forecasts = VolumetricPlanner::default().forecast(&with_dropout(scans), &mut rng::stream(1, "belief"));
    [0, 1].map(|i| (forecasts.views[i].reported_gain, forecasts.views[i].gain))
}

#[test]
fn what_scans_looked_at_in_vain_is_told_to_be_less_of_a_gain() {
    let [(front, scored), (back, _)] = told(1);
    assert!(front > 0.02 && back > 0.2, "{front} {back}");
    for (scans, left) in [(2, 0.5), (3, 0.25)] {
        let [(now, still_scored), (still, _)] = told(scans);
        // Not all of the dropout's membrane is in sight to the voxel.
        assert!((now / front - left).abs() < 0.15, "after {scans} scans {now} of {front}");
        assert!((still / back - 1.0).abs() < 0.1, "nobody looked at the back: {still} of {back}");
        assert_eq!(still_scored, scored, "views are ranked as before");
    }
}
