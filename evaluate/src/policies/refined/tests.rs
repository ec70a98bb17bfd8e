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
        let own = VolumetricPlanner::default().rank_views(state, &mut stream(1, "test/refined/rank")).expect("views");
        assert_eq!(rank(truth(), false, false), own, "nothing replaced");
        assert_ne!(rank(Source::Learned(constant.clone()), true, true), own);
        let refined = rank(truth(), true, true);
        let reference = reference_surface(&samples, state.grid_size, search().accumulate);
        let views: Vec<View> = refined.iter().map(|r| r.view).collect();
        let (current, scores) = score_views(&scene, &reference, state, &state.grid(), &views, &search());
        for (r, s) in refined.iter().zip(scores) {
            assert_eq!((r.gain, r.overlap), (Some(s.coverage - current), s.overlap));
        }
        looked += 1;
    };
    run_episode(&scene, &samples, &mut Probe(VolumetricPlanner::default(), look), &config, &mut stream(1, "t"))
        .expect("an episode");
    assert_eq!(looked, 2);
}
