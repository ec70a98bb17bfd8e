//! The volumetric planner, measured: processor time per decision, what it predicts beside what a scan would bring, and
//! the same episodes by the search that knows the object.
//!
//! ```text
//! cargo run --release -p datagen --example volumetric -- speed
//! cargo run --release -p datagen --example volumetric -- beside-search bunny.obj --episodes 6
//! cargo run --release -p datagen --example volumetric -- prediction --objects 8 --set weight_center=0.5
//! cargo run --release -p datagen --example volumetric -- prediction bunny.obj horse.obj --evidence points
//! ```

use anyhow::{Context, Result, ensure};
use clap::{Parser, ValueEnum};
use cpu_time::ThreadTime;
use datagen::{
    Decision, Episode, EpisodeConfig, RenderConfig, Scene, SearchConfig, SearchPlanner, run_episode, run_episode_with,
    score_views,
};
use geometry::rank_correlation::rank_correlation;
use geometry::rng::stream;
use geometry::sampling::poisson_disk_sample;
use geometry::{
    CandidateConfig, Mesh, Misses, PastScan, Planner, RankedView, ScanState, Seen, VolumetricConfig, VolumetricPlanner,
};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::path::PathBuf;

#[derive(Parser)]
struct Arguments {
    /// `speed`: no truth is computed; `prediction`: with the true gain and overlap of all candidates;
    /// `beside-search`: each episode also by the search with 20 candidates, from the same first view.
    mode: Mode,
    /// Mesh files; without any, procedural objects.
    meshes: Vec<PathBuf>,
    /// Number of procedural objects.
    #[arg(long, default_value_t = 6)]
    objects: u64,
    /// Episodes per object.
    #[arg(long, default_value_t = 1)]
    episodes: u64,
    /// Working distance, metres.
    #[arg(long, default_value_t = 1.2)]
    distance: f64,
    /// Standard deviation of depth at 1.2 m, metres; 0: none.
    #[arg(long, default_value_t = 0.0)]
    noise: f64,
    /// What the planner is told of past scans.
    #[arg(long, default_value = "free")]
    evidence: Evidence,
    /// Settings of the planner, TOML.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Mode {
    Speed,
    Prediction,
    BesideSearch,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum Evidence {
    /// Depth images whose misses are free space.
    Free,
    /// Depth images whose misses mean nothing.
    Unknown,
    /// Points and camera positions.
    Points,
}

/// The planner, told less than there is, and timed.
struct Told {
    inner: VolumetricPlanner,
    evidence: Evidence,
    seconds: Vec<f64>,
    memory: usize,
}

impl Planner for Told {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        let mut state = state.clone();
        for scan in &mut state.scans {
            self.evidence.weaken(scan);
        }
        let start = ThreadTime::now();
        let ranked = self.inner.rank_views(&state, rng);
        self.seconds.push(start.elapsed().as_secs_f64());
        self.memory = self.memory.max(self.inner.memory());
        ranked
    }

    fn reset(&mut self) {
        self.inner.reset();
    }
}

impl Evidence {
    fn weaken(self, scan: &mut PastScan) {
        let Seen::Depth { camera, depth, misses } = &mut scan.seen else { return };
        match self {
            Evidence::Free => {}
            Evidence::Unknown => *misses = Misses::Unknown,
            Evidence::Points => {
                let points = depth.to_points(camera, &scan.world_from_camera);
                scan.seen = Seen::Points(points);
            }
        }
    }
}

/// A decision's candidates, predicted and true.
#[derive(Clone, Default)]
struct Compared {
    view: usize,
    coverage: [f64; 2],
    gains: Vec<[f64; 2]>,
    overlaps: Vec<[f64; 2]>,
    chosen_overlap: Option<[f64; 2]>,
    /// True gain of the candidate of the largest predicted one over the largest.
    regret: Option<f64>,
}

