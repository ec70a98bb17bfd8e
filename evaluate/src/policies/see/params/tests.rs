use super::*;

#[test]
fn derived_values_match_the_published_code() {
    let paper = SeeParams::resolve(&SeeConfig::paper(), &[], 0.0023, 1.2).expect("valid");
    assert_eq!(paper.k, 56, "benchmark configuration");
    assert!((ball_count(0.03, 490_738.0) - 55.501).abs() < 1e-3);
    assert!((paper.spacing - 3.0790e-3).abs() < 1e-7, "spacing {}", paper.spacing);
    assert_eq!(ball_count(0.017, 146_000.0).ceil(), 4.0, "launch default: {}", ball_count(0.017, 146_000.0));
    assert!((published_spacing(0.017, 146_000.0) - 3.8166e-3).abs() < 1e-7);
    assert_eq!(ball_count(0.03, 1.5e6).ceil(), 170.0);
    assert!((published_spacing(0.03, 1.5e6) - 2.1216e-3).abs() < 1e-7);
}

#[test]
fn too_low_a_density_is_refused() {
    let config = SeeConfig { radius_m: 0.01, density_per_m3: 1e5, ..SeeConfig::default() };
    assert_eq!(SeeParams::resolve(&config, &[], 0.0023, 1.2), None);
}

#[test]
fn automatic_rule_measures_a_plane() {
    let spacing = 0.0023;
    let plane: Vec<_> =
        (0..40).flat_map(|i| (0..40).map(move |j| Point3::new(f64::from(i), f64::from(j), 0.0) * spacing)).collect();
    let params = SeeParams::resolve(&SeeConfig::default(), &plane, spacing, 1.2).expect("valid");
    // 49 lattice points lie in a closed disc of radius 4 spacings.
    assert_eq!(params.k, (0.38f64 * 49.0).round() as usize);
    assert!((params.radius - 4.0 * spacing).abs() < 1e-12 && params.spacing <= 0.9 * spacing);
}
