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

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let mut forecasts = self.inner.forecast(state, rng);
        let others = self.others(state, &forecasts);
        for (f, (gain, overlap)) in forecasts.views.iter_mut().zip(others) {
            (f.gain, f.told_gain) = if self.replaced.gain { (gain, gain) } else { (f.gain, f.told_gain) };
            f.overlap = if self.replaced.overlap { overlap } else { f.overlap };
            f.told_overlap = if self.replaced.overlap { overlap } else { f.told_overlap };
        }
        checked(&self.name, self.inner.rank(&forecasts), PlanError::NoBoundary)
    }

    fn reset(&mut self) {
        self.inner.reset();
        self.reference.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learned::{Decision, FEATURES, Labelled};
    use datagen::{EpisodeConfig, procedural, run_episode};
    use geometry::rng::stream;
    use geometry::sampling::sample_surface;
    use planning::CandidateConfig;

    /// Runs two decisions with the inner planner's own choice and hands the state of the second to `look`.
    struct Probe<F: FnMut(&ScanState)>(VolumetricPlanner, F);

    impl<F: FnMut(&ScanState)> Planner for Probe<F> {
        fn name(&self) -> &str {
            "probe"
        }

        fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
            (self.1)(state);
            self.0.rank_views(state, rng)
        }
    }

    #[test]
    fn only_what_is_replaced_changes_and_it_is_the_truth() {
        let scene = Scene::new(procedural::mesh(3, 1).normalized(0.2));
        let samples = sample_surface(scene.mesh(), 8000, &mut stream(3, "test/refined"));
        let config = EpisodeConfig { num_views: 2, ..EpisodeConfig::default() };
        let search = || SearchConfig::of(&config, CandidateConfig::default());
        let truth = || Source::Truth { scene: &scene, samples: &samples, search: search() };
        let same = [Labelled { features: [0.5; FEATURES], gain: 0.25, overlap: 0.5 }; 1];
        let constant = Learned::fit(&[Decision(same.to_vec())], 1e-6, &[true; FEATURES]).expect("a fit");
        let mut looked = 0;
        let look = |state: &ScanState| {
            let rank = |source, gain, overlap| {
                let replaced = Replaced { gain, overlap };
                let mut planner = RefinedPlanner::new("test", VolumetricConfig::default(), source, replaced);
                planner.rank_views(state, &mut stream(1, "test/refined/rank")).expect("views")
            };
            let own =
                VolumetricPlanner::default().rank_views(state, &mut stream(1, "test/refined/rank")).expect("views");
            assert_eq!(rank(truth(), false, false), own, "nothing replaced");
            assert_ne!(rank(Source::Learned(constant.clone()), true, true), own);
            let refined = rank(truth(), true, true);
            let reference = reference_surface(&samples, state.grid_size, search().accumulate);
            let views: Vec<View> = refined.iter().map(|r| r.view).collect();
            let (current, scores) = score_views(&scene, &reference, state, &views, &search());
            for (r, s) in refined.iter().zip(scores) {
                assert_eq!((r.gain, r.overlap), (Some(s.coverage - current), s.overlap));
            }
            looked += 1;
        };
        run_episode(&scene, &samples, &mut Probe(VolumetricPlanner::default(), look), &config, &mut stream(1, "t"))
            .expect("an episode");
        assert_eq!(looked, 2);
    }
}
