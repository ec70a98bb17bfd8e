//! The program `infer`: the next view for a real scan.

use crate::args::Args;
use crate::load::{self, GivenCamera, Loaded};
use crate::report::{ReportInput, report_html};
use crate::service::{self, Asks, ServeConfig, Service};
use crate::{check, frustums, http, kept, lines, outputs, plan, simulate, weights};
use anyhow::{Context, Result, bail};
use formats::Flag;
use formats::camera::read_camera;
use formats::program::{CommonArgs, STOPPED, finish, misuse, print, print_line, stop_when_asked};
use formats::urdf::{UrdfArm, read_urdf};
use nalgebra::Isometry3;
use planning::planners::auto::ChooseError;
use planning::pose::Pose;
use planning::registration::Register;
use planning::session::{Request, ViewCheck};
use planning::{Answer, Budget, PlannerName, Session, SessionConfig};
use ros2::Ros2Config;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

/// Levels of messages. RustDDS warns of every message that is larger than a packet; of its socket's buffer it is worth hearing.
const LEVELS: [&str; 3] = [
    "warn,rustdds=error,rustdds::network::udp_listener=warn,ros2_client=error",
    "info,rustdds=error,rustdds::network::udp_listener=warn,ros2_client=error",
    "debug,rustdds=warn,ros2_client=info",
];

/// The program with this command line, its own name first.
pub fn main(words: impl Iterator<Item = OsString>) -> ExitCode {
    let args = Args::from_command_line(words).unwrap_or_else(|error| error.exit());
    args.common.start_messages(LEVELS);
    finish(run(&args))
}

fn run(args: &Args) -> Result<ExitCode> {
    args.common.start_threads()?;
    let frame = args.ros2.clone().flatten();
    let frame = Flag::given("--ros2", "ros2.base_frame", frame);
    let (ServeConfig { service: limits, ros2: node }, set) =
        ServeConfig::load(args.service_config.as_deref(), &args.common.set, frame.as_slice())?;
    if !args.serve && set.len() < args.common.set.len() {
        bail!("--set service.KEY=VALUE, ros2.KEY=VALUE: settings of the service, which have no effect without --serve");
    }
    if args.ros2.is_none() && node != Ros2Config::default() {
        bail!("ros2.KEY: settings of the node, which have no effect without --serve --ros2");
    }
    let Settings { session: config, at_a_distance } = settings(args, set)?;
    args.plan.as_deref().map_or(Ok(()), |path| plan::check(path, config.planner))?;
    outputs::check(args)?;
    config.check()?;
    if config.robot.is_some() && !at_a_distance && args.views_from.is_none() {
        bail!(
            "--robot: at which distance from the object shall the camera stand? Give --distance METRES, or working_distance_m of the \
             settings: one at which the sensor measures and which the arm reaches (0.3 to 0.6 m as a rule)"
        );
    }
    if args.weights.is_some() && !matches!(config.planner, PlannerName::Auto | PlannerName::BenbvNet) {
        misuse::<Args>("--weights has no effect with a planner other than auto and benbv-net");
    }
    if args.device.is_some() && !matches!(config.planner, PlannerName::Auto | PlannerName::BenbvNet) {
        misuse::<Args>(
            "--device selects the network's device: it has no effect with a planner other than auto and benbv-net",
        );
    }
    if args.pose_error.is_some() && !args.serve && config.registration.register == Register::Off {
        misuse::<Args>("--pose-error has no effect without registration: add --register check or --register refine");
    }
    if args.misses.is_some() && args.depth.is_empty() && !args.serve {
        misuse::<Args>("--misses has no effect without --depth: what an organised cloud leaves out is always unknown");
    }
    let views = given_views(args, &config)?;
    let device = args.device.as_deref().unwrap_or(weights::CPU);
    let network = || weights::network(args.weights.as_deref(), device).map(Some);
    if args.serve {
        limits.check()?;
        if args.ros2.is_some() {
            node.check()?;
        }
        service::check(&config).map_err(|refusal| anyhow::anyhow!("{}", refusal.message))?;
        let mut service = Service::new(config.clone(), network()?, limits);
        if let Some(folder) = &args.state {
            service = service.keeping_state(folder).with_context(|| format!("--state {folder:?}"))?;
        }
        if let Some(check) = checked_by(args) {
            service = service.checking_with(check, Asks::Always);
        }
        return serve(service, args.ros2.as_ref().map(|_| &node), args).map(|()| ExitCode::SUCCESS);
    }
    if let Some(object) = &args.object {
        return closed_loop(object, args, Session::new(config.clone(), network()?)?);
    }
    if let Some(folder) = &args.session {
        let place = || format!("--session {folder:?}");
        let service = kept::service(network()?, folder).with_context(place)?;
        let entry = service.first().map_err(anyhow::Error::from).with_context(place)?;
        let mut open = entry.open.blocking_lock();
        kept::add(&service, &entry, &mut open, &config, args)?;
        let answered = answer(open.session(), views, args);
        let adds = !(args.scan.is_empty() && args.depth.is_empty());
        return answered.with_context(|| if adds { kept::added(folder) } else { place() });
    }
    if args.scan.is_empty() && args.depth.is_empty() {
        misuse::<Args>("nothing to plan on: give --scan FILE, --depth FILE, --object MESH or --serve");
    }
    let mut session = Session::new(config.clone(), network()?)?;
    add_scans(&mut session, args)?;
    answer(&mut session, views, args)
}

