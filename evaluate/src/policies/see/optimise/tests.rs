use super::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

fn unit(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    loop {
        let v = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0f64));
        if (0.1..1.0).contains(&v.norm()) {
            return v.normalize();
        }
    }
}

#[test]
fn clearance_equals_brute_force_on_random_caps() {
    let mut rng = geometry::rng::stream(7, "caps");
    let sphere: Vec<Vector3<f64>> = (0..4000)
        .map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 4000.0;
            let (s, c) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * c, r * s, z)
        })
        .collect();
    for case in 0..1000 {
        let axis = unit(&mut rng);
        let spread = rng.random_range(0.1..0.8);
        let occluders: Vec<_> =
            (0..rng.random_range(1..30)).map(|_| (axis + spread * unit(&mut rng)).normalize()).collect();
        let u = clearest_direction(&occluders, &axis).expect("the origin is outside the hull");
        let found = worst(&occluders, &u);
        let brute = sphere.iter().map(|s| worst(&occluders, s)).fold(f64::INFINITY, f64::min);
        assert!(found <= brute + 1e-9, "case {case}: {found} is worse than {brute}");
        assert!(found >= brute - 0.05, "case {case}: {found} is impossible beside {brute}");
        // The optimum is the norm of the nearest hull point: strong duality.
        assert!((found + min_norm_point(&occluders).norm()).abs() < 1e-6, "case {case}");
    }
}

#[test]
fn surrounded_point_descends_from_the_observing_direction() {
    let mut rng = geometry::rng::stream(8, "ball");
    let occluders: Vec<_> = (0..300).map(|_| unit(&mut rng)).filter(|c| c.dot(&Vector3::z()) < 0.8).collect();
    let start = Vector3::new(0.3, 0.2, 0.9).normalize();
    let u = clearest_direction(&occluders, &start).expect("a hole remains");
    assert!(worst(&occluders, &u) <= worst(&occluders, &start));
    assert!(u.z > 0.95, "the hole is around +z, found {u}");
}

#[test]
fn no_occluder_no_answer() {
    assert!(clearest_direction(&[], &Vector3::z()).is_none());
}
