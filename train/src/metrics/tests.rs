use super::*;

#[test]
fn regret_and_hits_by_hand() {
    let mut r = Ranking::default();
    assert!(r.add(&[0.9, 0.1, 0.2], &[0.5, 0.2, 0.8])); // chooses 0.5 of 0.8
    assert!(r.add(&[0.1, 0.7], &[0.4, 0.6])); // chooses the best
    let m = r.means();
    assert_eq!(m.decisions, 2);
    assert!((m.regret - 0.15).abs() < 1e-7, "{m:?}");
    assert!((m.random_regret - (0.3 + 0.1) / 2.0).abs() < 1e-7, "{m:?}");
    assert!((m.hit_rate - 0.5).abs() < 1e-12 && (m.random_hit_rate - (1.0 / 3.0 + 0.5) / 2.0).abs() < 1e-12);
    assert!((m.relative_regret() - 0.75).abs() < 1e-6);
}

#[test]
fn awkward_decisions_are_survived() {
    let mut r = Ranking::default();
    assert!(!r.add(&[], &[]), "no candidate, no decision");
    assert!(!r.add(&[0.1], &[f32::NAN]), "no truth, no decision");
    assert!(r.add(&[0.1, 0.2], &[0.5, 0.5]), "constant scores count, without a correlation");
    assert!(r.add(&[f32::NAN, 0.2], &[0.0, 1.0]), "a predicted NaN is not chosen");
    let m = r.means();
    assert_eq!((m.decisions, m.regret, m.hit_rate), (2, 0.0, 1.0));
    assert_eq!(Ranking::default().means().relative_regret(), 1.0);
}

#[test]
fn an_oracle_has_no_regret_and_a_random_choice_its_expectation() {
    use rand::RngExt;
    let mut rng = geometry::rng::stream(1, "test/metrics");
    let (mut oracle, mut random) = (Ranking::default(), Ranking::default());
    for _ in 0..4000 {
        let truth: Vec<f32> = (0..20).map(|_| rng.random()).collect();
        let guess: Vec<f32> = (0..20).map(|_| rng.random()).collect();
        oracle.add(&truth, &truth);
        random.add(&guess, &truth);
    }
    assert_eq!(oracle.means().regret, 0.0);
    assert!((oracle.means().rank_correlation - 1.0).abs() < 1e-12);
    let m = random.means();
    assert!((m.relative_regret() - 1.0).abs() < 0.03, "{m:?}");
    assert!((m.hit_rate - 0.05).abs() < 0.015 && m.rank_correlation.abs() < 0.02, "{m:?}");
}