/// The program of `--check-with`.
pub(crate) fn checked_by(args: &Args) -> Option<ViewCheck> {
    let timeout = Duration::from_secs_f64(args.check_timeout);
    args.check_with.as_deref().map(|command| check::program(command, timeout))
}

/// The poses of --views-from: read before a session keeps any scan, so that the command can be repeated where they cannot be used.
fn given_views(args: &Args, config: &SessionConfig) -> Result<Option<Vec<Isometry3<f64>>>> {
    let Some(path) = &args.views_from else { return Ok(None) };
    if config.planner == PlannerName::BenbvNet {
        bail!(ChooseError::GivenViews);
    }
    if config.turntable.as_ref().is_some_and(|table| table.cell_from_camera.is_some()) {
        bail!("--views-from: turntable.cell_from_camera says that the camera is fixed; remove one of them");
    }
    load::poses(path).map(Some)
}

/// The next view, among these if there are any, drawn and printed: whatever cannot be written, the answer is told.
fn answer(session: &mut Session, views: Option<Vec<Isometry3<f64>>>, args: &Args) -> Result<ExitCode> {
    if let Some(views) = views {
        session.set_given_views(views);
    }
    let answer = session.next_view_for(&Request { check: checked_by(args), ..Request::default() })?;
    let written = write_files(args, &names(args), session, &answer, &[]);
    let planned = match &args.plan {
        Some(path) => plan::write(path, session.scan_plan(&answer, args.plan_views, None).as_ref(), &answer),
        None => Ok(()),
    };
    if args.json {
        print_line(serde_json::to_string_pretty(&answer)?)?;
    } else {
        print(answer.to_text())?;
    }
    written.and(planned)?;
    // 3: an answer was given, and it is that no view is left.
    Ok(if answer.next.is_some() { ExitCode::SUCCESS } else { ExitCode::from(3) })
}

/// Of the scans given, for a report's title.
fn names(args: &Args) -> String {
    let folder = args.session.iter().filter(|_| args.scan.is_empty() && args.depth.is_empty());
    let name = |path: &std::path::PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    args.scan.iter().chain(&args.depth).chain(folder).map(name).collect::<Vec<_>>().join(", ")
}

/// Of the session, and whether they say at which distance the camera stands.
struct Settings {
    session: SessionConfig,
    at_a_distance: bool,
}

/// Settings that do not say so yet.
#[derive(Serialize, Deserialize)]
#[serde(transparent)]
struct AtNoDistance(SessionConfig);

impl Default for AtNoDistance {
    fn default() -> Self {
        Self(SessionConfig { working_distance_m: f64::NAN, ..SessionConfig::default() })
    }
}

