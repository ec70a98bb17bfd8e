//! The search on the 3D Repository objects, measured: `speed` (one core, CPU time) or `quality` (beside the
//! published code's figures). `ROOT` holds `<object>.obj` and the authors' surface samples `<object>_simple60k.npy`.
//!
//! ```text
//! cargo run --release -p datagen --example repository3d -- speed ROOT
//! cargo run --release -p datagen --example repository3d -- quality ROOT --reference reference_runs.md
//! ```

use anyhow::{Context, Result, ensure};
use clap::{Parser, Subcommand};
use cpu_time::ThreadTime;
use datagen::{Episode, EpisodeConfig, RenderScratch, Scene, SearchConfig, SearchPlanner, run_episode_with};
use geometry::{View, rng::stream};
use nalgebra::Point3;
use planning::CandidateConfig;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The six objects for which the published code's figures were recorded, and the seventh.
const OBJECTS: [&str; 7] = ["bunny", "horse", "armadillo", "teapot", "statue_of_liberty", "happyBuddha", "dragon"];
const RECORDED: usize = 6;
/// Seconds per object, mean of the six: the published code, and the same with its slowest loop vectorised, recorded
/// on a 2-vCPU AMD EPYC.
const PUBLISHED_SECONDS: f64 = 109.7;
const VECTORISED_SECONDS: f64 = 26.4;

#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// CPU seconds per object on one core, of 15 decisions with 20 candidates.
    Speed {
        /// Folder of the objects.
        root: PathBuf,
        /// Episodes per object.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// Also measure the throughput on two cores.
        #[arg(long)]
        two_cores: bool,
    },
    /// Final coverage, overlaps, views to 90 %, Chamfer and Hausdorff distance with the published settings.
    Quality {
        /// Folder of the objects.
        root: PathBuf,
        /// Episodes per object.
        #[arg(long, default_value_t = 20)]
        seeds: u64,
        /// Use the default settings instead of the published ones.
        #[arg(long)]
        default_settings: bool,
        /// Table of the published code's figures, rows `| BENBV object | runs | coverage | ... |`.
        #[arg(long)]
        reference: Option<PathBuf>,
    },
}

struct Object {
    name: &'static str,
    scene: Scene,
    samples: Vec<Point3<f64>>,
}

fn load(root: &Path) -> Result<Vec<Object>> {
    let object = |name: &'static str| -> Result<Object> {
        let mesh = formats::mesh::read_mesh(&root.join(format!("{name}.obj")))?;
        let cloud = formats::cloud::read_cloud(&root.join(format!("{name}_simple60k.npy")))?;
        Ok(Object { name, scene: Scene::new(mesh.normalized(0.2)), samples: cloud.cloud.points })
    };
    OBJECTS.iter().map(|name| object(name)).collect()
}

fn settings(paper: bool) -> (EpisodeConfig, SearchConfig) {
    let (episode, candidates) = if paper {
        (EpisodeConfig::paper(), CandidateConfig::paper())
    } else {
        (EpisodeConfig::default(), CandidateConfig::default())
    };
    let search = SearchConfig::of(&episode, candidates);
    (episode, search)
}

fn main() -> Result<()> {
    match Arguments::parse().command {
        Command::Speed { root, seeds, two_cores } => speed(&load(&root)?, seeds, two_cores),
        Command::Quality { root, seeds, default_settings, reference } => {
            let reference = reference.as_deref().map(recorded_figures).transpose()?;
            quality(&load(&root)?, seeds, !default_settings, reference.as_deref().unwrap_or(&[]));
            Ok(())
        }
    }
}

/// One episode; the views of all candidates are kept.
fn search(object: &Object, paper: bool, full_length: bool, seed: u64, views: &mut Vec<View>) -> Result<Episode> {
    let (mut episode, config) = settings(paper);
    episode.stop_at_full_coverage &= !full_length;
    let mut planner = SearchPlanner::new(&object.scene, &object.samples, config);
    let mut rng = stream(seed, &format!("repository3d/{}", object.name));
    run_episode_with(&object.scene, &object.samples, &mut planner, &episode, &mut rng, |planner, _| {
        views.extend(planner.last_decision().candidates.iter().map(|c| c.view));
    })
    .with_context(|| object.name)
}

fn field(file: &str, name: &str) -> String {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let line = text.lines().find(|l| l.starts_with(name)).and_then(|l| l.split_once(':'));
    line.map_or("unknown".into(), |(_, value)| value.trim().to_string())
}

