//! The command line of `infer`.

use crate::load::Origin;
use crate::plan::VIEWS;
use crate::request::Unit;
use anyhow::bail;
use clap::Parser;
use formats::program::{CommonArgs, EXIT_CODES, length, share};
use planning::NoReturn;
use planning::PlannerName;
use planning::Support;
use planning::registration::Register;
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  infer --scan a.ply b.ply --distance 0.6 --report next.html
  infer --depth d.png --intrinsics 514.1,514.1,640,360 --pose pose.json --json
  infer --depth d.png --camera camera_info.yaml --pose pose.json --set sensor.max_range_m=1.5
  infer --scan samples/scan1.ply --from 0.0762,-0.5734,1.0514 --views-from stops.json
  infer --scan a.ply b.ply --from 0,0,1 0.7,0,0.7 --register refine --pose-error 0.002,0.3
  infer --config cell.toml --depth d.png --pose p.json --table-angle-deg 30
  infer --scan a.ply --from 0,0,1 --support auto --robot samples/robots/ur5e.urdf --tool tool0 --flange-from-camera hand_eye.json
  infer --scan a.ply --from 0,0,1 --check-with 'python3 my_moveit.py'
  infer --scan a.ply --from 0,0,1 --plan views.csv --plan-views 6
  infer --session part7 --scan c.ply --from 0.8,0.2,0.9
  infer --object procedural:3 --views 10 --report loop.html --mesh part.ply
  infer --serve --http 127.0.0.1:8350
  infer --serve --ros2 base_link --set ros2.cloud_topic=/camera/points
  infer --scan a.ply --from 0,0,1 --set constraints.floor_height_m=0.05 --set constraints.max_travel_m=0.8

Every setting is listed in configs/infer.toml, those of the service in configs/service.toml. For robots, see docs/robots.md.
";

const IN_SHORT: &str = "\
Example: infer --scan samples/scan1.ply --from 0.0762,-0.5734,1.0514 --report next.html
All options, details, examples and exit codes: --help. For robots: docs/robots.md.";

// The groups of the options. The short help (-h) shows the common ones on one screen, --help all of them.
const SCANS: &str = "Scans";
const PLANNING: &str = "Planning";
const ARM: &str = "Robot arm";
const OUTPUT: &str = "Output";
const SIMULATION: &str = "Simulation";
const SERVICE: &str = "Service";

