use super::*;
use geometry::rng::stream;

/// Three views of a surface of 100 points: the first half, the second half, the middle.
fn half_and_half() -> ObjectViews {
    let range = |low, high| BitSet::from_fn(100, move |i| (low..high).contains(&i));
    ObjectViews { scans: vec![vec![]; 3], covered: vec![range(0, 50), range(50, 100), range(25, 75)], surface: 100 }
}

#[test]
fn gains_are_what_is_new() {
    let views = half_and_half();
    assert_eq!(views.gains(&[0], 3), [0.0, 0.5, 0.25]);
    assert_eq!(views.gains(&[2], 3), [0.25, 0.25, 0.0]);
    assert_eq!(views.gains(&[0, 1], 3), [0.0, 0.0, 0.0]);
    assert_eq!(views.coverage(&[0, 2]), 0.75);
}

#[test]
fn a_greedy_episode_takes_the_largest_gain_and_its_coverage_never_falls() {
    let views = half_and_half();
    let states = episode_states(4, &views, 3, 0, 0, 3, 0.0, &mut stream(1, "test/pc-nbv"));
    assert_eq!(states[1].scans, [0, 1], "the other half adds most");
    assert_eq!(states[0].used, [true, false, false]);
    let coverages: Vec<f64> = states.iter().map(|s| views.coverage(&s.scans)).collect();
    assert!(coverages.is_sorted() && states.iter().all(|s| s.object == 4), "{coverages:?}");
    let explored = episode_states(0, &views, 3, 0, 0, 3, 1.0, &mut stream(1, "test/pc-nbv"));
    assert_eq!(explored[2].used, [true; 3], "exploring never repeats a view");
}