/// Defaults, then the file, then these of --set, then flags.
fn settings(args: &Args, set: Vec<String>) -> Result<Settings> {
    let (fixed, range) = match args.distance {
        Some((low, high)) if low == high => (Some(low), None),
        Some((low, high)) => (None, Some(toml::Value::from(vec![low, high]))),
        None => (None, None),
    };
    let misses = args.misses.map(toml::Value::try_from).transpose()?;
    let register = args.register.map(toml::Value::try_from).transpose()?;
    let camera = args.camera.as_deref().map(read_camera).transpose()?;
    let size = camera.as_ref().and_then(|c| c.size);
    // Without its size, what it is calibrated for may be another image than the next one.
    let intrinsics = camera.as_ref().filter(|_| size.is_some()).map(|c| toml::Value::from(c.intrinsics.to_vec()));
    let support = args.support.map(toml::Value::try_from).transpose()?;
    let mut flags = vec![
        Flag::given("--support", "support", support),
        Flag::given("--camera", "camera.width", size.map(|s| i64::from(s[0]))),
        Flag::given("--camera", "camera.height", size.map(|s| i64::from(s[1]))),
        Flag::given("--camera", "camera.intrinsics", intrinsics),
        Flag::given("--distance", "working_distance_m", fixed),
        Flag::given("--distance", "working_distance_range_m", range),
        Flag::given("--planner", "planner", args.planner.map(|p| p.as_str())),
        Flag::given("--stop-below", "stop_below", args.stop_below),
        Flag::given("--misses", "misses", misses),
        Flag::given("--register", "registration.register", register),
        Flag::given("--pose-error", "registration.pose_error_m", args.pose_error.map(|[m, _]| m)),
        Flag::given("--pose-error", "registration.pose_error_deg", args.pose_error.map(|[_, deg]| deg)),
    ];
    flags.extend(robot(args)?);
    let AtNoDistance(mut session) = CommonArgs { set, ..args.common.clone() }.settings(flags)?;
    if fixed.is_some() {
        session.working_distance_range_m = None;
    }
    let none = session.working_distance_m.is_nan();
    let at_a_distance = !none || session.working_distance_range_m.is_some();
    if none {
        session.working_distance_m = SessionConfig::default().working_distance_m;
    }
    Ok(Settings { session, at_a_distance })
}

/// The arm of the command line, as settings.
fn robot(args: &Args) -> Result<Vec<Option<Flag>>> {
    let (Some(file), Some(tool)) = (&args.robot, &args.tool) else { return Ok(Vec::new()) };
    let UrdfArm { arm, notes } = read_urdf(file, tool)?;
    for note in notes {
        tracing::warn!("{file:?}: {note}");
    }
    let hand_eye = |flag: &str, text: &Option<String>| -> Result<Option<toml::Value>> {
        let Some(text) = text else { return Ok(None) };
        let (pose, _) = load::read_pose(flag, text)?;
        Ok(Some(toml::Value::try_from(Pose::from(&pose).matrix)?))
    };
    let one = hand_eye("--flange-from-camera", &args.flange_from_camera)?;
    let other = hand_eye("--camera-from-flange", &args.camera_from_flange)?;
    Ok(vec![
        Flag::given("--robot", "robot.arm", Some(toml::Value::try_from(arm)?)),
        Flag::given("--flange-from-camera", "robot.flange_from_camera", one),
        Flag::given("--camera-from-flange", "robot.camera_from_flange", other),
    ])
}

/// The camera of the depth images, as far as the command line describes it.
pub(crate) fn depth_camera(args: &Args) -> Result<Option<GivenCamera>> {
    match &args.camera {
        Some(file) => Ok(Some(GivenCamera::File(read_camera(file)?.into()))),
        None => Ok(args.intrinsics.map(GivenCamera::Intrinsics)),
    }
}

/// Adds all scans.
fn add_scans(session: &mut Session, args: &Args) -> Result<()> {
    let (of_clouds, of_images) = args.cameras()?;
    for (i, path) in args.scan.iter().enumerate() {
        let loaded = match of_clouds.get(i) {
            Some(pose) => load::cloud_from(path, args.unit, pose)?,
            None => load::cloud(path, args.unit, args.from.get(i).copied())?,
        };
        add(session, path, loaded, args.table_angle_deg.get(i))?;
    }
    let misses = session.config().misses;
    let camera = depth_camera(args)?;
    for (i, (path, pose)) in args.depth.iter().zip(of_images).enumerate() {
        let angle = args.table_angle_deg.get(args.scan.len() + i);
        add(session, path, load::depth(path, args.depth_unit, pose, camera, misses)?, angle)?;
    }
    Ok(())
}