fn speed(objects: &[Object], seeds: u64, two_cores: bool) -> Result<()> {
    // All of it on this thread, k-means included.
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    println!(
        "CPU: {}; {seeds} episodes per object; seconds per object of 15 decisions",
        field("/proc/cpuinfo", "model name")
    );
    for paper in [false, true] {
        let (name, objects) = if paper { ("published", &objects[..RECORDED]) } else { ("default", objects) };
        let mut totals = [0.0; 2];
        for object in objects {
            let (mut spent, mut rendering, mut decisions) = (0.0, 0.0, 0);
            let (_, config) = settings(paper);
            for seed in 0..seeds {
                let mut views = Vec::new();
                let before = ThreadTime::now();
                let episode = search(object, paper, true, seed, &mut views)?;
                let between = ThreadTime::now();
                let mut scratch = RenderScratch::default();
                let camera = geometry::PinholeCamera::default();
                for view in &views {
                    object.scene.render(&camera, &view.world_from_camera(), &config.render, &mut scratch);
                }
                spent += between.duration_since(before).as_secs_f64();
                rendering += between.elapsed().as_secs_f64();
                decisions += episode.overlaps.len();
            }
            let per_object = 15.0 / decisions as f64;
            println!(
                "{name:9} {:18} {:.3} s, rendering {:.0} %, {decisions} decisions",
                object.name,
                spent * per_object,
                100.0 * rendering / spent
            );
            totals = [totals[0] + spent * per_object, totals[1] + rendering * per_object];
        }
        let [mean, rendering] = totals.map(|t| t / objects.len() as f64);
        println!(
            "{name:9} mean of {} objects: {mean:.3} s, of which rendering {rendering:.3} s ({:.0} %)",
            objects.len(),
            100.0 * rendering / mean
        );
        if paper {
            println!(
                "{name:9} {:.0} times faster than published ({PUBLISHED_SECONDS} s, recorded), {:.0} times than \
                 vectorised ({VECTORISED_SECONDS} s, recorded)",
                PUBLISHED_SECONDS / mean,
                VECTORISED_SECONDS / mean
            );
        }
    }
    println!("peak memory: {} (all objects and their samples loaded)", field("/proc/self/status", "VmHWM"));
    if two_cores {
        let work: Vec<(usize, u64)> = (0..objects.len()).flat_map(|o| (0..seeds).map(move |s| (o, s))).collect();
        let wall = |threads: usize| -> Result<f64> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let clock = Instant::now();
            pool.install(|| {
                work.par_iter()
                    .try_for_each(|&(o, seed)| search(&objects[o], false, true, seed, &mut Vec::new()).map(drop))
            })?;
            Ok(clock.elapsed().as_secs_f64())
        };
        let [one, two] = [wall(1)?, wall(2)?];
        println!("two cores: {:.2} times the throughput of one ({one:.1} s, {two:.1} s wall)", one / two);
    }
    Ok(())
}

/// Figures of one object in the order of the table's columns.
struct Figures {
    name: String,
    runs: f64,
    /// Final coverage %, Chamfer mm, Hausdorff mm, views to 90 %, overlaps 1 to 3 %.
    values: [f64; 7],
}

const COLUMNS: [&str; 7] = ["coverage %", "CD mm", "HD mm", "v90", "overlap 1", "overlap 2", "overlap 3"];

fn recorded_figures(path: &Path) -> Result<Vec<Figures>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    let mut figures: Vec<Figures> = Vec::new();
    for line in text.lines() {
        let cells: Vec<&str> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
        let Some(name) = cells[0].strip_prefix("BENBV ").filter(|name| OBJECTS.contains(name)) else { continue };
        // The first table is the one of the published settings.
        if figures.iter().any(|f| f.name == name) {
            continue;
        }
        let number = |column: usize| -> Result<f64> {
            let cell = cells.get(column).and_then(|c| c.split_whitespace().next()).unwrap_or_default();
            cell.parse().with_context(|| format!("{}: row {name:?}, column {column}: {cell:?}", path.display()))
        };
        let values = [2, 5, 6, 11, 12, 13, 14].map(number);
        let values: Vec<f64> = values.into_iter().collect::<Result<_>>()?;
        figures.push(Figures { name: name.into(), runs: number(1)?, values: std::array::from_fn(|i| values[i]) });
    }
    ensure!(!figures.is_empty(), "{}: no row `| BENBV <object> | runs | ...`", path.display());
    Ok(figures)
}

/// Prints a table of means with standard errors; a recorded figure more than three standard errors (both sides' added,
/// the recorded runs taken to scatter as ours) away is marked.
fn quality(objects: &[Object], seeds: u64, paper: bool, reference: &[Figures]) {
    let never = if paper { 16 } else { 17 };
    println!(
        "{} settings, {seeds} episodes per object: mean +- standard error (recorded mean)",
        if paper { "published" } else { "default" }
    );
    println!("| object | {} | first scan % |", COLUMNS.join(" | "));
    println!("|---{}", "|---".repeat(COLUMNS.len() + 1) + "|");
    let mut outside = 0;
    for object in objects {
        let episodes: Vec<Result<Episode>> =
            (0..seeds).into_par_iter().map(|seed| search(object, paper, false, seed, &mut Vec::new())).collect();
        let rows: Vec<Vec<f64>> = episodes.iter().flatten().map(|e| row(e, never)).collect();
        let recorded = reference.iter().find(|f| f.name == object.name);
        let cells = (0..=COLUMNS.len()).map(|column| {
            let values: Vec<f64> = rows.iter().map(|r| r[column]).filter(|v| v.is_finite()).collect();
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let error = deviation / n.sqrt();
            let beside = match recorded.filter(|_| column < COLUMNS.len()) {
                Some(r) => {
                    let limit = 3.0 * (error + deviation / r.runs.sqrt());
                    let off = (mean - r.values[column]).abs();
                    outside += usize::from(off > limit);
                    format!(" ({}{})", r.values[column], if off > limit { " OUTSIDE" } else { "" })
                }
                None => String::new(),
            };
            format!("{mean:.3} +- {error:.3}{beside}")
        });
        println!("| {} | {} |", object.name, cells.collect::<Vec<_>>().join(" | "));
        for problem in episodes.iter().filter_map(|e| e.as_ref().err()) {
            println!("{problem:#}");
        }
    }
    if !reference.is_empty() {
        println!("{outside} of {} figures outside three standard errors", RECORDED * COLUMNS.len());
    }
}

fn row(episode: &Episode, never: usize) -> Vec<f64> {
    let overlap = |i: usize| episode.overlaps.get(i).copied().flatten().map_or(f64::NAN, |o| 100.0 * o);
    let distances = episode.distances;
    vec![
        100.0 * episode.final_coverage(),
        1e3 * distances.chamfer,
        1e3 * distances.hausdorff,
        episode.views_to(0.9).unwrap_or(never) as f64,
        overlap(0),
        overlap(1),
        overlap(2),
        100.0 * episode.coverages[0],
    ]
}
