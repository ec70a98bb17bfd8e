//! Learns the gain and the overlap of views from what the volumetric planner sees of them, on its own episodes with
//! procedural objects at 0.6, 1.2 and 2.0 m, and prints how well it predicts on every fifth object, which it does not
//! learn from, without some of the features too.
//!
//! `cargo run --release -p evaluate --example learn_forecasts -- --objects 90 --seed 2 --out forecasts.json`

use anyhow::Context;
use clap::Parser;
use datagen::{EpisodeConfig, Scene, SearchConfig, procedural, run_episode, score_views};
use evaluate::learned::{Decision, FEATURES, Labelled, Learned, features};
use geometry::View;
use geometry::rank_correlation::rank_correlation;
use geometry::rng::stream;
use geometry::sampling::sample_surface;
use nalgebra::Point3;
use planning::accumulate::reference_surface;
use planning::{CandidateConfig, PlanError, Planner, RankedView, ScanState, VolumetricPlanner};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::path::PathBuf;

#[derive(Parser)]
struct Args {
    /// Procedural objects; every fifth is kept for the printed figures.
    #[arg(long, default_value_t = 90)]
    objects: usize,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Relative strength of the ridge.
    #[arg(long, default_value_t = 1e-6)]
    ridge: f64,
    /// File for the coefficients.
    #[arg(long)]
    out: PathBuf,
}

const DISTANCES: [f64; 3] = [0.6, 1.2, 2.0];
/// Decisions of an episode by their number: first, then the views that complete the outline, then the late ones.
const PHASES: [(usize, usize); 4] = [(0, 1), (1, 3), (3, 6), (6, 15)];
/// Share of random choices on every second object, so that other states than the planner's own are seen.
const EXPLORE: f64 = 0.3;

struct Episode {
    object: usize,
    distance: f64,
    decisions: Vec<Decision>,
}

/// The volumetric planner, and what its candidates were true to bring.
struct Recorder<'a> {
    inner: VolumetricPlanner,
    scene: &'a Scene,
    samples: &'a [Point3<f64>],
    search: SearchConfig,
    reference: Vec<Point3<f64>>,
    explore: f64,
    decisions: Vec<Decision>,
}

impl Planner for Recorder<'_> {
    fn name(&self) -> &str {
        "recorder"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let forecasts = self.inner.forecast(state, rng);
        if self.reference.is_empty() {
            self.reference = reference_surface(self.samples, state.grid_size, self.search.accumulate);
        }
        let views: Vec<View> = forecasts.views.iter().map(|f| f.view).collect();
        let (current, scores) = score_views(self.scene, &self.reference, state, &state.grid(), &views, &self.search);
        let labelled = features(state, &forecasts).into_iter().zip(scores).map(|(features, s)| Labelled {
            features,
            gain: s.coverage - current,
            overlap: s.overlap.unwrap_or(0.0),
        });
        self.decisions.push(Decision(labelled.collect()));
        let mut ranked = self.inner.rank(&forecasts);
        if !ranked.is_empty() && rng.random_bool(self.explore) {
            let any = rng.random_range(0..ranked.len());
            ranked.swap(0, any);
        }
        Ok(ranked)
    }
}

fn episode(seed: u64, object: usize, distance: f64) -> Episode {
    let name = format!("forecasts/{object}");
    let scene = Scene::new(procedural::mesh(seed, object as u64).normalized(0.2));
    let samples = sample_surface(scene.mesh(), 60_000, &mut stream(seed, &format!("{name}/surface")));
    let config = EpisodeConfig { working_distance_m: distance, ..EpisodeConfig::default() };
    let mut recorder = Recorder {
        inner: VolumetricPlanner::default(),
        scene: &scene,
        samples: &samples,
        search: SearchConfig::of(&config, CandidateConfig::default()),
        reference: Vec::new(),
        explore: if object % 2 == 1 { EXPLORE } else { 0.0 },
        decisions: Vec::new(),
    };
    // An object that no first view sees has no decisions.
    let _ = run_episode(&scene, &samples, &mut recorder, &config, &mut stream(seed, &format!("{name}/{distance}")));
    Episode { object, distance, decisions: recorder.decisions }
}

/// Rank correlation with the true gain, share of the best gain that the first choice has, mean error of the overlap.
fn figures<'a>(decisions: impl Iterator<Item = &'a Decision>, predict: impl Fn(&Labelled) -> (f64, f64)) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0f64);
    for d in decisions.filter(|d| d.0.len() > 1) {
        let predicted: Vec<(f64, f64)> = d.0.iter().map(&predict).collect();
        let truth: Vec<f64> = d.0.iter().map(|r| r.gain).collect();
        let gains: Vec<f64> = predicted.iter().map(|p| p.0).collect();
        let best = truth.iter().copied().fold(1e-12, f64::max);
        let first = gains.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
        let errors = predicted.iter().zip(&d.0).map(|(p, r)| (p.1 - r.overlap).abs());
        sum[0] += rank_correlation(&gains, &truth).unwrap_or(0.0);
        sum[1] += truth[first] / best;
        sum[2] += errors.sum::<f64>() / truth.len() as f64;
        count += 1.0;
    }
    sum.map(|s| s / count.max(1.0))
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let jobs = (0..args.objects * DISTANCES.len()).into_par_iter().with_max_len(1);
    let episodes: Vec<Episode> =
        jobs.map(|j| episode(args.seed, j / DISTANCES.len(), DISTANCES[j % DISTANCES.len()])).collect();
    let kept = |e: &&Episode| e.object.is_multiple_of(5);
    let train: Vec<Decision> = episodes.iter().filter(|e| !kept(e)).flat_map(|e| e.decisions.clone()).collect();
    let fit = |without: &[usize]| {
        let used = std::array::from_fn::<bool, FEATURES, _>(|i| !without.contains(&i));
        Learned::fit(&train, args.ridge, &used)
            .context("too few decisions to fit the coefficients: give more --objects")
    };
    let all = fit(&[])?;
    let blind = [("situation", fit(&[8, 9, 10, 11])?), ("novelty", fit(&[7])?), ("hand-made", fit(&[5, 6])?)];
    std::fs::write(&args.out, serde_json::to_string(&all)?).with_context(|| format!("{:?}", args.out))?;
    println!("| m | decisions | forecasts | rank correlation | gain of the first / best | overlap error |");
    println!("|---|---|---|---:|---:|---:|");
    for distance in DISTANCES {
        for (from, to) in PHASES {
            let held = || {
                let held = episodes.iter().filter(kept).filter(move |e| e.distance == distance);
                held.flat_map(move |e| e.decisions.iter().skip(from).take(to - from))
            };
            let row = |name: &str, [rank, first, overlap]: [f64; 3]| {
                println!("| {distance} | {}-{to} | {name} | {rank:.2} | {first:.2} | {overlap:.3} |", from + 1);
            };
            row("hand-made", figures(held(), |r| (r.features[5], r.features[6])));
            row("learned", figures(held(), |r| all.predict(&r.features)));
            for (name, fit) in &blind {
                row(&format!("learned without {name}"), figures(held(), |r| fit.predict(&r.features)));
            }
        }
    }
    Ok(())
}
