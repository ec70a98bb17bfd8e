//! Closed-loop episodes on held-out objects: whether what is learnt leads to better scans.

use crate::config::EpisodesConfig;
use crate::task::Episodes;
use datagen::{EpisodeConfig, Scene, procedural, run_episode};
use geometry::rng::stream;
use geometry::sampling::sample_surface;
use planning::Planner;
use rayon::prelude::*;

/// Family of the objects, apart from those that data sets are made of: a data set's seed is its user's, this one is
/// nobody's.
const FAMILY: u64 = 0x76a1_1da7_e0b7_ec75;
/// Surface samples per object.
const SURFACE: usize = 60_000;
/// Diagonal of an object, metres (docs/method.md, 'Setting').
const DIAGONAL: f64 = 0.2;

/// An episode on each of the same procedural objects; every planner starts from the same views. Void episodes do not
/// count. A level that is not reached counts one view more than an episode has.
pub fn run<P: Planner>(config: &EpisodesConfig, planner: impl Fn() -> P + Sync) -> Episodes {
    let settings = EpisodeConfig { num_views: config.views, ..Default::default() };
    let outcomes: Vec<(f64, usize)> = (0..config.objects as u64)
        .into_par_iter()
        .filter_map(|i| {
            let scene = Scene::new(procedural::mesh(FAMILY, i).normalized(DIAGONAL));
            let surface = sample_surface(scene.mesh(), SURFACE, &mut stream(FAMILY, &format!("episodes/{i}/surface")));
            let mut rng = stream(FAMILY, &format!("episodes/{i}"));
            let episode = run_episode(&scene, &surface, &mut planner(), &settings, &mut rng).ok()?;
            Some((episode.final_coverage(), episode.views_to(0.9).unwrap_or(config.views + 2)))
        })
        .collect();
    let n = outcomes.len().max(1) as f64;
    Episodes {
        count: outcomes.len(),
        coverage: outcomes.iter().map(|o| o.0).sum::<f64>() / n,
        views_to_90: outcomes.iter().map(|o| o.1 as f64).sum::<f64>() / n,
    }
}
