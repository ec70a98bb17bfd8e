//! `--object`: the closed loop in the simulator, through the same session that a real cell uses.

mod cell;

use crate::args::Args;
use crate::load::PoseFile;
use anyhow::{Context, Result, bail};
use datagen::episode::ImageConfig;
use datagen::{End, EpisodeConfig, Progress, RenderConfig, Scene, Stage};
use formats::depth::MILLIMETRES;
use formats::mesh::read_mesh;
use geometry::sampling::poisson_disk_sample;
use geometry::{Mesh, PinholeCamera, PointCloud, View, rng};
use nalgebra::Isometry3;
use planning::pose::{Pose, rigid};
use planning::session::Request;
use planning::{Answer, Candidate, PlanError, RankedView, Reached, Session, Support};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

pub use cell::WithinReach;

/// Samples of the true surface (method, 'Setting').
const SURFACE_SAMPLES: usize = 60_000;
/// Diagonal that the object is scaled to, metres (method, 'Setting').
const DIAGONAL: f64 = 0.2;

/// One view of the loop.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    /// Views so far, the first scan included.
    pub views: usize,
    /// Where it was taken from, as it was answered.
    pub world_from_camera: Pose,
    /// Share of the true surface within the tolerance of a measured point.
    pub coverage: f64,
    /// Share of the scan that was seen before; none for the first.
    pub overlap: Option<f64>,
    /// What the planner expected this view to add.
    pub expected_gain: Option<f64>,
    /// What it did add.
    pub gain: f64,
    /// Where the turntable stopped for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_stop_deg: Option<f64>,
    /// Where the arm's joints are; absent without an arm, and for the first view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reached: Option<Reached>,
    /// The planner that chose it.
    pub planner: Option<String>,
}

/// The loop's outcome.
pub struct Outcome {
    /// Session after the last scan.
    pub session: Session,
    /// The answer after the last scan.
    pub last: Answer,
    /// One per view.
    pub steps: Vec<Step>,
    /// Why it ended.
    pub ended: String,
    /// Whether that is because it was asked to.
    pub stopped: bool,
    /// What was scanned: the object, and the table if it stands on one.
    pub scene: Scene,
    /// What a cell with limits lets the camera see; `None` without limits.
    pub within_reach: Option<WithinReach>,
}

/// Scans the object until `views` next views are done, none is left, none is worth it, or `stop` is set. Shows each step.
pub fn run(
    object: &str,
    args: &Args,
    session: Session,
    stop: &AtomicBool,
    mut show: impl FnMut(&Step),
) -> Result<Outcome> {
    let mesh = object_mesh(object)?.normalized(DIAGONAL);
    let settings = session.config();
    let seed = settings.seed;
    let samples = poisson_disk_sample(&mesh, SURFACE_SAMPLES, &mut rng::stream(seed, "infer/surface"));
    let samples = samples.with_context(|| object.to_owned())?;
    let scene = Scene::new(match settings.support {
        Support::None => mesh,
        Support::Auto => cell::on_table(mesh, &settings.constraints.up()),
        Support::Plane(_) => {
            bail!("--support: with --object, expected auto (the object is put on a table) or none (it floats)")
        }
    });
    let camera = &settings.camera;
    if camera.intrinsics.is_some() {
        bail!("camera.intrinsics: the simulator takes camera.fov_y_deg and square pixels");
    }
    let episode = EpisodeConfig {
        image: ImageConfig { width: camera.width, height: camera.height, fov_y_deg: camera.fov_y_deg },
        working_distance_m: settings.working_distances()[0],
        tolerance_m: settings.tolerance_m,
        num_views: args.views,
        accumulate: settings.accumulate,
        min_first_points: settings.min_points,
        ..EpisodeConfig::default()
    };
    let mut steps: Vec<Step> = Vec::new();
    let mut answers: Vec<Answer> = Vec::new();
    let mut failed = None;
    let mut step = |session: &Session, view: &View, coverage: f64, overlap: Option<f64>, expected: Option<&Answer>| {
        let taken = expected.and_then(|answer| candidate_at(answer, view));
        let first = || Pose::from(&session.camera_pose(view, None));
        let step = Step {
            views: steps.len() + 1,
            world_from_camera: taken.map_or_else(first, |c| c.world_from_camera.clone()),
            coverage,
            overlap,
            expected_gain: taken.and_then(|c| c.expected_gain),
            gain: coverage - steps.last().map_or(0.0, |s: &Step| s.coverage),
            table_stop_deg: taken.and_then(|c| Some(c.table.as_ref()?.stop_deg)),
            reached: taken.and_then(|c| c.reached.clone()),
            planner: expected.map(|a| a.planner.clone()),
        };
        show(&step);
        steps.push(step);
    };
    let request = Request { check: crate::program::checked_by(args), ..Request::default() };
    let decide = |session: &mut Session, progress: &Progress, _: &mut ChaCha8Rng| {
        step(session, progress.view, progress.coverage, progress.overlap, answers.last());
        let answer = session.next_view_for(&request).map_err(|error| {
            let plan = PlanError::failed("auto", error.to_string());
            failed = Some(error);
            plan
        })?;
        let allowed = answer.candidates.iter().filter(|c| c.objections.is_empty());
        let mut ranked: Vec<RankedView> = allowed.map(ranked).collect();
        if answer.stop.stop || stop.load(Ordering::SeqCst) {
            ranked.clear();
        }
        answers.push(answer);
        Ok(ranked)
    };
    let mut stream = rng::stream(seed, "infer/episode");
    let stage = Stage::Simulated { scene: &scene, samples: &samples };
    let outcome = datagen::run_session(stage, session, &episode, &mut stream, decide);
    let setting = episode;
    let (episode, mut session) = match (outcome, failed) {
        (Ok(outcome), _) => outcome,
        (Err(_), Some(error)) => return Err(error.into()),
        (Err(error), None) => return Err(anyhow::Error::new(error).context(object.to_owned())),
    };
    let mut stopped = false;
    let (last, ended) = match episode.end {
        End::NoView => {
            let last = answers.pop().context("no view was decided")?;
            stopped = last.next.is_some() && !last.stop.stop;
            let ended = match &last.next {
                Some(_) if stopped => "stopped as asked".to_owned(),
                None => format!("no view is left: {}", last.no_view_reason()),
                Some(_) => format!(
                    "the next view is expected to add only {:.2} %",
                    100.0 * last.stop.expected_gain.unwrap_or(0.0)
                ),
            };
            (last, ended)
        }
        _ => {
            let (view, coverage) = (episode.views[episode.views.len() - 1], episode.final_coverage());
            step(&session, &view, coverage, episode.overlaps.last().copied().flatten(), answers.last());
            (session.next_view_for(&request)?, format!("{} next views were taken", args.views))
        }
    };
    let within_reach = cell::within_reach(&scene, &samples, &setting, &session, &episode.cloud.points);
    Ok(Outcome { session, last, steps, ended, stopped, scene, within_reach })
}

