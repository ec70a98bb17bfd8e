//! `--session DIR`: a session that persists from command to command, stored as the service stores its own.

use crate::args::Args;
use crate::load::{self, Origin, Told};
use crate::request::{Ask, Body, cloud_body};
use crate::service::{Entry, Method, Open, Service, ServiceConfig};
use anyhow::{Context, Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::Point3;
use planning::pose::Pose;
use planning::{Network, Scan, SessionConfig};
use serde_json::json;
use std::path::Path;

/// Limits of a person's own command.
const UNHURRIED: u64 = 3_600_000;

/// The one session of this folder, or none yet. Its settings come with each command ([`add`]).
///
/// # Errors
/// The folder is in use, cannot be read, or holds several sessions.
pub fn service(network: Option<Network>, folder: &Path) -> Result<Service> {
    let limits = ServiceConfig {
        deadline_ms: UNHURRIED,
        max_deadline_ms: UNHURRIED,
        scans: 10_000,
        body_mib: 1 << 20,
        session_mib: 1 << 20,
        memory_mib: 1 << 20,
        ..ServiceConfig::default()
    };
    let service = Service::new(SessionConfig::default(), network, limits).keeping_state(folder)?;
    let names = service.names();
    if names.len() > 1 {
        bail!(
            "the directory holds the sessions {}, and --session works on one: serve it with --serve --state {folder:?}, or give another directory",
            names.join(", ")
        );
    }
    Ok(service)
}

/// Lays these settings over the session and adds the scans of the command line, once all their files are read: what was added stays, whatever comes
/// after.
///
/// # Errors
/// A scan that cannot be read or planned on, or a session that cannot be written.
pub fn add(service: &Service, entry: &Entry, open: &mut Open, config: &SessionConfig, args: &Args) -> Result<()> {
    let bodies = bodies(config, args)?;
    let mut work = |ask: Ask| {
        let spare = service.memory().nothing();
        service.work(entry, open, ask, None, &service.patience(), spare)
    };
    work(Ask::Configure(Box::new(config.clone())))?;
    for (before, (path, body, told)) in bodies.into_iter().enumerate() {
        let ask = Ask::parse(Method::AddScan, Body::Whole(&body), false, true).map(|ask| ask.told(told));
        let place = || match before {
            0 => format!("{path:?}"),
            _ => format!("{path:?} (the scans before it were added: repeat the command without them)"),
        };
        let reply = ask.and_then(&mut work).with_context(place)?;
        tracing::info!("{path:?}: {}", String::from_utf8_lossy(&reply.body));
    }
    Ok(())
}

/// What to know of a command that failed after that.
pub fn added(folder: &Path) -> String {
    format!("--session {folder:?}: the scans were added, so repeat the command without them; what failed")
}

/// The scans of the command line, as requests that hold their files, each with what is told beside its file.
fn bodies<'a>(config: &SessionConfig, args: &'a Args) -> Result<Vec<(&'a Path, Vec<u8>, Told)>> {
    let (of_clouds, of_images) = args.cameras()?;
    let mut bodies = Vec::new();
    for (i, path) in args.scan.iter().enumerate() {
        // Errors are reported in full: the file is the user's.
        let given = args.from.get(i).copied();
        let loaded = match of_clouds.get(i) {
            Some(pose) => load::cloud_from(path, args.unit, pose)?,
            None => load::cloud(path, args.unit, given)?,
        };
        // In the unit of --unit: one that the file names is that of its points alone.
        let in_unit = |from: Point3<f64>| Origin::Point((from / args.unit.unwrap_or_default().metres()).coords.into());
        let (from, world_from_camera) = match (of_clouds.get(i), &loaded.scan) {
            (Some(_), Scan::Depth { world_from_camera, .. }) => (None, Some(*world_from_camera)),
            (Some(_), scan) => (scan.camera_position().map(in_unit), None),
            (None, _) => (given, None),
        };
        let body = cloud_body(path, args.unit, from, args.table_angle_deg.get(i).copied())?;
        bodies.push((path.as_path(), body, Told { notes: loaded.named(path).reading.notes, world_from_camera }));
    }
    let camera = crate::program::depth_camera(args)?;
    for (i, (path, pose)) in args.depth.iter().zip(of_images).enumerate() {
        // Errors are reported in full; the file is kept as it came.
        let loaded = load::depth(path, args.depth_unit, pose, camera, config.misses)?.named(path);
        let (world_from_camera, camera) = load::placed_camera(path, pose, camera)?;
        // A matrix is not read as the very same pose.
        let told = Told { notes: loaded.reading.notes, world_from_camera: Some(world_from_camera) };
        let bytes = STANDARD.encode(load::named_bytes(path)?);
        let is_png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
        let lens = camera.lens;
        let distortion =
            (!lens.is_pinhole()).then(|| json!({ "model": lens.name(), "coefficients": lens.coefficients() }));
        let mut depth = json!({
            "intrinsics": camera.intrinsics,
            "distortion": distortion,
            "world_from_camera": Pose::from(&world_from_camera).matrix,
            "metres_per_unit": args.depth_unit.or(camera.metres_per_unit), "misses": config.misses,
        });
        depth[if is_png { "png_base64" } else { "npy_base64" }] = bytes.into();
        let angle = args.table_angle_deg.get(args.scan.len() + i);
        let body = json!({ "depth": depth, "table_angle_deg": angle }).to_string().into_bytes();
        bodies.push((path.as_path(), body, told));
    }
    Ok(bodies)
}
