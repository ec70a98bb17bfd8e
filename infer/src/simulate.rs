//! `--object`: the closed loop in the simulator, through the same session that a real cell uses.

use crate::args::Args;
use crate::load::{DEPTH_UNIT, PoseFile};
use anyhow::{Context, Result, bail};
use datagen::{RenderConfig, Scene};
use formats::mesh::read_mesh;
use geometry::sampling::poisson_disk_sample;
use geometry::{Mesh, Misses, PinholeCamera, PointCloud, View, coverage, overlap, rng};
use infer::pose::Pose;
use infer::{Answer, Scan, Session};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::Rng;
use serde::Serialize;
use std::path::Path;

/// Samples of the true surface (method, 'Setting').
const SURFACE_SAMPLES: usize = 60_000;
/// Diagonal that the object is scaled to, metres (method, 'Setting').
const DIAGONAL: f64 = 0.2;

/// One view of the loop.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    /// Views so far, the first scan included.
    pub views: usize,
    /// Where it was taken from.
    pub world_from_camera: Pose,
    /// Share of the true surface within the tolerance of a measured point.
    pub coverage: f64,
    /// Share of the scan that was seen before; none for the first.
    pub overlap: Option<f64>,
    /// What the planner expected the view to add.
    pub expected_gain: Option<f64>,
    /// What it did add.
    pub gain: f64,
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
    /// Where each view was taken from.
    pub poses: Vec<Isometry3<f64>>,
    /// Why it ended.
    pub ended: String,
}

/// Scans the object until `views` next views are done, none is left, or none is worth it. Shows each step.
pub fn run(object: &str, args: &Args, mut session: Session, mut show: impl FnMut(&Step)) -> Result<Outcome> {
    let mesh = object_mesh(object)?.normalized(DIAGONAL);
    let seed = session.config().seed;
    let samples = poisson_disk_sample(&mesh, SURFACE_SAMPLES, &mut rng::stream(seed, "infer/surface"));
    let scene = Scene::new(mesh);
    let camera = session.config().camera.camera();
    let tolerance = session.config().tolerance_m;
    let distance = session.config().working_distances()[0];
    let mut measured: Vec<Point3<f64>> = Vec::new();
    let mut outcome = Vec::new();
    let mut poses = Vec::new();
    let mut view = first_view(distance, seed);
    let mut expected: Option<Answer> = None;
    let mut world_from_camera = view.world_from_camera();
    let mut covered = 0.0;
    let ended;
    let last = loop {
        let depth = scene.depth_image(&camera, &world_from_camera, &RenderConfig::default());
        let points = depth.to_points(&camera, &world_from_camera);
        if measured.is_empty() && points.len() < infer::scan::MIN_POINTS {
            bail!(
                "{object}: the first view hits the object with {} pixels only; try a smaller --distance",
                points.len()
            );
        }
        let overlap = if measured.is_empty() { None } else { overlap(&points, &measured, tolerance) };
        measured.extend_from_slice(&points);
        let before = covered;
        covered = coverage(&measured, &samples, tolerance);
        let step = Step {
            views: poses.len() + 1,
            world_from_camera: Pose::from(&world_from_camera),
            coverage: covered,
            overlap,
            expected_gain: expected.as_ref().map(|a| a.stop.expected_gain),
            gain: covered - before,
            planner: expected.as_ref().map(|a| a.planner.clone()),
        };
        show(&step);
        outcome.push(step);
        poses.push(world_from_camera);
        // The simulator's misses are true free space.
        match session.add_scan(Scan::Depth { camera, depth, world_from_camera, misses: Misses::Free }) {
            Ok(_) | Err(infer::SessionError::TooFewPoints(_)) => {}
            Err(error) => return Err(error.into()),
        }
        let answer = session.next_view()?;
        let Some(next) = answer.next.clone() else {
            ended = format!("no view is left: {}", answer.no_view_reason());
            break answer;
        };
        if answer.stop.stop {
            ended = format!("the next view is expected to add {:.2} % only", 100.0 * answer.stop.expected_gain);
            break answer;
        }
        if poses.len() > args.views {
            ended = format!("{} next views were taken", args.views);
            break answer;
        }
        view = View { target: Point3::from(next.target_m), position: Point3::from(next.position_m) };
        let config = session.config();
        world_from_camera = infer::pose::world_from_camera(&view, &config.pose, &config.constraints.up());
        expected = Some(answer);
    };
    Ok(Outcome { session, last, steps: outcome, poses, ended })
}

/// The first camera, on the upper half of the sphere of this radius, looking at the origin (method, 'Setting').
fn first_view(distance: f64, seed: u64) -> View {
    let mut rng = rng::stream(seed, "infer/first-view");
    let (polar, azimuth) = (rng.gen_range(0.0..90f64).to_radians(), rng.gen_range(0.0..360f64).to_radians());
    let direction = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    View { target: Point3::origin(), position: Point3::from(distance * direction) }
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
pub fn export_scans(directory: &Path, object: &str, outcome: &Outcome, camera: &PinholeCamera) -> Result<String> {
    if outcome.poses.len() < 3 {
        bail!("{object}: {} scans were taken, three are needed for --export-scans", outcome.poses.len());
    }
    std::fs::create_dir_all(directory).with_context(|| format!("cannot make {}", directory.display()))?;
    let scene = Scene::new(object_mesh(object)?.normalized(DIAGONAL));
    let shot = |pose: &Isometry3<f64>| scene.depth_image(camera, pose, &RenderConfig::default());
    let mut scans = Vec::new();
    let mut positions = Vec::new();
    for (i, pose) in outcome.poses[..2].iter().enumerate() {
        let path = directory.join(format!("scan{}.ply", i + 1));
        let cloud = PointCloud { points: shot(pose).to_points(camera, pose), normals: Vec::new() };
        formats::cloud::write_ply(&path, &cloud)?;
        let p = pose.translation.vector;
        scans.push(path.display().to_string());
        positions.push(format!("{:.4},{:.4},{:.4}", p.x, p.y, p.z));
    }
    let pose = &outcome.poses[2];
    let image = directory.join("depth3.png");
    formats::depth::write_depth(&image, &shot(pose), camera.width, camera.height, DEPTH_UNIT)?;
    let pose_file = directory.join("depth3.json");
    let content = PoseFile {
        world_from_camera: Pose::from(pose).matrix,
        intrinsics: Some([camera.fx, camera.fy, camera.cx, camera.cy]),
    };
    formats::run::atomic_write(&pose_file, format!("{}\n", serde_json::to_string_pretty(&content)?).as_bytes())?;
    Ok(format!(
        "infer --scan {} --from {}\ninfer --depth {} --pose {} --misses free",
        scans.join(" "),
        positions.join(" "),
        image.display(),
        pose_file.display()
    ))
}
