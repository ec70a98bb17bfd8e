//! What a session told on recorded sequences and what was true, step by step: the gain of the view taken, and the surface missing,
//! by scans before the decision. And what the gain consists of: of the surface that a view adds, the share that lies
//! within so many tolerances of the scans before, and how much of that beside rather than beyond their surface.
//!
//! ```text
//! cargo run --release -p datagen --example recorded_gains -- --root DIR --only bunny [--starts 4] [--tolerance-m 0.001] [--evidence depth]
//!     [--gain-only] [--planner farthest]
//! ```

use anyhow::{Context, Result};
use clap::Parser;
use datagen::{EpisodeConfig, EpisodeEvidence, Progress, Recording, Stage, run_session};
use formats::sequence::read_sequence;
use geometry::NeighborGrid;
use geometry::rng::stream;
use nalgebra::Point3;
use planning::{PlanError, PlannerName, RankedView, Session, SessionConfig};
use std::path::PathBuf;

/// The setting that ends a scan, and what may be missing then.
const STOP_BELOW: f64 = 0.02;
const ENOUGH: f64 = 0.04;

#[derive(Parser)]
struct Arguments {
    /// A folder of sequences.
    #[arg(long)]
    root: PathBuf,
    /// The sequence.
    #[arg(long)]
    only: String,
    /// Starts, spread evenly.
    #[arg(long, default_value_t = 4)]
    starts: usize,
    /// Decisions of each.
    #[arg(long, default_value_t = 12)]
    steps: usize,
    #[arg(long, default_value_t = 0.001)]
    tolerance_m: f64,
    /// depth-with-background, depth, camera-positions or clouds.
    #[arg(long, default_value = "camera-positions")]
    evidence: String,
    /// The view that is told to bring most is taken, whatever its overlap, instead of the first.
    #[arg(long)]
    gain_only: bool,
    /// The planner: auto or farthest.
    #[arg(long, default_value = "auto")]
    planner: String,
    /// Every candidate of every step.
    #[arg(long)]
    verbose: bool,
}

/// A decision.
struct Step {
    scans: usize,
    told: f64,
    truth: f64,
    most_told: f64,
    most_true: f64,
    /// What the session compares with `stop_below`.
    stop: f64,
    correlation: f64,
    missing: Option<([f64; 2], f64)>,
    missing_true: f64,
    out_of_reach: f64,
    /// Of the surface added, by distance to the scans before in tolerances: to 1.5, 2, 3, more.
    near: [f64; 4],
    /// Of that within 3, share whose distance is along the normal mostly.
    along: f64,
}

fn evidence(name: &str) -> Result<EpisodeEvidence> {
    Ok(match name {
        "depth-with-background" => EpisodeEvidence::DepthWithBackground,
        "depth" => EpisodeEvidence::Depth,
        "camera-positions" => EpisodeEvidence::CameraPositions,
        "clouds" => EpisodeEvidence::Clouds,
        _ => anyhow::bail!("--evidence {name}"),
    })
}

fn main() -> Result<()> {
    let args = Arguments::parse();
    let sequence = read_sequence(&args.root.join(&args.only).join("sequence.json")).context("a sequence")?;
    let recording = Recording::new(sequence, args.tolerance_m);
    let evidence = evidence(&args.evidence)?;
    anyhow::ensure!(recording.has(evidence), "{} has no scans of --evidence {}", args.only, args.evidence);
    println!(
        "{} {}: spread {:.2} mm, {} points",
        args.only,
        args.evidence,
        1e3 * recording.spread_m(),
        recording.reference().len()
    );
    let (mut steps, mut mean) = (Vec::new(), [0.0; 3]);
    for k in 0..args.starts {
        let start = k * recording.len() / args.starts;
        let views = follow(&recording, start, evidence, &args, &mut steps)?;
        (0..3).for_each(|i| mean[i] += views[i] / args.starts as f64);
    }
    println!("views to 80, 90, 95 %: {:.2} {:.2} {:.2}", mean[0], mean[1], mean[2]);
    report(&steps);
    Ok(())
}