/// Plans the next best view for a 3D scan, as a camera pose for a robot
#[derive(Debug, Parser)]
#[command(
    name = "infer",
    version = built::VERSION,
    after_help = IN_SHORT,
    after_long_help = format!("{EXAMPLES}\n{EXIT_CODES} With --serve, 0 is a requested stop after all requests were answered, 130 a second one."),
)]
pub struct Args {
    /// Clouds (PLY, PCD, XYZ, CSV, NPY), oldest first
    ///
    /// All clouds are in one world frame.
    #[arg(help_heading = SCANS, long, num_args = 1.., value_name = "FILE")]
    pub scan: Vec<PathBuf>,
    /// Camera position of each cloud, in the same order
    ///
    /// x,y,z in metres, or in the unit of --unit; x,y,z..x,y,z for a line scanner that moved straight from one to the other.
    #[arg(help_heading = SCANS, long, num_args = 1.., value_name = "X,Y,Z", value_parser = Origin::parse, requires = "scan", conflicts_with_all = ["object", "serve"])]
    pub from: Vec<Origin>,
    /// Depth images (PNG and integer NPY in mm, NPY of floats in m), oldest first
    ///
    /// They are added after the clouds.
    #[arg(help_heading = SCANS, long, num_args = 1.., value_name = "FILE")]
    pub depth: Vec<PathBuf>,
    /// Camera pose of each depth image, or of each cloud
    ///
    /// tx,ty,tz,qx,qy,qz,qw in metres, or a file with one pose in any format accepted by --views-from; FILE:NAME or FILE:INDEX selects
    /// one of several, by its index only if none is named by a number. For clouds it replaces --from, and places an organised cloud that is in its camera's frame.
    #[arg(help_heading = SCANS, long, num_args = 1.., value_name = "FILE|NUMBERS", conflicts_with_all = ["object", "serve"])]
    pub pose: Vec<String>,
    /// Intrinsics of the depth images, in pixels
    ///
    /// Not needed if the pose file contains them, which these replace, with a warning if they differ.
    #[arg(help_heading = SCANS, long, value_name = "FX,FY,CX,CY", value_parser = numbers::<4>, requires = "depth", conflicts_with_all = ["object", "serve"])]
    pub intrinsics: Option<[f64; 4]>,
    /// Calibration file of the camera
    ///
    /// ROS CameraInfo, OpenCV FileStorage or Kalibr camchain (YAML; FILE:cam1 selects one of several), RealSense or Open3D intrinsics
    /// and BOP's camera.json (JSON). Depth images are undistorted with it, and the camera of the next scan has its size and focal length. Intrinsics in the pose file
    /// of an image, if any, are used for that image.
    #[arg(help_heading = SCANS, long, value_name = "FILE", conflicts_with_all = ["object", "intrinsics"])]
    pub camera: Option<String>,
    /// Pixels without a return: unknown or free (nothing there)
    ///
    /// Those of depth images; what an organised cloud leaves out is always unknown.
    #[arg(help_heading = SCANS, long, value_name = "MEANING", value_parser = misses, conflicts_with = "object")]
    pub misses: Option<NoReturn>,
    /// Unit of the clouds and of --from: m or mm [default: m]
    ///
    /// If not given, the unit named in the header of a text cloud is used.
    #[arg(help_heading = SCANS, long, value_enum, hide_possible_values = true, requires = "scan", conflicts_with_all = ["object", "serve"])]
    pub unit: Option<Unit>,
    /// Metres per unit of the depth images
    ///
    /// If it differs from the usual: millimetres for integers, metres for floats; or from depth_scale of BOP's files, which is read.
    #[arg(help_heading = SCANS, hide_short_help = true, long, value_name = "METRES", value_parser = length, requires = "depth", conflicts_with_all = ["object", "serve"])]
    pub depth_unit: Option<f64>,
    /// Turntable angle of each scan, degrees
    ///
    /// The clouds come first. Scans and cameras are given in the cell's frame, which does not turn. The table itself is described by
    /// [turntable] in the settings.
    #[arg(help_heading = SCANS, hide_short_help = true, long, num_args = 1.., value_name = "DEGREES", value_parser = angle, conflicts_with_all = ["object", "serve"])]
    pub table_angle_deg: Vec<f64>,
    /// Keep the session here and add the scans to earlier ones
    ///
    /// Scans of earlier commands stay in the session; the settings are those given now.
    #[arg(help_heading = SCANS, long, value_name = "DIR", conflicts_with_all = ["object", "serve"])]
    pub session: Option<PathBuf>,
    /// Distance from target to camera, or MIN..MAX [default: 1.2]
    ///
    /// In metres; with MIN..MAX, the planner chooses.
    #[arg(help_heading = PLANNING, long, value_name = "METRES", value_parser = distances)]
    pub distance: Option<(f64, f64)>,
    /// auto, volumetric, benbv-net or farthest [default: auto]
    #[arg(help_heading = PLANNING, long, value_name = "NAME", value_parser = planner)]
    pub planner: Option<PlannerName>,
    /// Choose only from the poses in this file
    ///
    /// For turntable stops and taught poses. JSON (4 x 4 matrices, objects with world_from_camera, BOP's scene_camera.json or
    /// scene_gt.json, Open3D's trajectory), rows of 4 x 4 matrices, TUM, Open3D's .log, EuRoC, KITTI, COLMAP's images.txt. docs/formats.md says which
    /// direction each has.
    #[arg(help_heading = PLANNING, long, value_name = "FILE")]
    pub views_from: Option<PathBuf>,
    /// Stop once views add less than this share (e.g. 0.01)
    ///
    /// Of the whole surface: the most that any allowed view is expected to add, what the last scan added, and the last two in the mean.
    #[arg(help_heading = PLANNING, long, value_name = "SHARE", value_parser = share)]
    pub stop_below: Option<f64>,
    /// The plane that the object stands on [default: none]
    ///
    /// auto finds it in the first scan; nx,ny,nz,d is the plane of points p with n . p = d, metres. It is removed from the scans, and views
    /// from below it are excluded. With --object, auto puts the object on a table.
    #[arg(help_heading = PLANNING, long, value_name = "auto|none|NX,NY,NZ,D", value_parser = support)]
    pub support: Option<Support>,
    /// Register scans: off, check or refine [default: off]
    ///
    /// check reports how far each scan is off the ones before it; refine moves it, or rejects it with the reason. docs/robots.md, 'Scans
    /// that do not quite fit'.
    #[arg(help_heading = PLANNING, long, value_name = "MODE", value_parser = register)]
    pub register: Option<Register>,
    /// The robot's accuracy, for --register [default: 0.002,0.3]
    ///
    /// Standard deviations per axis.
    #[arg(help_heading = PLANNING, hide_short_help = true, long, value_name = "METRES,DEGREES", value_parser = numbers::<2>)]
    pub pose_error: Option<[f64; 2]>,
    /// Checkpoint directory for benbv-net, instead of the bundled weights
    #[arg(help_heading = PLANNING, hide_short_help = true, long, value_name = "DIR")]
    pub weights: Option<PathBuf>,
    /// Device for benbv-net [default: cpu]
    ///
    /// cpu, or a GPU backend that was compiled in (wgpu, cuda; docs/gpu.md).
    #[arg(help_heading = PLANNING, hide_short_help = true, long, value_name = "NAME")]
    pub device: Option<String>,
    /// URDF of the serial arm that carries the camera
    ///
    /// Views are excluded if the arm cannot reach them, or if it would touch what was measured, what is expected in unknown space,
    /// keep_out_m or itself. More under [robot] in the settings.
    #[arg(help_heading = ARM, long, value_name = "FILE", requires = "tool")]
    pub robot: Option<PathBuf>,
    /// Link that the camera is mounted on
    ///
    /// The hand-eye calibration refers to this link.
    #[arg(help_heading = ARM, long, value_name = "LINK", requires = "robot")]
    pub tool: Option<String>,
    /// Hand-eye calibration: the camera's pose on that link
    ///
    /// tx,ty,tz,qx,qy,qz,qw in metres, or a file with one pose.
    #[arg(help_heading = ARM, long, value_name = "FILE|NUMBERS", requires = "robot", conflicts_with = "camera_from_flange")]
    pub flange_from_camera: Option<String>,
    /// The inverse: the link's pose in the camera frame
    #[arg(help_heading = ARM, hide_short_help = true, long, value_name = "FILE|NUMBERS", requires = "robot")]
    pub camera_from_flange: Option<String>,
    /// Program that decides which views can be taken
    ///
    /// For instance one that asks MoveIt: JSON lines over its stdin and stdout, yes or no for each candidate, with a cost or a reason.
    /// docs/robots.md, 'Using your own motion planner'.
    #[arg(help_heading = ARM, long, value_name = "COMMAND")]
    pub check_with: Option<String>,
    /// Time for each of its answers [default: 60]
    ///
    /// One question holds all candidates.
    #[arg(help_heading = ARM, hide_short_help = true, long, value_name = "SECONDS", default_value_t = 60.0, hide_default_value = true, value_parser = seconds, requires = "check_with")]
    pub check_timeout: f64,
    /// Print the answer as JSON
    #[arg(help_heading = OUTPUT, long, conflicts_with = "serve")]
    pub json: bool,
    /// Write an interactive HTML page
    ///
    /// It shows the cloud, its boundary, the candidates and the next view.
    #[arg(help_heading = OUTPUT, long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write several next views as .json, .yaml or .csv
    ///
    /// For cells that cannot plan after each scan: the allowed candidates that together see most of what is missing, in the order of
    /// travel.
    #[arg(help_heading = OUTPUT, long, value_name = "FILE", conflicts_with_all = ["object", "serve"])]
    pub plan: Option<PathBuf>,
    /// Maximum number of views in --plan, up to 100
    #[arg(help_heading = OUTPUT, hide_short_help = true, long, value_name = "COUNT", default_value_t = 8, value_parser = plan_views, requires = "plan", conflicts_with_all = ["object", "serve"])]
    pub plan_views: usize,
    /// Write the measured surface as triangles, PLY or STL
    ///
    /// In metres. The PLY has normals, colours, and `rim` 1 where the measured surface ends.
    #[arg(help_heading = OUTPUT, long, value_name = "FILE", conflicts_with = "serve")]
    pub mesh: Option<PathBuf>,
    /// Write the merged cloud with normals as PLY
    ///
    /// In metres: the cloud that planning uses.
    #[arg(help_heading = OUTPUT, long, value_name = "FILE", conflicts_with = "serve")]
    pub cloud: Option<PathBuf>,
    /// Write the cloud and the candidates' frustums as PLY
    #[arg(help_heading = OUTPUT, long, value_name = "FILE")]
    pub ply: Option<PathBuf>,
    /// Scan this mesh in the simulator, or procedural:SEED
    ///
    /// Takes --views next views.
    #[arg(help_heading = SIMULATION, long, value_name = "MESH", conflicts_with_all = ["scan", "depth", "serve", "views_from"])]
    pub object: Option<String>,
    /// Number of next views
    #[arg(help_heading = SIMULATION, long, default_value_t = 15, value_name = "COUNT", requires = "object", conflicts_with_all = ["scan", "depth", "serve", "session"])]
    pub views: usize,
    /// Write the first scans into this directory
    ///
    /// Two clouds, a depth image and their poses.
    #[arg(help_heading = SIMULATION, hide_short_help = true, long, value_name = "DIR", requires = "object", conflicts_with_all = ["scan", "depth", "serve", "session"])]
    pub export_scans: Option<PathBuf>,
    /// Answer requests: JSON lines on stdin, --http, --ros2
    #[arg(help_heading = SERVICE, long, conflicts_with_all = ["scan", "depth", "report", "ply", "views_from"])]
    pub serve: bool,
    /// Loopback address, e.g. 127.0.0.1:8350
    ///
    /// Port 0 takes a free port and prints it.
    #[arg(help_heading = SERVICE, long, value_name = "ADDRESS", requires = "serve", conflicts_with_all = ["scan", "depth", "object", "session"])]
    pub http: Option<SocketAddr>,
    /// Run as a ROS 2 node in this frame
    ///
    /// Scans are transformed into this frame, and poses are answered in it. The object must not move in it: base_link, for instance. It
    /// runs beside HTTP if --http is given too. Topics and more are under [ros2] in configs/service.toml; see docs/ros2.md.
    #[arg(help_heading = SERVICE, long, value_name = "BASE_FRAME", num_args = 0..=1, requires = "serve", conflicts_with_all = ["scan", "depth", "object", "session"])]
    pub ros2: Option<Option<String>>,
    /// Keep sessions in this directory
    ///
    /// They survive the end of the service, even a crash.
    #[arg(help_heading = SERVICE, long, value_name = "DIR", requires = "serve", conflicts_with_all = ["scan", "depth", "object", "session"])]
    pub state: Option<PathBuf>,
    /// Settings of the service (TOML)
    ///
    /// Like configs/service.toml; --set service.KEY=VALUE and ros2.KEY=VALUE also work.
    #[arg(help_heading = SERVICE, hide_short_help = true, long, value_name = "FILE", requires = "serve", conflicts_with_all = ["scan", "depth", "object", "session"])]
    pub service_config: Option<PathBuf>,
    /// Options of every program.
    #[command(flatten, next_help_heading = "General")]
    pub common: CommonArgs,
}

