//! The command line of `infer`.

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
  infer --scan samples/scan1.ply --from 0.8,0.2,0.9
  infer --scan a.ply b.ply --distance 0.6 --report next.html
  infer --depth d.png --intrinsics 514.1,514.1,640,360 --pose pose.json --json
  infer --depth d.png --camera camera_info.yaml --pose pose.json --set sensor.max_range_m=1.5
  infer --scan samples/scan1.ply --from 0.8,0.2,0.9 --views-from stops.json
  infer --scan a.ply b.ply --from 0,0,1 0.7,0,0.7 --register refine --pose-error 0.002,0.3
  infer --config cell.toml --depth d.png --pose p.json --table-angle-deg 30
  infer --scan a.ply --from 0,0,1 --support auto --robot samples/robots/ur5e.urdf --tool tool0 --flange-from-camera hand_eye.json
  infer --scan a.ply --from 0,0,1 --plan views.csv --plan-views 6
  infer --session part7 --scan c.ply --from 0.8,0.2,0.9
  infer --object procedural:3 --views 10 --report loop.html --mesh part.ply
  infer --serve --http 127.0.0.1:8350
  infer --serve --ros2 base_link --set ros2.cloud_topic=/camera/points
  infer --scan a.ply --from 0,0,1 --set constraints.floor_height_m=0.05 --set constraints.max_travel_m=0.8

Every setting: configs/infer.toml, of the service: configs/service.toml. For robots: docs/robots.md.
Exit codes: 0 done (--serve: asked to stop, and all was answered), 1 error, 2 wrong usage, 3 no view is left, 130 asked to stop
twice.";

