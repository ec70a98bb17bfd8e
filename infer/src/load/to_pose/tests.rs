//! From the bytes of damaged files to a pose: whatever is read is planned on, and nothing panics or takes long.
//!
//! Ten minutes of each kind of evidence: `TO_POSE_SECONDS=600 cargo test --workspace --lib -- to_pose --nocapture`.

mod files;

use super::super::*;
use crate::request::{Ask, Body};
use crate::service::Method;
use cpu_time::ThreadTime;
use files::File;
use formats::camera::parse_camera;
use formats::poses::parse_poses;
use formats::urdf::parse_urdf;
use geometry::rng;
use planning::pose::Pose;
use planning::registration::{Register, Registrability, RegistrationConfig};
use planning::{Network, RobotConfig, Session, SessionConfig, TurntableConfig};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use ros2::cloud::Placement;
use ros2::messages::{CameraInfo, Image, PointCloud2};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Processor time: a decision on a few points takes some milliseconds, and other work on the machine is none of it.
const LONGEST: Duration = Duration::from_secs(5);
/// Damaged files of each kind, where no time is given.
const FILES: usize = 60;

/// What a session is told, and what of it is damaged.
struct Evidence {
    config: SessionConfig,
    network: Option<Network>,
    /// Added before.
    first: Option<Scan>,
    files: Vec<File>,
    read: fn(&str, &[u8]) -> Option<Loaded>,
}

impl Evidence {
    fn of(files: Vec<File>, read: fn(&str, &[u8]) -> Option<Loaded>) -> Self {
        Self { config: SessionConfig::default(), network: None, first: None, files, read }
    }

    /// The view that a file leads to; `None` where it is refused on the way.
    fn next_view(&self, name: &str, bytes: &[u8]) -> Option<[f64; 3]> {
        let loaded = (self.read)(name, bytes)?;
        let mut session = Session::new(self.config.clone(), self.network.clone()).expect("settings in range");
        if let Some(first) = &self.first {
            session.add_scan(first.clone()).expect("a whole scan");
        }
        session.add_scan_within(loaded.scan, loaded.reading, &planning::Budget::default()).ok()?;
        let next = session.next_view().ok()?.next?;
        let numbers = next.world_from_camera.matrix.iter().flatten().chain(&next.position_m);
        assert!(numbers.clone().all(|x| x.is_finite()), "{name}: a pose that is none: {numbers:?}");
        Some(next.position_m)
    }

    /// Damages the files and plans on what is read of them.
    fn hold(&self, kind: &str) {
        for (name, bytes) in &self.files {
            assert!(self.next_view(name, bytes).is_some(), "{name}: an open sheet has a next view");
        }
        let seconds: Option<f64> = std::env::var("TO_POSE_SECONDS").ok().and_then(|text| text.parse().ok());
        // All work is on this thread, whose time is taken. A thread stays in its pool, and is in one already the second time.
        let _pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
        let begun = Instant::now();
        let mut rng = rng::stream(1, &format!("test/to_pose/{kind}"));
        let (mut count, mut poses, mut longest) = (0, 0, Duration::ZERO);
        while seconds.map_or(count < FILES, |s| begun.elapsed().as_secs_f64() < s) {
            let (name, bytes) = &self.files[count % self.files.len()];
            let mut bytes = bytes.clone();
            damage(&mut bytes, &mut rng);
            let start = ThreadTime::now();
            let outcome = catch_unwind(AssertUnwindSafe(|| self.next_view(name, &bytes).is_some()));
            let took = start.elapsed();
            if outcome.is_err() || took > LONGEST {
                let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
                let kept = target.join(format!("to_pose-{count}-{name}"));
                std::fs::write(&kept, &bytes).expect("kept");
                panic!("{kind}: {name}, file {count}: panicked or took {took:?}; kept as {kept:?}");
            }
            longest = longest.max(took);
            poses += usize::from(outcome.unwrap_or(false));
            count += 1;
        }
        println!("{kind}: {poses} of {count} damaged files lead to a pose, in {longest:.2?} at most");
        assert!(20 * poses > count, "{kind}: damage is not so great that nothing is read: {poses} of {count}");
    }
}

fn damage(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    const WORDS: [&str; 14] =
        ["nan", "1e30", "-1e5", "1e-320", "0", "\n", ",", ";", " ", "99999999999", "-1", "\u{feff}", "\"", "#"];
    for _ in 0..rng.random_range(1..5) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..16)).min(bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(at..end, WORDS[rng.random_range(0..WORDS.len())].bytes())),
            4 => bytes.extend_from_within(at..end),
            _ if rng.random_range(0..8) == 0 => bytes.truncate(at),
            _ => {}
        }
    }
}

fn seen(name: &str, bytes: &[u8]) -> Option<Loaded> {
    cloud_bytes(name, bytes, None, Some(Origin::Point([0.0, 0.0, 0.0]))).ok()
}

fn camera() -> DepthCamera {
    DepthCamera { intrinsics: [40.0, 40.0, 6.0, 4.5], lens: Lens::Pinhole, size: None, metres_per_unit: None }
}

fn posed(name: &str, bytes: &[u8]) -> Option<Loaded> {
    let file = depth_bytes(name, bytes, None).ok()?;
    from_depth_file(file, &camera(), Isometry3::identity(), NoReturn::Free).ok()
}

/// The whole image by this camera and pose.
fn whole_image(camera: &DepthCamera, pose: Isometry3<f64>) -> Option<Loaded> {
    let file = DepthFile { image: files::depth(), notes: Vec::new() };
    from_depth_file(file, camera, pose, NoReturn::Unknown).ok()
}

