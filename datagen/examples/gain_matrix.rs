//! What a view was told to bring, and what it brings: working distance x points kept x camera x evidence. The first scan of
//! each object goes to a session as a robot's would; the surface that a view shows is counted by samples of the mesh that
//! its depth image holds. Per cell: the gain told of the first choice over the true one (median over the objects, and the
//! share within 0.67 to 1.5), the rank correlation of both over the candidates, the overlap told and true, the largest
//! score. At the end the surface that was told to be missing, and what was. With `--stop-below` instead: when a run ends by it.
//! Meshes that are no closed surface are left out.
//!
//! ```text
//! cargo run --release -p datagen --example gain_matrix -- [--root DIR] [--objects 8] [--scans 1] [--stop-below 0.02]
//! ```

use anyhow::Result;
use clap::Parser;
use datagen::dataset::{DatasetConfig, DatasetName, list_objects, load_mesh};
use datagen::{EpisodeConfig, RenderConfig, RenderScratch, Scene};
use geometry::rank_correlation::rank_correlation;
use geometry::rng::stream;
use geometry::sampling::sample_surface;
use geometry::{Mesh, PinholeCamera, PointCloud, View};
use nalgebra::{Point3, Vector3};
use parry3d::shape::TriMesh;
use planning::config::CameraConfig;
use planning::{NoReturn, Scan, Session, SessionConfig};
use rays::{seen, surface};

#[path = "../tests/rays/mod.rs"]
#[allow(dead_code)] // Tests use more of it.
mod rays;

#[derive(Parser)]
struct Arguments {
    /// Meshes; procedural objects without it.
    #[arg(long)]
    root: Option<std::path::PathBuf>,
    /// How many.
    #[arg(long, default_value_t = 8)]
    objects: usize,
    /// Scans before the decision: the first from above, the others where the planner said.
    #[arg(long, default_value_t = 1)]
    scans: usize,
    /// Follows each run, at most fifteen scans, until no view is expected to add that share of the surface.
    #[arg(long)]
    stop_below: Option<f64>,
}

#[derive(Clone, Copy, PartialEq)]
enum Given {
    Background,
    Depth,
    Positions,
    Clouds,
}

impl Given {
    const ALL: [Self; 4] = [Self::Background, Self::Depth, Self::Positions, Self::Clouds];

    fn name(self) -> &'static str {
        match self {
            Self::Background => "depth with background",
            Self::Depth => "depth",
            Self::Positions => "camera positions",
            Self::Clouds => "clouds",
        }
    }
}

/// An object with samples of its surface, by area.
struct Object {
    scene: Scene,
    /// The same for rays.
    surface: TriMesh,
    samples: Vec<Point3<f64>>,
    name: String,
}

/// The outcome of one decision.
struct Outcome {
    told: f64,
    truth: f64,
    correlation: f64,
    overlap: [f64; 2],
    score: f64,
    missing: Told,
}

/// A mesh that lacks more than this is no object: what scans expect on its other side is not there to be seen.
const OPEN: f64 = 0.1;

/// The least area that would close a mesh, as a share of its own: the area vectors of a closed surface sum to zero.
fn open_share(mesh: &Mesh) -> f64 {
    let vector = |t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*t);
        0.5 * (b - a).cross(&(c - a))
    };
    mesh.triangles.iter().map(vector).sum::<Vector3<f64>>().norm() / mesh.area()
}

/// The missing share as told, between which, and in truth.
type Told = (f64, [f64; 2], f64);