struct Outcome {
    name: String,
    episode: Episode,
    search: Option<Episode>,
    compared: Vec<Compared>,
    seconds: Vec<f64>,
    memory: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut settings = toml::Table::try_from(VolumetricConfig::default())?;
    for set in &arguments.set {
        let table: toml::Table = set.parse().with_context(|| format!("--set {set}"))?;
        settings.extend(table);
    }
    let config: VolumetricConfig = settings.try_into().context("--set")?;
    let objects: Vec<(String, Mesh)> = match &arguments.meshes[..] {
        [] => {
            (0..arguments.objects).map(|i| (format!("procedural {i}"), datagen::procedural::mesh(0x5eed, i))).collect()
        }
        files => files
            .iter()
            .map(|f| {
                Ok((f.file_stem().unwrap_or_default().to_string_lossy().into_owned(), formats::mesh::read_mesh(f)?))
            })
            .collect::<Result<_>>()?,
    };
    let jobs: Vec<(&(String, Mesh), u64)> =
        objects.iter().flat_map(|object| (0..arguments.episodes).map(move |e| (object, e))).collect();
    let outcomes: Vec<Outcome> = jobs
        .into_par_iter()
        .map(|((name, mesh), number)| run(name, mesh, number, &arguments, &config))
        .collect::<Result<_>>()?;
    report(&outcomes);
    Ok(())
}

fn run(name: &str, mesh: &Mesh, number: u64, arguments: &Arguments, config: &VolumetricConfig) -> Result<Outcome> {
    let mesh = mesh.normalized(0.2);
    let samples = poisson_disk_sample(&mesh, 60_000, &mut stream(0, &format!("surface/{name}")));
    ensure!(!samples.is_empty(), "{name}: the mesh has no surface");
    let scene = Scene::new(mesh);
    let noise = (arguments.noise > 0.0).then(|| datagen::NoiseConfig::axial(arguments.noise));
    let episode_config = EpisodeConfig {
        working_distance_m: arguments.distance,
        render: RenderConfig { noise, ..RenderConfig::default() },
        ..EpisodeConfig::default()
    };
    let search = SearchConfig::of(&episode_config, CandidateConfig::default());
    let mut planner = Told {
        inner: VolumetricPlanner::new(config.clone()),
        evidence: arguments.evidence,
        seconds: Vec::new(),
        memory: 0,
    };
    let mut compared = Vec::new();
    let rng = || stream(0, &format!("episode/{name}/{number}"));
    let episode = run_episode_with(&scene, &samples, &mut planner, &episode_config, &mut rng(), |planner, decision| {
        if arguments.mode == Mode::Prediction {
            compared.push(compare(&scene, planner.inner.coverage(), decision, &search));
        }
    })
    .with_context(|| name.to_owned())?;
    let search = (arguments.mode == Mode::BesideSearch)
        .then(|| {
            let mut planner = SearchPlanner::new(&scene, &samples, search);
            run_episode(&scene, &samples, &mut planner, &episode_config, &mut rng())
        })
        .transpose()
        .with_context(|| name.to_owned())?;
    Ok(Outcome { name: name.to_owned(), episode, search, compared, seconds: planner.seconds, memory: planner.memory })
}

fn compare(scene: &Scene, coverage: f64, decision: &Decision, search: &SearchConfig) -> Compared {
    let views: Vec<_> = decision.ranked.iter().map(|r| r.view).collect();
    let (current, scores) = score_views(scene, decision.reference, decision.state, &views, search);
    let pairs = || decision.ranked.iter().zip(&scores);
    let gains: Vec<[f64; 2]> = pairs().filter_map(|(r, s)| Some([r.gain?, s.coverage - current])).collect();
    let best = gains.iter().map(|g| g[1]).fold(0.0, f64::max);
    let taken = gains.iter().max_by(|a, b| a[0].total_cmp(&b[0])).map(|g| g[1]);
    Compared {
        view: decision.index + 1,
        coverage: [coverage, current],
        overlaps: pairs().filter_map(|(r, s)| Some([r.overlap?, s.overlap?])).collect(),
        chosen_overlap: pairs().next().and_then(|(r, s)| Some([r.overlap?, s.overlap?])),
        regret: taken.filter(|_| best > 0.0).map(|t| t / best),
        gains,
    }
}