// The parser does not ask for a flag that conflicts with another one given: what `requires` a mode conflicts with the others,
// too.
impl Args {
    /// Which of --pose are those of the clouds, in the order of --scan, and which those of the depth images, which come after.
    ///
    /// # Errors
    /// Not as many as there are scans; clouds with --from as well.
    pub fn cameras(&self) -> anyhow::Result<(&[String], &[String])> {
        let (clouds, images, given) = (self.scan.len(), self.depth.len(), self.pose.len());
        let angles = self.table_angle_deg.len();
        if angles > 0 && angles != clouds + images {
            bail!(
                "{angles} --table-angle-deg for {} scans: give one per scan, the clouds first, or none",
                clouds + images
            );
        }
        if !self.from.is_empty() && self.from.len() != clouds {
            bail!("{} --from for {clouds} --scan: give one camera position per cloud, or none", self.from.len());
        }
        let of_clouds = match given.checked_sub(images) {
            Some(0) => 0,
            Some(left) if left == clouds => clouds,
            _ if clouds == 0 => bail!("{given} --pose for {images} --depth: give one pose per depth image"),
            _ => bail!(
                "{given} --pose for {clouds} --scan and {images} --depth: give one per depth image, and before them one per \
                 cloud or none"
            ),
        };
        if of_clouds > 0 && !self.from.is_empty() {
            bail!("--pose and --from both give the camera positions of the clouds: use one of them");
        }
        Ok(self.pose.split_at(of_clouds))
    }

