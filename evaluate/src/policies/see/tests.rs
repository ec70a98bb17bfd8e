//! SEE: its parts, and whole runs.

use super::params::{SeeConfig, SeeParams};
use super::state::{Label, Surface};
use super::*;
use geometry::PointCloud;

fn params(k: usize, radius: f64) -> SeeParams {
    SeeParams { radius, k, spacing: 1e-4, distance: 1.2, occlusion: 0.1, probe: radius, updates: 100 }
}

/// A 2 mm lattice of nx x ny points in the plane z = 0.
fn lattice(nx: i32, ny: i32) -> Vec<Point3<f64>> {
    (0..nx).flat_map(|i| (0..ny).map(move |j| Point3::new(0.002 * f64::from(i), 0.002 * f64::from(j), 0.0))).collect()
}

#[test]
fn an_edge_is_frontier_only_when_k_lies_between_half_and_full_count() {
    // Radius of 4.5 lattice steps: about 69 points inside, 39 on a straight edge, 22 in a corner.
    let count = |k: usize| {
        let mut surface = Surface::new(params(k, 0.009));
        surface.update(&lattice(40, 40), Point3::new(0.04, 0.04, 1.2));
        let on_edge = |p: &Point3<f64>| p.x < 0.011 || p.y < 0.011 || p.x > 0.067 || p.y > 0.067;
        let inner = surface.points.iter().filter(|s| s.label == Label::Frontier && !on_edge(&s.position)).count();
        (surface.frontiers.len(), inner)
    };
    let (half, inner) = count(45);
    assert!(half >= 40, "with k above half of the full count the four edges are frontiers: {half}");
    assert_eq!(inner, 0, "the interior never is");
    assert!(count(20).0 < 10, "with k below half of it, edges count as core: {:?}", count(20));
    assert_eq!(count(200).0, 0, "without core there is no frontier");
}

#[test]
fn a_strip_has_its_frontier_at_the_ends() {
    // One-dimensional: spacing 2 mm, radius 9 mm: 9 neighbours inside, 5 at an end.
    let mut surface = Surface::new(params(7, 0.009));
    surface.update(&lattice(60, 1), Point3::new(0.06, 0.0, 1.2));
    assert!(!surface.frontiers.is_empty());
    for &i in &surface.frontiers {
        let x = surface.points[i as usize].position.x;
        assert!(!(0.012..=0.106).contains(&x), "frontier in the middle of the strip: {x}");
        let outward = surface.points[i as usize].frontier.x;
        assert!(if x < 0.05 { outward < 0.9 } else { outward > -0.9 }, "frontier vector points back at {x}: {outward}");
    }
}

#[test]
fn normals_point_to_the_side_of_the_sensor() {
    for side in [1.0, -1.0] {
        let mut surface = Surface::new(params(45, 0.009));
        surface.update(&lattice(40, 40), Point3::new(0.04, 0.04, 1.2 * side));
        for &i in &surface.frontiers {
            assert!(surface.points[i as usize].normal.z * side > 0.99, "sensor at {side}");
            assert!(surface.points[i as usize].view.z * side > 0.0, "the view is on the sensor's side");
        }
        assert!(!surface.frontiers.is_empty());
    }
}

fn ball(count: usize, keep: impl Fn(&Point3<f64>) -> bool) -> Vec<Point3<f64>> {
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (s, c) = (i as f64 * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Point3::new(r * c, r * s, z) * 0.08
        })
        .filter(keep)
        .collect()
}

#[test]
fn a_covered_ball_ends_and_an_uncovered_one_does_not() {
    let mut covered = Surface::new(params(20, 0.009));
    covered.update(&ball(16_000, |_| true), Point3::new(0.0, 0.0, 1.2));
    assert!(covered.done && covered.next.is_none());
    let mut cap = Surface::new(params(33, 0.009));
    cap.update(&ball(16_000, |p| p.z > 0.02), Point3::new(0.0, 0.0, 1.2));
    assert!(!cap.done);
    cap.update(&ball(16_000, |_| true), Point3::new(1.2, 0.0, 0.0));
    assert!(cap.done, "{} frontiers stay on a closed ball", cap.frontiers.len());
}

#[test]
fn nothing_seen_at_first_ends_at_once() {
    let mut surface = Surface::new(params(20, 0.009));
    surface.update(&[], Point3::new(0.0, 0.0, 1.2));
    assert!(surface.done);
}

#[test]
fn an_empty_scan_frees_the_frontier_it_was_meant_for() {
    let mut surface = Surface::new(params(33, 0.009));
    surface.update(&ball(16_000, |p| p.z > 0.02), Point3::new(0.0, 0.0, 1.2));
    let target = surface.target.expect("a proposal");
    surface.update(&[], Point3::new(1.2, 0.0, 0.0));
    assert_eq!(surface.points[target as usize].label, Label::Outlier);
}

