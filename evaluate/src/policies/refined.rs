//! The volumetric planner with other forecasts than its own: with true ones, which bound what a better prediction could
//! win, and with learned ones.

use crate::learned::{Learned, features};
use datagen::{Scene, SearchConfig, score_views};
use geometry::View;
use nalgebra::Point3;
use planning::accumulate::reference_surface;
use planning::planner::checked;
use planning::{Forecasts, PlanError, Planner, RankedView, ScanState, VolumetricConfig, VolumetricPlanner};
use rand_chacha::ChaCha8Rng;

/// Which forecasts are replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replaced {
    /// The gain of a view.
    pub gain: bool,
    /// The overlap of a view.
    pub overlap: bool,
}

/// Where the other forecasts come from.
pub enum Source<'a> {
    /// The true surface: a reference, not a policy.
    Truth {
        /// The object.
        scene: &'a Scene,
        /// Its surface samples, not yet averaged.
        samples: &'a [Point3<f64>],
        /// How views are scored.
        search: SearchConfig,
    },
    /// A fit.
    Learned(Learned),
}

/// The volumetric planner with some of its forecasts replaced.
pub struct RefinedPlanner<'a> {
    name: String,
    inner: VolumetricPlanner,
    source: Source<'a>,
    replaced: Replaced,
    reference: Vec<Point3<f64>>,
}

impl<'a> RefinedPlanner<'a> {
    /// With these forecasts.
    pub fn new(name: &str, config: VolumetricConfig, source: Source<'a>, replaced: Replaced) -> Self {
        let inner = VolumetricPlanner::new(config);
        Self { name: name.to_owned(), inner, source, replaced, reference: Vec::new() }
    }

    /// Gain and overlap of every candidate from the source.
    fn others(&mut self, state: &ScanState, forecasts: &Forecasts) -> Vec<(f64, Option<f64>)> {
        match &self.source {
            Source::Truth { scene, samples, search } => {
                if self.reference.is_empty() {
                    self.reference = reference_surface(samples, state.grid_size, search.accumulate);
                }
                let views: Vec<View> = forecasts.views.iter().map(|f| f.view).collect();
                let (current, scores) = score_views(scene, &self.reference, state, &state.grid(), &views, search);
                scores.iter().map(|s| (s.coverage - current, s.overlap)).collect()
            }
            Source::Learned(learned) => {
                let predicted = features(state, forecasts).into_iter().map(|x| learned.predict(&x));
                predicted.zip(&forecasts.views).map(|((g, o), f)| (g, f.overlap.map(|_| o))).collect()
            }
        }
    }
}

impl Planner for RefinedPlanner<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let mut forecasts = self.inner.forecast(state, rng);
        let others = self.others(state, &forecasts);
        for (f, (gain, overlap)) in forecasts.views.iter_mut().zip(others) {
            (f.gain, f.reported_gain) = if self.replaced.gain { (gain, gain) } else { (f.gain, f.reported_gain) };
            f.overlap = if self.replaced.overlap { overlap } else { f.overlap };
            f.reported_overlap = if self.replaced.overlap { overlap } else { f.reported_overlap };
        }
        checked(&self.name, self.inner.rank(&forecasts), PlanError::NoBoundary)
    }

    fn reset(&mut self) {
        self.inner.reset();
        self.reference.clear();
    }
}

#[cfg(test)]
mod tests;