fn main() -> Result<()> {
    let args = Arguments::parse();
    let name = if args.root.is_some() { DatasetName::Folder } else { DatasetName::Procedural };
    let config = DatasetConfig { name, root: args.root, objects: Some(args.objects), ..Default::default() };
    let mut objects = Vec::new();
    for object in list_objects(&config, 0, 0.0)? {
        let mesh = load_mesh(&object)?.normalized(0.2);
        let open = open_share(&mesh);
        if open > OPEN {
            eprintln!(
                "{} is left out: the sides that its mesh lacks are {:.0} % of its area",
                object.name,
                100.0 * open
            );
            continue;
        }
        let samples = sample_surface(&mesh, 10_000, &mut stream(1, &object.name));
        objects.push(Object { surface: surface(&mesh), scene: Scene::new(mesh), samples, name: object.name });
    }
    if let Some(below) = args.stop_below {
        return stops(&objects, below);
    }
    println!(
        "| distance m | points kept | camera | evidence | told / true | within | rank | overlap told | true | score |"
    );
    println!("| ---: | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    let default = (1.2, 10_000, (1280, 720, 70.0), Given::Background);
    let mut cells = vec![default];
    cells.extend([0.2, 0.3, 0.6, 0.9, 2.0, 3.0].map(|distance| (distance, default.1, default.2, default.3)));
    cells.extend([1_000, 3_000, 100_000].map(|kept| (0.4, kept, default.2, default.3)));
    cells.extend([1_000, 3_000, 100_000].map(|kept| (0.4, kept, default.2, Given::Positions)));
    cells.extend(
        [(320, 240, 50.0), (640, 480, 50.0), (4000, 3000, 50.0)].map(|camera| (0.6, default.1, camera, default.3)),
    );
    cells.extend([Given::Depth, Given::Positions, Given::Clouds].map(|given| (1.2, default.1, default.2, given)));
    cells.extend([Given::Depth, Given::Positions, Given::Clouds].map(|given| (0.5, default.1, default.2, given)));
    let (mut good, mut all) = (0, 0);
    let mut told: Vec<Told> = Vec::new();
    for (distance, kept, (width, height, fov_y_deg), given) in cells {
        let camera = CameraConfig { width, height, fov_y_deg, intrinsics: None };
        let config = SessionConfig { working_distance_m: distance, max_points: kept, camera, ..Default::default() };
        // From 3 m a sword has fewer points than a session takes.
        let decided = |o: &Object| {
            decide(o, &config, given, args.scans).unwrap_or_else(|e| {
                eprintln!("{} at {distance} m is left out: {e}", o.name);
                None
            })
        };
        let found: Vec<Outcome> = objects.iter().filter_map(decided).collect();
        let median = |f: &dyn Fn(&Outcome) -> f64| {
            let mut values: Vec<f64> = found.iter().map(f).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        };
        let within = found.iter().filter(|o| (0.67..=1.5).contains(&(o.told / o.truth))).count();
        (good, all) = (good + within, all + found.len());
        told.extend(found.iter().map(|o| o.missing));
        let name = given.name();
        println!(
            "| {distance} | {kept} | {width} x {height} | {name} | {:.2} | {within} of {} | {:.2} | {:.2} | {:.2} | {:.2} |",
            median(&|o| o.told / o.truth),
            found.len(),
            median(&|o| o.correlation),
            median(&|o| o.overlap[0]),
            median(&|o| o.overlap[1]),
            found.iter().map(|o| o.score).fold(0.0, f64::max),
        );
    }
    println!("\n{good} of {all} decisions within 0.67 to 1.5");
    let inside = told.iter().filter(|(_, [low, high], open)| (low..=high).contains(&open)).count();
    let median = |value: &dyn Fn(&Told) -> f64| {
        let mut values: Vec<f64> = told.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        100.0 * values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    println!(
        "missing surface: told {:.1} %, true {:.1} % in the median; {inside} of {} between the bounds told",
        median(&|t| t.0),
        median(&|t| t.2),
        told.len()
    );
    Ok(())
}

/// One decision after so many scans; `None` where there is no view.
fn decide(object: &Object, config: &SessionConfig, given: Given, scans: usize) -> Result<Option<Outcome>> {
    let camera = config.camera.camera();
    let mut session = Session::new(config.clone(), None)?;
    let mut seen = vec![false; object.samples.len()];
    let mut rng = stream(0, &object.name);
    let episode = EpisodeConfig { working_distance_m: config.working_distance_m, ..Default::default() };
    let mut view = datagen::episode::initial_view(&episode, &mut rng);
    for _ in 0..scans {
        let (scan, shows) = look(object, &camera, &view, given);
        seen.iter_mut().zip(&shows).for_each(|(seen, shows)| *seen |= shows);
        session.add_scan(scan)?;
        match session.next_view()?.next {
            Some(next) => view = View { target: next.target_m.into(), position: next.position_m.into() },
            None => return Ok(None),
        }
    }
    let answer = session.next_view()?;
    let true_of = |target: [f64; 3], position: [f64; 3]| {
        let view = View { target: target.into(), position: position.into() };
        let (_, shows) = look(object, &camera, &view, given);
        let count = |f: fn(bool, bool) -> bool| seen.iter().zip(&shows).filter(|(a, b)| f(**a, **b)).count() as f64;
        let (new, again) = (count(|seen, shows| shows && !seen), count(|seen, shows| shows && seen));
        (new / seen.len() as f64, again / (new + again).max(1.0))
    };
    let Some(next) = &answer.next else { return Ok(None) };
    let (truth, overlap) = true_of(next.target_m, next.position_m);
    let told: Vec<f64> = answer.candidates.iter().map(|c| c.expected_gain.unwrap_or(0.0)).collect();
    let truths: Vec<f64> = answer.candidates.iter().map(|c| true_of(c.target_m, c.position_m).0).collect();
    let missing = answer.missing.as_ref().map_or((f64::NAN, [f64::NAN; 2]), |m| (m.share, m.between));
    let open = seen.iter().filter(|s| !**s).count() as f64 / seen.len() as f64;
    Ok(Some(Outcome {
        told: next.expected_gain.unwrap_or(0.0),
        truth,
        correlation: rank_correlation(&told, &truths).unwrap_or(0.0),
        overlap: [next.expected_overlap.unwrap_or(0.0), overlap],
        score: answer.candidates.iter().map(|c| c.score).fold(0.0, f64::max),
        missing: (missing.0, missing.1, open),
    }))
}

/// Scans until a run ends by the expected gain alone, and by all that the session compares; what was unseen then, and what the best candidate
/// would have added.
fn stops(objects: &[Object], below: f64) -> Result<()> {
    println!(
        "| evidence | expected gain alone: scans | unseen, median, most % | best left % | as it ends: scans | unseen | best left |"
    );
    println!("| --- | ---: | ---: | ---: | ---: | ---: | ---: |");
    for given in Given::ALL {
        let mut ends: [Vec<[f64; 3]>; 2] = Default::default();
        for object in objects {
            let found = follow(object, given, below)?;
            ends.iter_mut().zip(found).for_each(|(ends, end)| ends.extend(end));
        }
        let told = ends.map(|mut ends| {
            let mean = ends.iter().map(|[scans, ..]| scans).sum::<f64>() / ends.len() as f64;
            let mut sorted = |i: usize| {
                ends.sort_by(|a, b| a[i].total_cmp(&b[i]));
                let at = |k: usize| ends.get(k).map_or(f64::NAN, |end| 100.0 * end[i]);
                format!("{:.1}, {:.1}", at(ends.len() / 2), at(ends.len().saturating_sub(1)))
            };
            let (unseen, left) = (sorted(1), sorted(2));
            format!("{mean:.2} ({}) | {unseen} | {left}", ends.len())
        });
        println!("| {} | {} | {} |", given.name(), told[0], told[1]);
    }
    Ok(())
}

/// Scans, unseen share and gain of the best candidate where the run ends by either.
fn follow(object: &Object, given: Given, below: f64) -> Result<[Option<[f64; 3]>; 2]> {
    let config = SessionConfig { stop_below: below, ..Default::default() };
    let camera = config.camera.camera();
    let mut session = Session::new(config, None)?;
    let mut seen = vec![false; object.samples.len()];
    let mut view = datagen::episode::initial_view(&EpisodeConfig::default(), &mut stream(0, &object.name));
    let mut ends = [None; 2];
    for scans in 1..=15 {
        let (scan, shows) = look(object, &camera, &view, given);
        seen.iter_mut().zip(&shows).for_each(|(seen, shows)| *seen |= shows);
        session.add_scan(scan)?;
        let answer = session.next_view()?;
        let alone = answer.stop.expected_gain.is_some_and(|gain| gain < below);
        for (end, over) in ends.iter_mut().zip([alone, answer.stop.stop]) {
            if over && end.is_none() {
                let all = seen.len() as f64;
                let adds = |c: &planning::Candidate| {
                    let view = View { target: c.target_m.into(), position: c.position_m.into() };
                    let (_, shows) = look(object, &camera, &view, given);
                    seen.iter().zip(&shows).filter(|(seen, shows)| **shows && !**seen).count() as f64 / all
                };
                let allowed = answer.candidates.iter().filter(|c| c.objections.is_empty());
                let most = allowed.map(adds).fold(0.0, f64::max);
                *end = Some([scans as f64, seen.iter().filter(|s| !**s).count() as f64 / all, most]);
            }
        }
        match answer.next.filter(|_| ends.iter().any(Option::is_none)) {
            Some(next) => view = View { target: next.target_m.into(), position: next.position_m.into() },
            None => break,
        }
    }
    Ok(ends)
}

/// The scan from a view as it is given, and which samples it shows.
fn look(object: &Object, camera: &PinholeCamera, view: &View, given: Given) -> (Scan, Vec<bool>) {
    let pose = view.world_from_camera();
    let mut scratch = RenderScratch::default();
    let depth = object.scene.render(camera, &pose, &RenderConfig::default(), &mut scratch).clone();
    let camera_from_world = pose.inverse();
    let margin = |z: f64| camera.pixel_size(z).max(0.002);
    let shows = |p: &Point3<f64>| {
        let local = camera_from_world * p;
        let pixel = camera.project(&local);
        let at =
            [pixel.x.round() as i64 - i64::from(depth.origin[0]), pixel.y.round() as i64 - i64::from(depth.origin[1])];
        let inside = local.z > 0.0 && (0..2).all(|k| at[k] >= 0 && at[k] < i64::from(depth.size[k]));
        let measured =
            if inside { f64::from(depth.depth[(at[1] * i64::from(depth.size[0]) + at[0]) as usize]) } else { 0.0 };
        measured > 0.0 && (local.z - measured).abs() < margin(local.z)
    };
    // Within that margin also lie the backs of thin parts, which the image does not show.
    let faces = |p: &Point3<f64>| seen(&object.surface, std::slice::from_ref(p), &view.position)[0];
    let shows = object.samples.iter().map(|p| shows(p) && faces(p)).collect();
    let points = || PointCloud { points: depth.to_points(camera, &pose), normals: Vec::new() };
    let scan = match given {
        Given::Background | Given::Depth => {
            let misses = if given == Given::Background { NoReturn::Free } else { NoReturn::Unknown };
            Scan::Depth { camera: *camera, depth, world_from_camera: pose, misses }
        }
        Given::Positions => Scan::Cloud { cloud: points(), from: Some(view.position) },
        Given::Clouds => Scan::Cloud { cloud: points(), from: None },
    };
    (scan, shows)
}
