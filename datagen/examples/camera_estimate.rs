//! How far the estimated camera of a cloud alone is off: the angle at the cloud's middle between it and the true one.
//! `simulated`: scans of procedural objects, or of the meshes of a folder; `recorded`: the clouds of a folder with
//! `sequence.json` (`{"working_distance_m": d, "scans": [{"cloud": "00.ply", "camera_position_m": [x, y, z]}]}`).
//!
//! ```text
//! cargo run --release -p datagen --example camera_estimate -- simulated [--root DIR] [--distance 1.2] [--max-points 10000]
//! cargo run --release -p datagen --example camera_estimate -- recorded DIR
//! ```

use anyhow::{Context, Result};
use clap::Parser;
use datagen::dataset::{DatasetConfig, DatasetName, list_objects, load_mesh};
use datagen::{EpisodeConfig, RenderScratch, Scene};
use formats::cloud::read_cloud;
use geometry::rng::stream;
use geometry::{PointCloud, View};
use nalgebra::{Point3, Vector3};
use planning::{CameraPose, Scan, Session, SessionConfig};
use rand::RngExt;
use std::path::{Path, PathBuf};

#[derive(Parser)]
enum Arguments {
    /// Scans from our simulator, from the upper half and from below.
    Simulated {
        /// Meshes; 40 procedural objects without it.
        #[arg(long)]
        root: Option<PathBuf>,
        /// Working distance, metres.
        #[arg(long, default_value_t = 1.2)]
        distance: f64,
        /// As the setting of `infer`.
        #[arg(long, default_value_t = 10_000)]
        max_points: usize,
        /// Views of each object.
        #[arg(long, default_value_t = 8)]
        views: u64,
    },
    /// Recorded clouds.
    Recorded {
        /// Folder with clouds and `sequence.json`.
        root: PathBuf,
    },
}

fn main() -> Result<()> {
    let mut estimates = match Arguments::parse() {
        Arguments::Simulated { root, distance, max_points, views } => simulated(root, distance, max_points, views)?,
        Arguments::Recorded { root } => recorded(&root)?,
    };
    estimates.sort_by(|a, b| a.off.total_cmp(&b.off));
    let angles: Vec<f64> = estimates.iter().map(|e| e.off).collect();
    let at = |share: f64| angles.get((share * (angles.len() - 1) as f64).round() as usize).copied().unwrap_or(f64::NAN);
    let flipped = angles.iter().filter(|&&a| a > 90.0 && a < 180.0).count();
    let several = angles.iter().filter(|&&a| a == 180.0).count();
    let right: Vec<&Estimate> = estimates.iter().filter(|e| e.off <= 90.0).collect();
    let kept = right.iter().filter(|e| e.off <= e.told.0).count() as f64 / right.len().max(1) as f64;
    let wrong = estimates.iter().map(|e| e.told.1).sum::<f64>();
    println!(
        "{} clouds: median {:.1} degrees off, 80 % within {:.1}, 90 % within {:.1}; {flipped} from the wrong side, {several} \
         taken for several scans; {:.0} % of those from the right side within the angle told, {wrong:.0} told to be from the \
         wrong one",
        angles.len(),
        at(0.5),
        at(0.8),
        at(0.9),
        100.0 * kept,
    );
    Ok(())
}

/// The estimated camera against the true one, seen from the middle of the cloud.
fn estimate(points: Vec<Point3<f64>>, camera: &Point3<f64>, distance: f64, max_points: usize) -> Result<Estimate> {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let middle = Point3::from(sum / points.len() as f64);
    let config = SessionConfig { working_distance_m: distance, max_points, ..SessionConfig::default() };
    let mut session = Session::new(config, None)?;
    session.add_scan(Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: None })?;
    let [scan] = &session.state().scans[..] else { return Ok(Estimate::SEVERAL) };
    let estimated = Point3::from(scan.world_from_camera.translation.vector);
    let off = (estimated - middle).angle(&(camera - middle)).to_degrees();
    let CameraPose::Estimated(trust) = scan.pose else { return Ok(Estimate::SEVERAL) };
    Ok(Estimate { off, told: (trust.off_deg(), trust.wrong_side()) })
}

/// Degrees between estimated and true camera, and what the planner says of it: degrees in nine of ten cases, and the
/// share on the wrong side.
struct Estimate {
    off: f64,
    told: (f64, f64),
}

impl Estimate {
    /// The cloud was taken for several scans or none.
    const SEVERAL: Self = Self { off: 180.0, told: (180.0, 0.0) };
}

fn simulated(root: Option<PathBuf>, distance: f64, max_points: usize, views: u64) -> Result<Vec<Estimate>> {
    let name = if root.is_some() { DatasetName::Folder } else { DatasetName::Procedural };
    let objects = list_objects(&DatasetConfig { name, root, objects: Some(40), ..Default::default() }, 0, 0.0)?;
    let config = EpisodeConfig::default();
    let (camera, mut scratch, mut estimates) = (config.image.camera(), RenderScratch::default(), Vec::new());
    for object in &objects {
        let scene = Scene::new(load_mesh(object)?.normalized(0.2));
        let mut rng = stream(0, &object.name);
        for _ in 0..views {
            let z = rng.random_range(-1.0..1.0f64);
            let turn = rng.random_range(0.0..std::f64::consts::TAU);
            let direction = Vector3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            let view = View { target: Point3::origin(), position: Point3::from(distance * direction) };
            let pose = view.world_from_camera();
            let points = scene.render(&camera, &pose, &config.render, &mut scratch).to_points(&camera, &pose);
            if points.len() >= 50 {
                estimates.push(estimate(points, &view.position, distance, max_points)?);
            }
        }
    }
    Ok(estimates)
}

fn recorded(root: &Path) -> Result<Vec<Estimate>> {
    let path = root.join("sequence.json");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let sequence: serde_json::Value = serde_json::from_str(&text)?;
    let distance = sequence["working_distance_m"].as_f64().context("working_distance_m")?;
    let scans = sequence["scans"].as_array().context("scans")?;
    let one = |scan: &serde_json::Value| {
        let cloud = read_cloud(&root.join(scan["cloud"].as_str().context("cloud")?))?.cloud;
        let position = |k: usize| scan["camera_position_m"][k].as_f64().context("camera_position_m");
        let camera = Point3::new(position(0)?, position(1)?, position(2)?);
        let estimate = estimate(cloud.points, &camera, distance, 10_000)?;
        println!("{}: {:.1}", scan["cloud"], estimate.off);
        Ok(estimate)
    };
    scans.iter().map(one).collect()
}
