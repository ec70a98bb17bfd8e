//! Whether the policy gets better: how well predicted scores order the candidates, and what the choice costs.

use geometry::rank_correlation::rank_correlation;
use serde::{Deserialize, Serialize};

/// Means over decisions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankingMetrics {
    /// Decisions counted.
    pub decisions: usize,
    /// Spearman's rank correlation of predicted and true scores, over decisions where it exists.
    pub rank_correlation: f64,
    /// Best true score minus true score of the candidate predicted best.
    pub regret: f64,
    /// The same for a candidate drawn at random: best minus mean.
    pub random_regret: f64,
    /// Share of decisions whose chosen candidate is the best one.
    pub hit_rate: f64,
    /// The same for a candidate drawn at random.
    pub random_hit_rate: f64,
}

impl RankingMetrics {
    /// `regret / random_regret`: 0 is an oracle, 1 a random choice. 1 where all candidates are equal.
    pub fn relative_regret(&self) -> f64 {
        if self.random_regret > 0.0 { self.regret / self.random_regret } else { 1.0 }
    }
}

/// Sums of [`RankingMetrics`] over decisions.
#[derive(Clone, Debug, Default)]
pub struct Ranking {
    decisions: usize,
    correlations: usize,
    correlation: f64,
    regret: f64,
    random_regret: f64,
    hits: f64,
    random_hits: f64,
}

impl Ranking {
    /// Adds a decision: predicted and true scores of the same candidates. Returns false, and adds nothing,
    /// where there is no candidate or a true score is not finite. A predicted NaN ranks below everything.
    pub fn add(&mut self, predicted: &[f32], truth: &[f32]) -> bool {
        assert_eq!(predicted.len(), truth.len(), "one prediction per candidate");
        if truth.is_empty() || truth.iter().any(|t| !t.is_finite()) {
            return false;
        }
        let n = truth.len() as f64;
        let best = truth.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let mean = truth.iter().map(|&t| f64::from(t)).sum::<f64>() / n;
        let chosen = argmax(predicted);
        self.decisions += 1;
        self.regret += f64::from(best) - f64::from(truth[chosen]);
        self.random_regret += f64::from(best) - mean;
        self.hits += f64::from(u8::from(truth[chosen] == best));
        self.random_hits += truth.iter().filter(|&&t| t == best).count() as f64 / n;
        if let Some(rho) = rank_correlation(predicted, truth) {
            self.correlations += 1;
            self.correlation += rho;
        }
        true
    }

    /// The means; zeros where nothing was added.
    pub fn means(&self) -> RankingMetrics {
        let n = self.decisions.max(1) as f64;
        RankingMetrics {
            decisions: self.decisions,
            rank_correlation: self.correlation / self.correlations.max(1) as f64,
            regret: self.regret / n,
            random_regret: self.random_regret / n,
            hit_rate: self.hits / n,
            random_hit_rate: self.random_hits / n,
        }
    }
}

/// Index of the largest value, the first of equals; NaN ranks below everything. 0 for an empty slice.
pub fn argmax(values: &[f32]) -> usize {
    let mut best = 0;
    for (i, &v) in values.iter().enumerate() {
        if v > values[best] || (values[best].is_nan() && !v.is_nan()) {
            best = i;
        }
    }
    best
}

#[cfg(test)]
mod tests {
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
}
