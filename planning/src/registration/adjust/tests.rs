use super::*;

const TOLERANCE: f64 = 0.002;
const ERROR: PoseError = PoseError { sigma_m: 0.002, sigma_rad: 0.006, about: None };

/// The first `count` of three sides of a box that meet in a corner, across z, y and x.
fn sides(count: usize) -> PointCloud {
    let at = |u: usize, v: usize, side: usize| {
        let (u, v) = (0.002 * u as f64, 0.002 * v as f64);
        [
            (Point3::new(u, v, 0.0), Vector3::z()),
            (Point3::new(u, 0.0, v), Vector3::y()),
            (Point3::new(0.0, u, v), Vector3::x()),
        ][side]
    };
    let all = (0..count).flat_map(|side| (0..40).flat_map(move |u| (0..40).map(move |v| at(u, v, side))));
    let (points, normals) = all.unzip();
    PointCloud { points, normals }
}

fn piece(cloud: &PointCloud, moves: bool) -> Piece<'_> {
    Piece { cloud, spacing: 0.002, given: moves.then(|| (Isometry3::identity(), ERROR)) }
}

fn shift(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

fn config(prior: bool) -> RegistrationConfig {
    RegistrationConfig { prior, ..RegistrationConfig::default() }
}

#[test]
fn what_lies_elsewhere_comes_back_and_the_first_stays() {
    let first = sides(3);
    let off = [shift(0.001, -0.0005, 0.0008), shift(-0.0007, 0.0012, 0.0)];
    let others = off.map(|off| sides(3).transformed(&off));
    let pieces = [piece(&first, false), piece(&others[0], true), piece(&others[1], true)];
    let motions = adjust(&pieces, TOLERANCE, &config(false));
    assert_eq!(motions[0].translation.vector.norm(), 0.0);
    for (motion, off) in motions[1..].iter().zip(&off) {
        let left = motion * off;
        assert!(left.translation.vector.norm() < 3e-5 && left.rotation.angle() < 5e-4, "{left}");
    }
}

#[test]
fn what_one_scan_leaves_free_another_holds() {
    // Along x the first does not hold the second; the third does.
    let (first, third) = (sides(2), sides(3));
    let second = sides(3).transformed(&shift(0.0004, 0.0, 0.0));
    let alone = adjust(&[piece(&first, false), piece(&second, true)], TOLERANCE, &config(true));
    assert!(alone[1].translation.vector.norm() < 4e-5, "free, it stays where the robot says: {}", alone[1]);
    let pieces = [piece(&first, false), piece(&second, true), piece(&third, false)];
    let held = adjust(&pieces, TOLERANCE, &config(true));
    assert!((held[1].translation.vector.x + 0.0004).abs() < 4e-5, "{}", held[1]);
}

#[test]
fn nothing_to_hold_on_to_moves_nothing() {
    let first = sides(1);
    let away = sides(1).transformed(&shift(0.5, 0.0, 0.0));
    let motions = adjust(&[piece(&first, false), piece(&away, true)], TOLERANCE, &config(true));
    assert_eq!(motions, vec![Isometry3::identity(); 2]);
    assert!(adjust(&[], TOLERANCE, &config(true)).is_empty());
}

#[test]
fn a_curved_surface_seen_from_two_sides_is_not_pulled_apart() {
    // A rod 8 mm thick, as two cameras 80 degrees apart see it: each half ends where the other's goes on.
    let half = |middle: f64, offset: f64| {
        let mut cloud = PointCloud::default();
        for (turn, along) in (-40..=40).flat_map(|turn| (0..60).map(move |along| (turn, along))) {
            let angle: f64 = middle + f64::from(turn * 2).to_radians() + offset;
            let n = Vector3::new(angle.cos(), angle.sin(), 0.0);
            cloud.points.push(Point3::from(0.004 * n) + 0.002 * f64::from(along) * Vector3::z());
            cloud.normals.push(n);
        }
        cloud
    };
    let [one, other] = [half(0.0, 0.0), half(80f64.to_radians(), 0.013)];
    let motions = adjust(&[piece(&one, false), piece(&other, true)], TOLERANCE, &config(false));
    let across = motions[1].translation.vector.xy().norm();
    assert!(across < 1e-5, "{across}");
}