fn report(outcomes: &[Outcome]) {
    for o in outcomes {
        let v90 = o.episode.views_to(0.9).map_or("-".to_owned(), |v| v.to_string());
        let overlaps: Vec<_> =
            o.episode.overlaps.iter().take(3).map(|o| format!("{:.0}", 100.0 * o.unwrap_or(0.0))).collect();
        println!(
            "{:24} v90 {v90:>2}  final {:.2}  overlaps {}",
            o.name,
            100.0 * o.episode.final_coverage(),
            overlaps.join(" ")
        );
    }
    let own = summary("volumetric", &outcomes.iter().map(|o| &o.episode).collect::<Vec<_>>());
    let searched: Vec<&Episode> = outcomes.iter().filter_map(|o| o.search.as_ref()).collect();
    if !searched.is_empty() {
        println!("ratio of the efficiencies {:.3}", own / summary("search", &searched));
    }
    println!(
        "\nview  CPU ms | coverage: estimated, true | gain: rank correlation, of the best, predicted, true | overlap: predicted, true, error | of the chosen"
    );
    let last = outcomes.iter().map(|o| o.seconds.len()).max().unwrap_or(0);
    for view in 1..=last {
        let times: Vec<f64> = outcomes.iter().filter_map(|o| o.seconds.get(view - 1)).map(|s| 1e3 * s).collect();
        print!("{view:4} {:7.1}", average(&times));
        let at: Vec<&Compared> = outcomes.iter().flat_map(|o| &o.compared).filter(|c| c.view == view).collect();
        if !at.is_empty() {
            let of = |value: &dyn Fn(&Compared) -> Option<f64>| {
                average(&at.iter().filter_map(|c| value(c)).collect::<Vec<_>>())
            };
            let side = |pairs: &[[f64; 2]], k: usize| {
                (!pairs.is_empty()).then(|| average(&pairs.iter().map(|p| p[k]).collect::<Vec<_>>()))
            };
            let error = |pairs: &[[f64; 2]]| {
                (!pairs.is_empty()).then(|| average(&pairs.iter().map(|p| (p[0] - p[1]).abs()).collect::<Vec<_>>()))
            };
            print!(
                " | {:5.3} {:5.3} | {:5.2} {:5.2} {:7.4} {:7.4} | {:5.3} {:5.3} {:5.3} | {:5.3} {:5.3}",
                of(&|c| Some(c.coverage[0])),
                of(&|c| Some(c.coverage[1])),
                of(&|c| {
                    let side = |k: usize| c.gains.iter().map(|pair| pair[k]).collect::<Vec<_>>();
                    rank_correlation(&side(0), &side(1))
                }),
                of(&|c| c.regret),
                of(&|c| side(&c.gains, 0)),
                of(&|c| side(&c.gains, 1)),
                of(&|c| side(&c.overlaps, 0)),
                of(&|c| side(&c.overlaps, 1)),
                of(&|c| error(&c.overlaps)),
                of(&|c| c.chosen_overlap.map(|o| o[0])),
                of(&|c| c.chosen_overlap.map(|o| o[1])),
            );
        }
        println!();
    }
    let all: Vec<f64> = outcomes.iter().flat_map(|o| &o.seconds).map(|s| 1e3 * s).collect();
    let memory = outcomes.iter().map(|o| o.memory).max().unwrap_or(0) as f64 / 1e6;
    println!("\nCPU ms per decision: {:.1}; most memory of a planner {memory:.0} MB", average(&all));
}

/// Prints the means over the episodes; returns the efficiency.
fn summary(policy: &str, episodes: &[&Episode]) -> f64 {
    let mean = |of: &dyn Fn(&Episode) -> f64| average(&episodes.iter().map(|e| of(e)).collect::<Vec<_>>());
    let views = |level: f64| mean(&|e| e.views_to(level).unwrap_or(17) as f64);
    let overlap = |i: usize| 100.0 * mean(&|e| e.overlaps.get(i).copied().flatten().unwrap_or(0.0));
    let covered = 100.0 * mean(&Episode::final_coverage);
    let efficiency = covered / views(0.9);
    println!(
        "\n{policy}, {} episodes: final {covered:.2} %  v50 {:.2}  v80 {:.2}  v90 {:.2}  efficiency {efficiency:.2}  overlaps {:.0} {:.0} {:.0}  cv3 {:.1}",
        episodes.len(),
        views(0.5),
        views(0.8),
        views(0.9),
        overlap(0),
        overlap(1),
        overlap(2),
        mean(&cv3),
    );
    efficiency
}

fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation over mean of the first three overlaps, percent.
fn cv3(episode: &Episode) -> f64 {
    let first: Vec<f64> = episode.overlaps.iter().take(3).map(|o| o.unwrap_or(0.0)).collect();
    let mean = average(&first);
    let variance = average(&first.iter().map(|o| (o - mean).powi(2)).collect::<Vec<_>>());
    if mean > 0.0 { 100.0 * variance.sqrt() / mean } else { 0.0 }
}