#[test]
fn clouds_with_a_position() {
    Evidence::of(files::clouds(), seen).hold("cloud with position");
}

#[test]
fn clouds_alone() {
    Evidence::of(files::clouds(), |name, bytes| cloud_bytes(name, bytes, None, None).ok()).hold("cloud alone");
}

#[test]
fn a_merged_cloud_and_the_network() {
    let network = crate::weights::network(None, crate::weights::CPU).expect("the bundled one");
    let config = SessionConfig { planner: planning::PlannerName::BenbvNet, ..SessionConfig::default() };
    let read = |name: &str, bytes: &[u8]| cloud_bytes(name, bytes, None, None).ok();
    Evidence { config, network: Some(network), ..Evidence::of(files::merged(), read) }.hold("merged cloud");
}

#[test]
fn depth_images_with_a_pose() {
    Evidence::of(files::images(), posed).hold("depth with pose");
}

#[test]
fn files_of_poses() {
    let read = |name: &str, bytes: &[u8]| {
        let file = parse_poses(name.as_ref(), bytes).ok()?;
        whole_image(&camera(), file.poses.first()?.world_from_camera)
    };
    Evidence::of(files::poses(), read).hold("pose of depth");
}

#[test]
fn files_of_calibrations() {
    let read = |name: &str, bytes: &[u8]| {
        let file = parse_camera(name.as_ref(), bytes, None).ok()?;
        whole_image(&file.into(), Isometry3::identity())
    };
    Evidence::of(files::calibrations(), read).hold("depth with calibration");
}

#[test]
fn scans_on_a_turntable() {
    let cell_from_camera = Some(Pose::from(&Isometry3::identity()).matrix);
    let (axis_point_m, range_deg) = ([0.0, 0.0, 0.45], Some([0.0, 360.0]));
    let axis_direction = [0.0, 1.0, 0.0];
    let table = TurntableConfig {
        axis_point_m,
        axis_direction,
        range_deg,
        step_deg: 45.0,
        cell_from_camera,
        ..Default::default()
    };
    let config = SessionConfig { turntable: Some(table), ..SessionConfig::default() };
    let read = |name: &str, bytes: &[u8]| {
        let mut loaded = if name.ends_with("png") { posed(name, bytes)? } else { seen(name, bytes)? };
        loaded.reading.table_angle_deg = Some((bytes.len() % 8) as f64 * 45.0);
        Some(loaded)
    };
    let first = seen("a.xyz", &files::clouds()[0].1).map(|loaded| loaded.scan);
    let files = [files::clouds(), files::images().drain(..1).collect()].concat();
    Evidence { config, first, ..Evidence::of(files, read) }.hold("turntable");
}

#[test]
fn registered_scans() {
    let first = || seen("a.xyz", &files::clouds()[0].1).map(|loaded| loaded.scan);
    for (register, kind) in [(Register::Refine, "registered"), (Register::Check, "registration checked")] {
        // A bent sheet slides along itself, which the gate would refuse, and the demand of what holds a scan in all directions.
        let (gate, registrability) = (false, Registrability::Overlap);
        let registration = RegistrationConfig { register, gate, registrability, ..RegistrationConfig::default() };
        let config = SessionConfig { registration, ..SessionConfig::default() };
        let read = |name: &str, bytes: &[u8]| {
            let Loaded { scan, reading } = seen(name, bytes)?;
            Some(Loaded { scan: scan.moved(&Isometry3::translation(0.001, -0.001, 0.001)), reading })
        };
        Evidence { config, first: first(), ..Evidence::of(files::clouds(), read) }.hold(kind);
    }
}

#[test]
fn scans_within_the_reach_of_an_arm() {
    let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples/robots/six_axis.urdf");
    let arm = parse_urdf(&urdf, &std::fs::read(&urdf).expect("a sample"), "flange").expect("an arm").arm;
    let flange_from_camera = Some(Pose::from(&Isometry3::identity()).matrix);
    let cell_from_base = Some(Pose::from(&Isometry3::translation(-0.3, 0.0, -0.5)).matrix);
    let robot = Some(RobotConfig { arm, flange_from_camera, cell_from_base, ..RobotConfig::default() });
    let config = SessionConfig { robot, working_distance_m: 0.4, ..SessionConfig::default() };
    Evidence { config, ..Evidence::of(files::clouds(), seen) }.hold("arm");
}

#[test]
fn requests_over_http() {
    let read = |_: &str, bytes: &[u8]| body(bytes);
    Evidence::of(files::requests(), read).hold("HTTP request");
}

#[test]
fn messages_of_ros() {
    let read = |name: &str, bytes: &[u8]| {
        let at = bytes.iter().position(|b| *b == b'\n')?;
        let (fields, data) = (&bytes[..at], bytes[at + 1..].to_vec());
        let pose = Isometry3::identity();
        let request = if name == "cloud.msg" {
            let mut cloud: PointCloud2 = serde_json::from_slice(fields).ok()?;
            cloud.data.0 = data;
            ros2::cloud::request(&cloud, &Placement { base_from_frame: pose, base_from_sensor: Some(pose) })
        } else {
            let (mut image, info): (Image, CameraInfo) = serde_json::from_slice(fields).ok()?;
            image.data.0 = data;
            ros2::image::request(&image, &info, &pose, false)
        };
        body(&request.ok()?.body)
    };
    Evidence::of(files::messages(), read).hold("ROS 2 message");
}

fn body(bytes: &[u8]) -> Option<Loaded> {
    match Ask::parse(Method::AddScan, Body::Whole(bytes), false, false).ok()? {
        Ask::AddScan { scan, .. } => Some(*scan),
        _ => None,
    }
}