/// The next best view for a 3D scan, as a pose that a robot can use.
#[derive(Debug, Parser)]
#[command(name = "infer", version = built::VERSION, after_help = format!("{EXAMPLES} {EXIT_CODES}"))]
pub struct Args {
    /// Clouds (PLY, PCD, XYZ, NPY), oldest first; all in one world frame.
    #[arg(long, num_args = 1.., value_name = "FILE")]
    pub scan: Vec<PathBuf>,
    /// Camera position of each scan, x,y,z in the unit of the clouds, in the same order.
    #[arg(long, num_args = 1.., value_name = "X,Y,Z", value_parser = numbers::<3>, requires = "scan", conflicts_with_all = ["object", "serve"])]
    pub from: Vec<[f64; 3]>,
    /// Depth images (16-bit PNG in millimetres, NPY in metres), oldest first, added after the clouds.
    #[arg(long, num_args = 1.., value_name = "FILE")]
    pub depth: Vec<PathBuf>,
    /// Intrinsics of the depth images, fx,fy,cx,cy in pixels; not needed where the pose file has them.
    #[arg(long, value_name = "FX,FY,CX,CY", value_parser = numbers::<4>, requires = "depth", conflicts_with_all = ["object", "serve"])]
    pub intrinsics: Option<[f64; 4]>,
    /// Calibration of the camera: ROS CameraInfo, OpenCV FileStorage or Kalibr's camchain (YAML; FILE:cam1 takes one of several),
    /// RealSense's or Open3D's intrinsics (JSON). Depth images are undistorted by it, and the next scan's camera has its size and
    /// focal length.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["object", "intrinsics"])]
    pub camera: Option<String>,
    /// Pose of the camera of each depth image, or of each cloud instead of --from: tx,ty,tz,qx,qy,qz,qw in metres, or a file
    /// with one pose in any of the formats of --views-from; FILE:NAME or FILE:INDEX takes one of several.
    #[arg(long, num_args = 1.., value_name = "FILE|NUMBERS", conflicts_with_all = ["object", "serve"])]
    pub pose: Vec<String>,
    /// Choose from the poses in this file alone: turntable stops, taught poses. JSON (4 x 4 matrices, objects with
    /// world_from_camera, BOP's scene_camera.json or scene_gt.json, Open3D's trajectory), rows of 4 x 4 matrices, TUM's lines,
    /// Open3D's .log, COLMAP's images.txt. Their directions: docs/formats.md.
    #[arg(long, value_name = "FILE")]
    pub views_from: Option<PathBuf>,
    /// Angle of the turntable at each scan, degrees, the clouds first: the scans and their cameras are given in the cell's frame, which
    /// does not turn. The table itself: [turntable] of the settings.
    #[arg(long, num_args = 1.., value_name = "DEGREES", value_parser = angle, allow_negative_numbers = true, conflicts_with_all = ["object", "serve"])]
    pub table_angle_deg: Vec<f64>,
    /// What the object stands on: auto (found in the first scan), none, or the plane nx,ny,nz,d of points p with n . p = d, metres. It is
    /// taken away from the scans, and no view is under it. With --object, auto stands the object on a table.
    #[arg(long, value_name = "auto|none|NX,NY,NZ,D", value_parser = support)]
    pub support: Option<Support>,
    /// URDF of the serial arm that carries the camera: views are ruled out that it does not reach, or where it would touch what was
    /// measured, what is expected in unknown space, keep_out_m or itself. More: [robot] of the settings.
    #[arg(long, value_name = "FILE", requires = "tool")]
    pub robot: Option<PathBuf>,
    /// The arm's last link, which the hand-eye calibration is of.
    #[arg(long, value_name = "LINK", requires = "robot")]
    pub tool: Option<String>,
    /// Hand-eye calibration, the camera's pose on that link: tx,ty,tz,qx,qy,qz,qw in metres, or a file with one pose.
    #[arg(long, value_name = "FILE|NUMBERS", requires = "robot", conflicts_with = "camera_from_flange")]
    pub flange_from_camera: Option<String>,
    /// The same the other way round: the link's pose in the camera's frame.
    #[arg(long, value_name = "FILE|NUMBERS", requires = "robot")]
    pub camera_from_flange: Option<String>,
    /// Metres per unit of the depth images, integers or floats, if not the usual.
    #[arg(long, value_name = "METRES", value_parser = length, requires = "depth", conflicts_with_all = ["object", "serve"])]
    pub depth_unit: Option<f64>,
    /// What pixels without a return mean: unknown, or free (nothing there).
    #[arg(long, value_name = "MEANING", value_parser = misses)]
    pub misses: Option<NoReturn>,
    /// Unit of the clouds and of --from; metres, or the unit that a text cloud names with its columns, if not given.
    #[arg(long, value_enum, requires = "scan", conflicts_with_all = ["object", "serve"])]
    pub unit: Option<Unit>,
    /// Register each scan onto those before it: off, check (says how far it is off), or refine (moves it, or refuses it with the
    /// reason). docs/robots.md, 'Scans that do not quite fit'.
    #[arg(long, value_name = "MODE", value_parser = register)]
    pub register: Option<Register>,
    /// The robot's accuracy for --register, standard deviations per axis: METRES,DEGREES (0.002,0.3 if not given).
    #[arg(long, value_name = "METRES,DEGREES", value_parser = numbers::<2>)]
    pub pose_error: Option<[f64; 2]>,
    /// Distance from target to camera in metres, or a range to choose from: MIN..MAX.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true, value_parser = distances)]
    pub distance: Option<(f64, f64)>,
    /// Which planner: auto, volumetric, benbv-net, farthest.
    #[arg(long, value_name = "NAME", value_parser = planner)]
    pub planner: Option<PlannerName>,
    /// Directory of a checkpoint for benbv-net, instead of the bundled weights.
    #[arg(long, value_name = "DIR")]
    pub weights: Option<PathBuf>,
    /// Device of benbv-net: cpu, or a GPU backend that was compiled in (wgpu, cuda; docs/gpu.md).
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Stop when the next view is expected to add less than this share of the surface, such as 0.01.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub stop_below: Option<f64>,
    /// Answer as JSON.
    #[arg(long, conflicts_with = "serve")]
    pub json: bool,
    /// Write the cloud and the candidates as frustums to this PLY.
    #[arg(long, value_name = "FILE")]
    pub ply: Option<PathBuf>,
    /// Write the measured surface as triangles to this PLY (normals, colours, `rim` 1 where it ends) or STL, metres.
    #[arg(long, value_name = "FILE", conflicts_with = "serve")]
    pub mesh: Option<PathBuf>,
    /// Write the cloud that is planned on, with normals, to this PLY, metres.
    #[arg(long, value_name = "FILE", conflicts_with = "serve")]
    pub cloud: Option<PathBuf>,
    /// Write several next views to this .json, .yaml or .csv, for cells that cannot plan after each scan: the allowed candidates that
    /// together see most of what is missing, in the order of travel.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["object", "serve"])]
    pub plan: Option<PathBuf>,
    /// At most so many views in it.
    #[arg(long, value_name = "COUNT", default_value_t = 8, requires = "plan")]
    pub plan_views: usize,
    /// Write a page to turn with the mouse: cloud, boundary, candidates, next view.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Scan this mesh in the simulator until --views: a file, or procedural:SEED.
    #[arg(long, value_name = "MESH", conflicts_with_all = ["scan", "depth", "serve", "views_from"])]
    pub object: Option<String>,
    /// Next views in the closed loop (--object).
    #[arg(long, default_value_t = 15, value_name = "COUNT", requires = "object", conflicts_with_all = ["scan", "depth", "serve"])]
    pub views: usize,
    /// Write the first scans of --object (two clouds, a depth image, their poses) into this directory.
    #[arg(long, value_name = "DIR", requires = "object", conflicts_with_all = ["scan", "depth", "serve"])]
    pub export_scans: Option<PathBuf>,
    /// Keep the session in this directory: these scans are added to those of earlier commands. Settings are those given now.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["object", "serve"])]
    pub session: Option<PathBuf>,
    /// Answer requests: JSON lines over stdin and stdout, HTTP with --http, ROS 2 with --ros2.
    #[arg(long, conflicts_with_all = ["scan", "depth", "report", "ply", "views_from"])]
    pub serve: bool,
    /// Loopback address for --serve, such as 127.0.0.1:8350; port 0 takes a free one and prints it.
    #[arg(long, value_name = "ADDRESS", requires = "serve", conflicts_with_all = ["scan", "depth", "object"])]
    pub http: Option<SocketAddr>,
    /// Serve as a ROS 2 node, which brings scans into this frame and answers poses in it: the one that the object stands still in, such
    /// as base_link. Beside HTTP, if --http is given too. Topics and more: [ros2] of configs/service.toml; docs/ros2.md.
    #[arg(long, value_name = "BASE_FRAME", num_args = 0..=1, requires = "serve", conflicts_with_all = ["scan", "depth", "object"])]
    pub ros2: Option<Option<String>>,
    /// Keep the sessions of --serve in this directory: they survive its end, however sudden.
    #[arg(long, value_name = "DIR", requires = "serve")]
    pub state: Option<PathBuf>,
    /// Settings of the service from a TOML file, as configs/service.toml; also --set service.KEY=VALUE, ros2.KEY=VALUE.
    #[arg(long, value_name = "FILE", requires = "serve")]
    pub service_config: Option<PathBuf>,
    /// What every program has.
    #[command(flatten)]
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
            bail!("both --pose and --from tell where the clouds were taken from: give one of them");
        }
        Ok(self.pose.split_at(of_clouds))
    }

    /// Parses a command line. Numbers with commas that begin with a minus are values, not flags.
    pub fn from_command_line(words: impl Iterator<Item = OsString>) -> Result<Self, clap::Error> {
        let is_number = |word: &str| word.starts_with('-') && word.contains(',') && !word.starts_with("--");
        formats::program::parse_from(words.map(|word| match word.to_str() {
            // A space in front keeps the parser from taking the minus for a flag; it is trimmed later.
            Some(text) if is_number(text) => OsString::from(format!(" {text}")),
            _ => word,
        }))
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