fn add(session: &mut Session, path: &Path, loaded: Loaded, table_angle_deg: Option<&f64>) -> Result<()> {
    let Loaded { scan, mut reading } = loaded.named(path);
    reading.table_angle_deg = table_angle_deg.copied();
    let report = session.add_scan_within(scan, reading, &Budget::default()).with_context(|| format!("{path:?}"))?;
    tracing::info!("{path:?}: {}", report.describe());
    Ok(())
}

fn closed_loop(object: &str, args: &Args, session: Session) -> Result<ExitCode> {
    let mut failed = None;
    let show = |step: &simulate::Step| {
        let line = if args.json { serde_json::to_string(step).unwrap_or_default() } else { step_line(step) };
        failed = failed.take().or(print_line(line).err());
    };
    let stop = stop_when_asked("stopping after this view; press again to stop immediately")?;
    let outcome = simulate::run(object, args, session, stop, show)?;
    if let Some(error) = failed {
        return Err(error.into());
    }
    let coverage: Vec<f64> = outcome.steps.iter().map(|s| s.coverage).collect();
    match &outcome.within_reach {
        Some(within_reach) if args.json => print_line(serde_json::to_string(within_reach)?)?,
        _ if args.json => {}
        within_reach => {
            print_line(format_args!("ended: {}", outcome.ended))?;
            within_reach.iter().try_for_each(|w| print_line(w.describe()))?;
        }
    }
    write_files(args, object, &outcome.session, &outcome.last, &coverage)?;
    if let Some(directory) = &args.export_scans {
        let camera = outcome.session.config().camera.camera();
        let commands = simulate::export_scans(directory, args, &outcome, &camera)?;
        match args.json {
            true => print_line(json!({ "scans_in": directory, "commands": commands.lines().collect::<Vec<_>>() }))?,
            false => print_line(format_args!("scans in {}; plan on them with\n{commands}", directory.display()))?,
        }
    }
    Ok(if outcome.stopped { ExitCode::from(STOPPED) } else { ExitCode::SUCCESS })
}

fn step_line(step: &simulate::Step) -> String {
    let percent = |share: Option<f64>| share.map_or("    -".to_owned(), |s| format!("{:5.1}", 100.0 * s));
    format!(
        "view {:2}  coverage {:5.1} %  gain {} % (expected {})  overlap {} %  {}{}",
        step.views,
        100.0 * step.coverage,
        percent(Some(step.gain)),
        percent(step.expected_gain),
        percent(step.overlap),
        step.planner.as_deref().unwrap_or("first view"),
        step.table_stop_deg.map_or(String::new(), |stop| format!("  table at {stop} degrees"))
    )
}

fn write_files(args: &Args, title: &str, session: &Session, answer: &Answer, coverage: &[f64]) -> Result<()> {
    if let Some(path) = &args.ply {
        frustums::write(path, session, answer)?;
    }
    if let Some(path) = &args.cloud {
        formats::cloud::write_ply(path, session.cloud())?;
    }
    if let Some(path) = &args.mesh {
        formats::mesh::write_surface(path, &session.mesh())?;
    }
    if let Some(path) = &args.report {
        let input = ReportInput { title, session, coverage };
        formats::run::atomic_write(path, report_html(answer, &input).as_bytes())?;
    }
    Ok(())
}

fn serve(service: Service, node: Option<&Ros2Config>, args: &Args) -> Result<()> {
    let stop = stop_when_asked("stopping after answering running requests; press again to stop immediately")?;
    #[cfg(feature = "ros2")]
    if let Some(config) = node {
        return crate::node::serve(&Arc::new(service), config, args.http, stop);
    }
    if node.is_some() {
        bail!(
            "--ros2: this infer was built without ROS 2; cargo install --locked --path infer --features ros2 builds one with it"
        );
    }
    if let Some(address) = args.http {
        let served = http::serve(Arc::new(service), address, stop, || false);
        return served.with_context(|| format!("--http {address}"));
    }
    let input = std::io::BufReader::new(std::io::stdin());
    let client = Arc::new(lines::Client::new(input, std::io::stdout(), service.limits().body()));
    let service =
        if args.check_with.is_some() { service } else { service.checking_with(client.check(), Asks::WhereRequested) };
    lines::serve(&service, &client, stop).context("stdin and stdout")
}