    /// Parses a command line.
    pub fn from_command_line(words: impl Iterator<Item = OsString>) -> Result<Self, clap::Error> {
        formats::program::parse_from(words)
    }
}

/// N numbers with commas between.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| part.trim().to_owned()))
        .collect::<Result<_, _>>()
        .map_err(|part| format!("{part:?} is not a number"))?;
    let found = values.len();
    values.try_into().map_err(|_| format!("{found} numbers, expected {N} with commas between and no spaces"))
}

fn support(text: &str) -> Result<Support, String> {
    match text {
        "auto" => Ok(Support::Auto),
        "none" => Ok(Support::None),
        _ => {
            let plane = numbers::<4>(text).map_err(|e| format!("{e}: auto, none, or the plane nx,ny,nz,d"))?;
            let support = Support::plane(plane);
            support.check().map(|()| support).map_err(|e| e.to_string())
        }
    }
}

fn plan_views(text: &str) -> Result<usize, String> {
    let (least, most) = (VIEWS.start(), VIEWS.end());
    let within = |count: &usize| VIEWS.contains(count);
    text.parse().ok().filter(within).ok_or_else(|| format!("{text:?}: expected {least} to {most} views"))
}

fn seconds(text: &str) -> Result<f64, String> {
    let within = |s: &f64| (0.001..=86_400.0).contains(s);
    text.parse::<f64>().ok().filter(within).ok_or_else(|| format!("{text:?}: expected 0.001 to 86,400 seconds"))
}