fn follow(
    recording: &Recording,
    start: usize,
    evidence: EpisodeEvidence,
    args: &Arguments,
    steps: &mut Vec<Step>,
) -> Result<[f64; 3]> {
    let tolerance = recording.tolerance_m();
    let planner = match args.planner.as_str() {
        "auto" => PlannerName::Auto,
        "farthest" => PlannerName::Farthest,
        other => anyhow::bail!("--planner {other}: expected auto or farthest"),
    };
    let settings = SessionConfig { planner, tolerance_m: tolerance, ..recording.session_config(evidence) };
    let mut session = Session::new(settings, None)?;
    session.set_given_views(recording.poses());
    let stage = Stage::Recorded { recording, start, evidence: Some(evidence) };
    let config = EpisodeConfig {
        num_views: args.steps.min(recording.len() - 1),
        stop_at_full_coverage: true,
        ..Default::default()
    };
    let mut taken = vec![start];
    let decide = |session: &mut Session, progress: &Progress, _: &mut _| -> Result<Vec<RankedView>, PlanError> {
        let answer = session.next_view().map_err(|e| PlanError::failed("session", e.to_string()))?;
        let mut covered = vec![false; recording.reference().len()];
        taken.iter().flat_map(|&i| recording.covered_by(i)).for_each(|&i| covered[i as usize] = true);
        let all = covered.len() as f64;
        let gain =
            |scan: usize| recording.covered_by(scan).iter().filter(|&&i| !covered[i as usize]).count() as f64 / all;
        let mut left: Vec<_> =
            answer.candidates.iter().filter_map(|c| Some((c.given.filter(|i| !taken.contains(i))?, c))).collect();
        if args.gain_only {
            left.sort_by(|(_, a), (_, b)| b.expected_gain.unwrap_or(0.0).total_cmp(&a.expected_gain.unwrap_or(0.0)));
        }
        let Some((next, first)) = left.first() else { return Ok(Vec::new()) };
        let new: Vec<Point3<f64>> = recording
            .covered_by(*next)
            .iter()
            .filter(|&&i| !covered[i as usize])
            .map(|&i| recording.reference()[i as usize])
            .collect();
        let known: Vec<Point3<f64>> = taken.iter().flat_map(|&i| recording.points(i).iter().copied()).collect();
        let grid = NeighborGrid::new(&known, 2.0 * tolerance);
        let cloud = session.cloud();
        let normals = NeighborGrid::new(&cloud.points, 3.0 * tolerance);
        let (mut near, mut along) = ([0f64; 4], [0f64; 2]);
        for p in &new {
            let distance =
                grid.nearest_within(p, 3.0 * tolerance).map(|n| (f64::from(n.distance2).sqrt() / tolerance, n.index));
            let bin = match distance {
                Some((d, _)) if d < 1.5 => 0,
                Some((d, _)) if d < 2.0 => 1,
                Some(_) => 2,
                None => 3,
            };
            near[bin] += 1.0 / new.len() as f64;
            if let (Some((d, i)), Some(n)) = (distance, normals.nearest_within(p, 6.0 * tolerance)) {
                let normal = cloud.normals[n.index].normalize();
                along[0] += 1.0;
                along[1] += f64::from(u8::from((p - known[i]).dot(&normal).abs() > 0.7 * d * tolerance));
            }
        }
        let told: Vec<f64> = left.iter().map(|(_, c)| c.expected_gain.unwrap_or(0.0)).collect();
        let truth: Vec<f64> = left.iter().map(|(i, _)| gain(*i)).collect();
        let missing = answer.missing.as_ref();
        let step = Step {
            scans: taken.len(),
            told: first.expected_gain.unwrap_or(0.0),
            truth: gain(*next),
            most_told: told.iter().copied().fold(0.0, f64::max),
            stop: answer.stop.compared().unwrap_or(f64::NAN),
            most_true: truth.iter().copied().fold(0.0, f64::max),
            correlation: geometry::rank_correlation::rank_correlation(&told, &truth).unwrap_or(f64::NAN),
            missing: missing.map(|m| (m.between, m.share)),
            out_of_reach: missing.map_or(0.0, |m| m.out_of_reach_share),
            missing_true: 1.0 - progress.coverage,
            near,
            along: along[1] / f64::max(along[0], 1.0),
        };
        if args.verbose {
            let answered = answer.surface;
            println!(
                "{taken:?}: known {:.1} cm2 expected {:.1} cm2",
                1e4 * answered.map_or(0.0, |s| s.known_m2),
                1e4 * answered.map_or(0.0, |s| s.expected_m2)
            );
            for ((i, c), t) in left.iter().zip(&truth) {
                println!(
                    "    {i}: score {:.3} told {:.4} true {t:.4} overlap {:.2}",
                    c.score,
                    c.expected_gain.unwrap_or(f64::NAN),
                    c.expected_overlap.unwrap_or(f64::NAN)
                );
            }
            print(&step.scans.to_string(), &[&step]);
        }
        steps.push(step);
        taken.push(*next);
        Ok(vec![RankedView::scored(recording.views()[*next], 1.0)])
    };
    let (episode, _) = run_session(stage, session, &config, &mut stream(0, "recorded"), decide)?;
    Ok([0.8, 0.9, 0.95].map(|level| episode.views_to(level).map_or(f64::NAN, |views| views as f64)))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn print(name: &str, steps: &[&Step]) {
    let of = |value: &dyn Fn(&Step) -> f64| median(steps.iter().map(|s| value(s)).collect());
    let ratios: Vec<&&Step> = steps.iter().filter(|s| s.truth >= 0.01).collect();
    let within = ratios.iter().filter(|s| (0.5..=2.0).contains(&(s.told / s.truth))).count();
    let inside =
        steps.iter().filter(|s| s.missing.is_some_and(|([l, h], _)| (l..=h).contains(&s.missing_true))).count();
    println!(
        "{name:>4} | {:.3} {:.3} ratio {:.2} ({within} of {}) | most {:.3} {:.3} | rank {:.2} | missing {:.3} [{:.3} {:.3}] beyond {:.3} true {:.3} in {inside} of {} | new to 1.5 {:.2} 2 {:.2} 3 {:.2} more {:.2}, along {:.2}",
        of(&|s| s.told),
        of(&|s| s.truth),
        median(ratios.iter().map(|s| s.told / s.truth).collect()),
        ratios.len(),
        of(&|s| s.most_told),
        of(&|s| s.most_true),
        of(&|s| s.correlation),
        of(&|s| s.missing.map_or(f64::NAN, |m| m.1)),
        of(&|s| s.missing.map_or(f64::NAN, |m| m.0[0])),
        of(&|s| s.missing.map_or(f64::NAN, |m| m.0[1])),
        of(&|s| s.out_of_reach),
        of(&|s| s.missing_true),
        steps.len(),
        of(&|s| s.near[0]),
        of(&|s| s.near[1]),
        of(&|s| s.near[2]),
        of(&|s| s.near[3]),
        of(&|s| s.along),
    );
}

fn report(steps: &[Step]) {
    let most = steps.iter().map(|s| s.scans).max().unwrap_or(0);
    for scans in 1..=most {
        let of: Vec<&Step> = steps.iter().filter(|s| s.scans == scans).collect();
        print(&scans.to_string(), &of);
    }
    print("all", &steps.iter().collect::<Vec<_>>());
    let starts: Vec<&[Step]> = steps.chunk_by(|a, b| b.scans > a.scans).collect();
    let enough =
        |s: &&[Step]| s.iter().find(|step| step.missing_true < ENOUGH).map_or(f64::NAN, |step| step.scans as f64);
    let stop = |name: &str, most: &dyn Fn(&Step) -> f64| {
        let stops: Vec<&Step> = starts.iter().filter_map(|s| s.iter().find(|step| most(step) < STOP_BELOW)).collect();
        println!(
            "{name} below {STOP_BELOW}: {} of {} stop, after {:?} scans, {:.3} missing in the median, {:.3} at most, less than {ENOUGH} for {}",
            stops.len(),
            starts.len(),
            stops.iter().map(|s| s.scans).collect::<Vec<_>>(),
            median(stops.iter().map(|s| s.missing_true).collect()),
            stops.iter().map(|s| s.missing_true).fold(0.0, f64::max),
            stops.iter().filter(|s| s.missing_true < ENOUGH).count(),
        );
    };
    stop("expected", &|s| s.stop);
    stop("predicted", &|s| s.most_told);
    stop("true", &|s| s.most_true);
    println!("less than {ENOUGH} missing after {:?}", starts.iter().map(enough).collect::<Vec<_>>());
}
