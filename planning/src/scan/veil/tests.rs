use super::*;
use nalgebra::Vector3;

fn left_out(points: &[[f64; 3]], believed: bool) -> Vec<LeftOut> {
    points.iter().map(|p| LeftOut { point: Point3::from(*p), believed }).collect()
}

fn past(veil: Option<Veil>) -> PastScan {
    let seen = Seen::Points(Vec::new());
    PastScan { world_from_camera: Isometry3::identity(), seen, pose: Default::default(), veil: veil.map(Into::into) }
}

#[test]
fn the_nearest_point_left_out_bounds_what_is_free() {
    let used: Vec<Point3<f64>> =
        (0..2500).map(|i| Point3::new(0.01 * f64::from(i % 50), 0.01 * f64::from(i / 50), 1.0)).collect();
    let both = [left_out(&[[0.2, 0.2, 1.0], [0.6, 0.6, 2.0]], true), left_out(&[[0.1, 0.1, 0.5]], false)].concat();
    let past = past(Veil::of(&Isometry3::identity(), &used, &both));
    assert!(past.hides_any());
    let hides = |x: f64, z: f64| past.hides([x, x], z, 0);
    assert!(hides(0.2, 0.1), "what is not believed is not free before it either");
    assert!(!hides(0.3, 1.9) && hides(0.3, 2.1), "free up to what was cut away");
    assert!(!hides(0.25, 3.0) && past.hides([0.25, 0.25], 3.0, 10), "nothing there, but near");
    assert!(!hides(-1e300, 3.0) && !hides(f64::NAN, 3.0));
}

#[test]
fn a_few_points_in_all_directions_do_not_coarsen_it() {
    let pose = Isometry3::from_parts(Vector3::new(1.0, 2.0, 3.0).into(), Default::default());
    assert_eq!(Veil::of(&pose, &[], &left_out(&[[1.0, 2.0, 2.0], [1.0, 2.0, 3.0], [9.0, 2.0, 3.1]], false)), None);
    let veil = Veil::of(&pose, &[], &left_out(&[[1.1, 2.0, 4.0], [9.0, 2.0, 3.01]], false)).expect("one before it");
    assert!(veil.memory() < 1_000, "{}", veil.memory());
    let past = past(Some(veil));
    assert!(past.hides([0.1, 0.0], 1.0, 0) && !past.hides([0.2, 0.0], 1.0, 0));
}
