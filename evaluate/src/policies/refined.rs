//! The volumetric planner with other forecasts than its own: with true ones, which bound what a better prediction could
//! win, and with learned ones.

use crate::learned::{Learned, features};
use datagen::episode::reference_surface;
use datagen::{Scene, SearchConfig, score_views};
use geometry::{Forecasts, Planner, RankedView, ScanState, View, VolumetricConfig, VolumetricPlanner};
use nalgebra::Point3;
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
    /// The true surface: a yardstick, no policy.
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
                let (current, scores) = score_views(scene, &self.reference, state, &views, search);
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

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        let mut forecasts = self.inner.forecast(state, rng);
        let others = self.others(state, &forecasts);
        for (f, (gain, overlap)) in forecasts.views.iter_mut().zip(others) {
            f.gain = if self.replaced.gain { gain } else { f.gain };
            f.overlap = if self.replaced.overlap { overlap } else { f.overlap };
        }
        self.inner.rank(&forecasts)
    }

    fn reset(&mut self) {
        self.inner.reset();
        self.reference.clear();
    }
}