fn view(candidate: &Candidate) -> View {
    View { target: candidate.target_m.into(), position: candidate.position_m.into() }
}

/// The candidate of an answer that a view was chosen as.
fn candidate_at<'a>(answer: &'a Answer, taken: &View) -> Option<&'a Candidate> {
    answer.candidates.iter().find(|candidate| view(candidate) == *taken)
}

fn ranked(candidate: &Candidate) -> RankedView {
    let view = view(candidate);
    let (gain, overlap) = (candidate.expected_gain, candidate.expected_overlap);
    RankedView { gain, overlap, given: candidate.given, ..RankedView::scored(view, candidate.score) }
}

/// A mesh file, or `procedural:SEED`.
fn object_mesh(object: &str) -> Result<Mesh> {
    let Some(seed) = object.strip_prefix("procedural:") else {
        return Ok(read_mesh(Path::new(object))?);
    };
    let seed: u64 = seed.parse().with_context(|| format!("--object {object}: SEED must be a whole number"))?;
    Ok(datagen::procedural::mesh(seed, 0))
}

/// Writes what the loop saw first, for `infer` to start from: two clouds with their camera positions beside them in
/// the printed command, and the third view as a depth image with a pose file.
pub fn export_scans(directory: &Path, args: &Args, outcome: &Outcome, camera: &PinholeCamera) -> Result<String> {
    if outcome.steps.len() < 3 {
        let object = args.object.as_deref().unwrap_or_default();
        bail!("{object}: {} scans were taken, three are needed for --export-scans", outcome.steps.len());
    }
    std::fs::create_dir_all(directory).with_context(|| format!("cannot make {directory:?}"))?;
    let taken_from = |step: &Step| rigid(&step.world_from_camera.matrix).map_err(anyhow::Error::msg);
    let shot = |pose: &Isometry3<f64>| outcome.scene.depth_image(camera, pose, &RenderConfig::default());
    let mut scans = Vec::new();
    let mut positions = Vec::new();
    for (i, step) in outcome.steps[..2].iter().enumerate() {
        let (pose, _) = taken_from(step)?;
        let path = directory.join(format!("scan{}.ply", i + 1));
        let cloud = PointCloud { points: shot(&pose).to_points(camera, &pose), normals: Vec::new() };
        formats::cloud::write_ply(&path, &cloud)?;
        let p = pose.translation.vector;
        scans.push(quoted(&path));
        positions.push(format!("{:.4},{:.4},{:.4}", p.x, p.y, p.z));
    }
    let (pose, _) = taken_from(&outcome.steps[2])?;
    let image = directory.join("depth3.png");
    formats::depth::write_depth(&image, &shot(&pose), camera.width, camera.height, MILLIMETRES)?;
    let pose_file = directory.join("depth3.json");
    let content = PoseFile {
        world_from_camera: outcome.steps[2].world_from_camera.matrix,
        intrinsics: Some([camera.fx, camera.fy, camera.cx, camera.cy]),
    };
    formats::run::atomic_write(&pose_file, format!("{}\n", serde_json::to_string_pretty(&content)?).as_bytes())?;
    let alike = planned_alike(args);
    Ok(format!(
        "infer --scan {} --from {}{alike}\ninfer --depth {} --pose {} --misses free{alike}",
        scans.join(" "),
        positions.join(" "),
        quoted(&image),
        quoted(&pose_file)
    ))
}

/// The flags of the loop that count for planning on its scans too, each with a blank before it.
fn planned_alike(args: &Args) -> String {
    let distance = match args.distance {
        Some((low, high)) if low == high => format!(" --distance {low}"),
        Some((low, high)) => format!(" --distance {low}..{high}"),
        None => String::new(),
    };
    let support = match args.support {
        Some(Support::Auto) => " --support auto",
        Some(Support::None) => " --support none",
        // A plane is refused with --object.
        Some(Support::Plane(_)) | None => "",
    };
    distance + support
}

/// A path as a shell takes it for one word.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:,+=@%".contains(c) || cfg!(windows) && c == '\\';
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}
