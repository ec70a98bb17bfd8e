//! Residuals among which there are outliers.

/// Tukey's constant, and the least scale in tolerances.
const TUKEY: f64 = 4.685;
const LEAST_SCALE: f64 = 0.1;

/// A scale below which residuals are none, metres.
pub(super) fn least_scale(tolerance: f64) -> f64 {
    LEAST_SCALE * tolerance
}

/// Their standard deviation by the median of their sizes, metres. There must be one at least.
pub(super) fn scale(residuals: impl Iterator<Item = f64>, tolerance: f64) -> f64 {
    let mut sizes: Vec<f64> = residuals.map(f64::abs).collect();
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    (1.4826 * median).max(least_scale(tolerance))
}

/// Tukey's weight of a residual at this scale; `None` for an outlier.
pub(super) fn weight(residual: f64, scale: f64) -> Option<f64> {
    let x = residual / (TUKEY * scale);
    (x.abs() < 1.0).then(|| (1.0 - x * x).powi(2))
}