/// A ball's upper half as a depth camera above it samples it: sparser towards the silhouette.
fn seen_from_above() -> Vec<Point3<f64>> {
    let pitch = 0.0023;
    (-34..=34)
        .flat_map(|i| (-34..=34).map(move |j| (pitch * f64::from(i), pitch * f64::from(j))))
        .filter(|(x, y)| x.hypot(*y) < 0.0795)
        .map(|(x, y)| Point3::new(x, y, (0.08f64.powi(2) - x * x - y * y).sqrt()))
        .collect()
}

fn state(points: Vec<Point3<f64>>, camera: Point3<f64>) -> ScanState {
    let view = View { target: Point3::origin(), position: camera };
    ScanState {
        cloud: PointCloud { points: points.clone(), normals: Vec::new() },
        scans: vec![
            PastScan {
                world_from_camera: view.world_from_camera(),
                seen: Seen::Points(points),
                pose: Default::default(),
                veil: None,
            }
            .into(),
        ],
        num_scans: 1,
        grid_size: 0.0023,
        working_distance: 1.2,
        tolerance: 0.002,
        ..ScanState::default()
    }
}

#[test]
fn the_tuned_planner_looks_past_the_edge_and_repeats_itself_exactly() {
    let cap = state(seen_from_above(), Point3::new(0.0, 0.0, 1.2));
    let mut rng = geometry::rng::stream(0, "unused");
    let run = |rng: &mut ChaCha8Rng| SeePlanner::new("see", SeeConfig::default()).rank_views(&cap, rng).expect("views");
    let first = run(&mut rng);
    assert_eq!(first, run(&mut rng));
    let view = first.first().expect("a proposal").view;
    assert!((view.position - view.target).norm() - 1.2 < 1e-9);
    assert!((0.0..0.05).contains(&view.target.z), "the target lies at the edge: {}", view.target);
    assert!(view.position.coords.xy().norm() > 0.6, "the camera has left the pole: {}", view.position);
}

#[test]
fn unknown_poses_mean_no_answer() {
    let mut unposed = state(ball(8_000, |p| p.z > 0.0), Point3::new(0.0, 0.0, 1.2));
    unposed.scans.clear();
    let mut rng = geometry::rng::stream(0, "unused");
    let error = SeePlanner::new("see", SeeConfig::default()).rank_views(&unposed, &mut rng).expect_err("no camera");
    assert!(matches!(&error, PlanError::Lacks { .. }) && !error.is_end(), "{error}");
}

#[test]
fn a_density_that_leaves_too_few_points_is_a_fault_and_a_sparse_first_scan_an_end() {
    let ask = |points: Vec<Point3<f64>>, config: SeeConfig| {
        let scanned = state(points, Point3::new(0.0, 0.0, 1.2));
        let mut rng = geometry::rng::stream(0, "unused");
        SeePlanner::new("see", config).rank_views(&scanned, &mut rng).expect_err("no view")
    };
    let error = ask(seen_from_above(), SeeConfig { density_per_m3: 1e3, ..SeeConfig::default() });
    assert!(matches!(&error, PlanError::Failed { .. }) && !error.is_end(), "{error}");
    let text = error.to_string();
    assert!(text.contains("see.density_per_m3 = 1000 asks for fewer than 3 points per ball of 0.0092 m"), "{text}");
    let error = ask(ball(5, |_| true), SeeConfig::default());
    assert!(error.is_end() && error.to_string().contains("too sparse"), "{error}");
}

#[test]
fn the_published_drive_looks_from_behind_first() {
    // The "sensor" at the centre turns all normals inwards.
    let cap = state(seen_from_above(), Point3::new(0.0, 0.0, 1.2));
    let mut rng = geometry::rng::stream(0, "unused");
    let view = SeePlanner::paper().rank_views(&cap, &mut rng).expect("a view")[0].view;
    let frontier = view.target - 0.3 * view.direction();
    assert!(
        frontier.coords.dot(&view.direction()) < -0.03,
        "the camera is on the far side: {frontier} {}",
        view.position
    );
    assert!(
        (view.position - view.target).norm() - 1.2 < 1e-9,
        "the harness rebuilds the target at the working distance"
    );
}

#[test]
fn the_published_drive_repeats_and_starts_degenerate_without_frontiers() {
    let full = state(ball(40_000, |_| true), Point3::new(0.0, 0.0, 1.2));
    let mut rng = geometry::rng::stream(0, "unused");
    let view = SeePlanner::paper().rank_views(&full, &mut rng).expect("a view")[0].view;
    assert_eq!(view.target, view.position, "no frontier ever: the zeroed proposal");
}
