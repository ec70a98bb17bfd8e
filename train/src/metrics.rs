//! Whether the policy gets better: how well predicted scores order the candidates, and what the choice costs.

use crate::watch::null_as_nan;
use geometry::rank_correlation::rank_correlation;
use serde::{Deserialize, Serialize};

/// Means over decisions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RankingMetrics {
    /// Decisions counted.
    pub decisions: usize,
    /// Spearman's rank correlation of predicted and true scores, over decisions where it exists.
    #[serde(deserialize_with = "null_as_nan")]
    pub rank_correlation: f64,
    /// Best true score minus true score of the candidate predicted best.
    #[serde(deserialize_with = "null_as_nan")]
    pub regret: f64,
    /// The same for a candidate drawn at random: best minus mean.
    #[serde(deserialize_with = "null_as_nan")]
    pub random_regret: f64,
    /// Share of decisions whose chosen candidate is the best one.
    #[serde(deserialize_with = "null_as_nan")]
    pub hit_rate: f64,
    /// The same for a candidate drawn at random.
    #[serde(deserialize_with = "null_as_nan")]
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
mod tests;