fn angle(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|x| x.abs() < 1e6).ok_or_else(|| format!("{text:?} is no angle in degrees"))
}

fn planner(text: &str) -> Result<PlannerName, String> {
    use PlannerName as P;
    let known = [P::Auto, P::Volumetric, P::BenbvNet, P::Farthest];
    let names = known.map(PlannerName::as_str).join(", ");
    known.into_iter().find(|p| p.as_str() == text).ok_or_else(|| format!("unknown; there are {names}"))
}

fn misses(text: &str) -> Result<NoReturn, String> {
    match text {
        "free" => Ok(NoReturn::Free),
        "unknown" => Ok(NoReturn::Unknown),
        _ => Err("expected free or unknown".to_owned()),
    }
}

fn register(text: &str) -> Result<Register, String> {
    match text {
        "off" => Ok(Register::Off),
        "check" => Ok(Register::Check),
        "refine" => Ok(Register::Refine),
        _ => Err("expected off, check or refine".to_owned()),
    }
}

/// `0.8`, or `0.6..1.2`.
pub fn distances(text: &str) -> Result<(f64, f64), String> {
    let number = |part: &str| length(part.trim()).map_err(|e| format!("{e}: METRES or MIN..MAX"));
    match text.split_once("..") {
        None => number(text).map(|d| (d, d)),
        Some((low, high)) => match (number(low)?, number(high)?) {
            (low, high) if low <= high => Ok((low, high)),
            _ => Err("expected the smaller distance first".to_owned()),
        },
    }
}

#[cfg(test)]
mod tests;
