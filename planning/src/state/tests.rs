use super::*;

#[test]
fn known_neighborhoods_are_taken_where_they_fit() {
    let points: Vec<_> = (0..50).map(|i| Point3::new(f64::from(i * i), 0.0, 0.0)).collect();
    let find = |k| NeighborGrid::new(&points, 0.0).neighborhoods(50, k);
    let cloud = PointCloud { points: points.clone(), ..Default::default() };
    let mut state = ScanState { cloud, ..Default::default() };
    let known = |state: &ScanState, k| matches!(state.neighborhoods(k), Cow::Borrowed(_));
    assert!(known(&state, 30) && !known(&state, 20), "as many as asked for");
    state.near = find(50).into();
    assert!(known(&state, 60), "or all there are");
    state.cloud.points.pop();
    assert!(!known(&state, 50), "of another cloud");
    assert_eq!(state.neighborhoods(30).len(), 49);
    assert_eq!(state.neighborhoods(30).ids(7), find(30).ids(7), "found anew");
}
