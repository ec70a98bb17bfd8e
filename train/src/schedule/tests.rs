use super::*;

fn schedule(kind: ScheduleKind, warmup_steps: u64, total: u64) -> Schedule {
    Schedule::new(&ScheduleConfig { kind, warmup_steps, ..Default::default() }, 1e-3, total)
}

#[test]
fn warm_up_is_linear_and_ends_at_the_full_rate() {
    let s = schedule(ScheduleKind::Constant, 4, 100);
    let rates: Vec<f64> = (0..6).map(|i| s.rate(i, 0)).collect();
    for (rate, expected) in rates.iter().zip([0.25e-3, 0.5e-3, 0.75e-3, 1e-3, 1e-3, 1e-3]) {
        assert!((rate - expected).abs() < 1e-15, "{rates:?}");
    }
}

#[test]
fn cosine_starts_full_halves_midway_and_ends_at_the_floor() {
    let config = ScheduleConfig { kind: ScheduleKind::Cosine, min_learning_rate: 1e-5, ..Default::default() };
    let s = Schedule::new(&config, 1e-3, 100);
    assert!((s.rate(0, 0) - 1e-3).abs() < 1e-12);
    assert!((s.rate(50, 0) - (1e-5 + 0.5 * (1e-3 - 1e-5))).abs() < 1e-12, "half way is the mean");
    assert!((s.rate(100, 0) - 1e-5).abs() < 1e-12);
    assert!((s.rate(1000, 0) - 1e-5).abs() < 1e-12, "past the end the floor stays");
}

#[test]
fn step_decays_by_epoch() {
    let config = ScheduleConfig { kind: ScheduleKind::Step, factor: 0.7, step_epochs: 20, ..Default::default() };
    let s = Schedule::new(&config, 1e-3, 100);
    assert_eq!(s.rate(7, 19), 1e-3);
    assert!((s.rate(7, 40) - 0.49e-3).abs() < 1e-12);
}

/// torch.optim.lr_scheduler.ReduceLROnPlateau(factor=0.5, patience=3): the losses below give
/// 1, 1, 1, 1, 0.5 (fifth bad-free count exceeded), worked out by hand from its source.
#[test]
fn plateau_follows_pytorch() {
    let mut s = schedule(ScheduleKind::Plateau, 0, 0);
    let mut rates = Vec::new();
    for loss in [1.0, 0.99995, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5] {
        s.observe(loss);
        rates.push(s.rate(0, 0) / 1e-3);
    }
    // 0.99995 is within the threshold of 1.0: no improvement, so the fifth loss is the fourth bad one.
    assert_eq!(rates, [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.25]);
}

#[test]
fn plateau_survives_nan_and_resumes() {
    let mut s = schedule(ScheduleKind::Plateau, 0, 0);
    s.observe(f64::NAN);
    assert_eq!(s.state().bad_epochs, 1);
    s.observe(0.1);
    let again = schedule(ScheduleKind::Plateau, 0, 0).with_state(s.state());
    assert_eq!(again, s);
}

#[test]
fn best_counts_epochs_without_improvement() {
    let mut best = Best::default();
    assert!(best.observe(1.0, 0));
    assert!(!best.observe(f64::NAN, 1), "NaN is never best");
    assert!(!best.observe(1.0, 2));
    assert!(best.exhausted(2) && !best.exhausted(0) && !best.exhausted(3));
    assert!(best.observe(0.5, 3));
    assert_eq!((best.value, best.epoch, best.bad_epochs), (Some(0.5), 3, 0));
}
