//! Gain and overlap of a view learned from what the volumetric planner sees of it: ridge regression on its sums and their
//! products. The labels are the true gain and the true overlap, so that the score stays adjustable.

use nalgebra::{DMatrix, DVector};
use planning::{Forecasts, ScanState, ViewForecast};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What a forecast is made of: pixels by what they show (0 to 4), the hand-made gain (5) and overlap (6), novelty (7), and
/// what all candidates share: estimated coverage (8), reciprocal of the number of scans (9), pixel size at the working
/// distance over tolerance (10), spacing of the cloud over tolerance (11).
pub const FEATURES: usize = 12;

/// The features of every candidate, in their order.
pub fn features(state: &ScanState, forecasts: &Forecasts) -> Vec<[f64; FEATURES]> {
    let tolerance = state.tolerance.max(f64::MIN_POSITIVE);
    let pixel = state.camera.pixel_size(state.working_distance) / tolerance;
    let (scans, spacing) = (1.0 / state.num_scans.max(1) as f64, state.grid_size / tolerance);
    let of = |f: &ViewForecast| {
        let [hidden, expected, known, behind, covered] = f.pixels;
        let own = [hidden, expected, known, behind, covered, f.gain, f.overlap.unwrap_or(0.0), f.novelty];
        let mut x = [0.0; FEATURES];
        x[..8].copy_from_slice(&own);
        x[8..].copy_from_slice(&[forecasts.surface.covered(), scans, pixel, spacing]);
        x
    };
    forecasts.views.iter().map(of).collect()
}

/// 1, the features, and all their products.
fn terms(x: &[f64; FEATURES]) -> Vec<f64> {
    let mut out = vec![1.0];
    out.extend(x);
    out.extend((0..FEATURES).flat_map(|i| (i..FEATURES).map(move |j| (i, j))).map(|(i, j)| x[i] * x[j]));
    out
}

/// A candidate with what it was true to bring.
#[derive(Clone, Debug, PartialEq)]
pub struct Labelled {
    /// Its [`features`].
    pub features: [f64; FEATURES],
    /// True gain, as a share of the surface.
    pub gain: f64,
    /// True overlap.
    pub overlap: f64,
}

/// The candidates of a decision.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decision(pub Vec<Labelled>);

/// The two fits, as a JSON file keeps them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learned {
    /// Coefficient of every term for the gain.
    pub gain: Vec<f64>,
    /// The same for the overlap.
    pub overlap: Vec<f64>,
}

/// Why learned forecasts cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LearnedError {
    /// The settings name no file.
    #[error("make a file with the example learn_forecasts and give --set weights.forecasts=FILE")]
    NoFile,
    /// The operating system refuses.
    #[error("{path:?}: {cause}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Why not.
        cause: std::io::Error,
    },
    /// The file holds no such JSON.
    #[error("{path:?}: {cause}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        cause: serde_json::Error,
    },
    /// Coefficients of other features.
    #[error("{path:?}: {found} coefficients under {name:?}, expected {expected}")]
    Count {
        /// The file.
        path: PathBuf,
        /// Which fit.
        name: &'static str,
        /// Coefficients in the file.
        found: usize,
        /// Coefficients that there must be.
        expected: usize,
    },
}

impl Learned {
    /// Fits decisions. `ridge` is relative to the mean square of the terms, each brought to a root mean square of 1. The
    /// gains of a decision weigh by the inverse square of its largest, so that late decisions count. Only features that are
    /// `used` are looked at. `None` without candidates, or where the terms do not tell the coefficients.
    pub fn fit(decisions: &[Decision], ridge: f64, used: &[bool; FEATURES]) -> Option<Self> {
        let rows = || decisions.iter().flat_map(|d| &d.0);
        let masked = |x: &[f64; FEATURES]| {
            let mut x = *x;
            x.iter_mut().zip(used).filter(|(_, used)| !**used).for_each(|(x, _)| *x = 0.0);
            DVector::from_vec(terms(&x))
        };
        let n = terms(&[0.0; FEATURES]).len();
        let squares = rows().fold(DVector::zeros(n), |sum: DVector<f64>, r| sum + masked(&r.features).map(|t| t * t));
        let count = rows().count().max(1) as f64;
        let scale = squares.map(|s| if s > 0.0 { (count / s).sqrt() } else { 0.0 });
        let fit = |label: &dyn Fn(&Labelled) -> f64, weight: &dyn Fn(&Decision) -> f64| {
            let (mut normal, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
            for d in decisions {
                for r in &d.0 {
                    let t = masked(&r.features).component_mul(&scale);
                    normal.ger(weight(d), &t, &t, 1.0);
                    right.axpy(weight(d) * label(r), &t, 1.0);
                }
            }
            let mean = normal.trace() / n as f64;
            (0..n).for_each(|i| normal[(i, i)] += ridge * mean);
            Some(normal.cholesky()?.solve(&right).component_mul(&scale).as_slice().to_vec())
        };
        let largest = |d: &Decision| d.0.iter().map(|r| r.gain).fold(0.0, f64::max);
        let gain = fit(&|r| r.gain, &|d| (largest(d) + 0.01).powi(-2))?;
        Some(Self { gain, overlap: fit(&|r| r.overlap, &|_| 1.0)? })
    }

    /// From a JSON file.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn read(path: &Path) -> Result<Self, LearnedError> {
        if path.as_os_str().is_empty() {
            return Err(LearnedError::NoFile);
        }
        let path = || path.to_owned();
        let text =
            std::fs::read_to_string(path()).map_err(|source| LearnedError::Io { path: path(), cause: source })?;
        let learned: Self =
            serde_json::from_str(&text).map_err(|source| LearnedError::Json { path: path(), cause: source })?;
        let expected = terms(&[0.0; FEATURES]).len();
        for (name, found) in [("gain", learned.gain.len()), ("overlap", learned.overlap.len())] {
            if found != expected {
                return Err(LearnedError::Count { path: path(), name, found, expected });
            }
        }
        Ok(learned)
    }

    /// Gain and overlap of a candidate, each in [0, 1].
    pub fn predict(&self, x: &[f64; FEATURES]) -> (f64, f64) {
        let dot = |w: &[f64]| terms(x).iter().zip(w).map(|(t, w)| t * w).sum::<f64>().clamp(0.0, 1.0);
        (dot(&self.gain), dot(&self.overlap))
    }
}

#[cfg(test)]
mod tests;
