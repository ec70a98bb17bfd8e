use super::*;
use geometry::rng::stream;
use rand::RngExt;

/// Decisions whose gain and overlap are known functions of the features.
fn decisions() -> Vec<Decision> {
    let mut rng = stream(4, "test/learned");
    let mut labelled = || {
        let features = [(); FEATURES].map(|()| rng.random_range(0.0..1.0));
        let (gain, overlap) = (0.3 * features[1] * features[8], 0.2 + 0.5 * features[4]);
        Labelled { features, gain, overlap }
    };
    (0..20).map(|_| Decision((0..60).map(|_| labelled()).collect())).collect()
}

#[test]
fn a_fit_finds_what_the_labels_are_made_of() {
    let all = decisions();
    let fit = Learned::fit(&all[..15], 1e-10, &[true; FEATURES]).expect("a fit");
    for r in all[15..].iter().flat_map(|d| &d.0) {
        let (gain, overlap) = fit.predict(&r.features);
        assert!((gain - r.gain).abs() < 1e-4 && (overlap - r.overlap).abs() < 1e-4, "{gain} {overlap} {r:?}");
    }
    let mut used = [true; FEATURES];
    used[4] = false;
    let blind = Learned::fit(&all[..15], 1e-10, &used).expect("a fit");
    let error = |r: &Labelled| (blind.predict(&r.features).1 - r.overlap).abs();
    let mean = all[15..].iter().flat_map(|d| &d.0).map(error).sum::<f64>() / 300.0;
    assert!(mean > 0.05, "without what the overlap is made of it is not found: {mean}");
    assert_eq!(Learned::fit(&[], 1e-10, &used), None);
}

#[test]
fn files_come_back_and_unfit_ones_are_named() {
    let folder = tempfile::tempdir().expect("temp");
    let path = folder.path().join("forecasts.json");
    let fit = Learned::fit(&decisions(), 1e-6, &[true; FEATURES]).expect("a fit");
    std::fs::write(&path, serde_json::to_string(&fit).expect("json")).expect("written");
    let read = Learned::read(&path).expect("read");
    let pairs = fit.gain.iter().zip(&read.gain).chain(fit.overlap.iter().zip(&read.overlap));
    assert!(read.gain.len() == 91 && pairs.into_iter().all(|(a, b)| (a - b).abs() <= 1e-14 * a.abs()), "{read:?}");
    std::fs::write(&path, r#"{"gain": [1.0], "overlap": []}"#).expect("written");
    let error = Learned::read(&path).expect_err("too short").to_string();
    assert!(
        error.contains("forecasts.json") && error.contains("1 coefficients under \"gain\", expected 91"),
        "{error}"
    );
}
