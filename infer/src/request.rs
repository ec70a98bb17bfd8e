//! Bodies of requests to the service.

use crate::load;
use crate::service::Refusal;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geometry::{PinholeCamera, PointCloud};
use nalgebra::{Point3, Vector3};
use planning::Misses;
use planning::pose::from_quaternion;
use planning::{Scan, SessionConfig};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Unit of lengths in input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// Metres.
    #[default]
    M,
    /// Millimetres.
    Mm,
}

impl Unit {
    /// Metres per unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Mm => 0.001,
        }
    }
}

/// A new session: settings that differ from the service's.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CreateRequest {
    /// As in `configs/infer.toml`, as JSON.
    pub config: Option<Value>,
}

impl CreateRequest {
    /// The settings laid over `base`.
    pub fn over(self, base: &SessionConfig) -> Result<SessionConfig, Refusal> {
        let Some(changes) = self.config else { return Ok(base.clone()) };
        let wrong = |e: serde_json::Error| Refusal::new(400, "bad_config", format!("config: {e}"));
        let mut merged = serde_json::to_value(base).map_err(wrong)?;
        merge(&mut merged, changes);
        serde_json::from_value(merged).map_err(wrong)
    }
}

fn merge(base: &mut Value, changes: Value) {
    match (base, changes) {
        (Value::Object(base), Value::Object(changes)) => {
            for (key, value) in changes {
                merge(base.entry(key).or_insert(Value::Null), value);
            }
        }
        (base, changes) => *base = changes,
    }
}

/// What may change from view to view.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NextRequest {
    /// Where the camera is now.
    pub current_position_m: Option<[f64; 3]>,
    /// Settings to change, for this and later views.
    pub config: Option<Value>,
}

/// A scan: exactly one of `points`, `points_base64`, `cloud_base64`, `depth` and (over stdin only) `file`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanRequest {
    /// `[[x, y, z], ...]`.
    pub points: Option<Vec<[f64; 3]>>,
    /// Little-endian f32 x, y, z, x, y, z, ...; NaN where a pixel has no return.
    pub points_base64: Option<String>,
    /// A file of a cloud, with its name for the format.
    pub cloud_base64: Option<String>,
    /// Such as `scan.pcd`.
    pub cloud_name: Option<String>,
    /// One per point.
    pub normals: Option<Vec<[f64; 3]>>,
    /// Unit of the points and of `from` (and of nothing else).
    pub unit: Unit,
    /// Where the camera was, world frame.
    pub from: Option<[f64; 3]>,
    /// A depth image.
    pub depth: Option<DepthRequest>,
    /// Path of a cloud.
    pub file: Option<String>,
}

/// A depth image with its camera.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthRequest {
    /// 16-bit grey PNG.
    pub png_base64: Option<String>,
    /// NPY, rows x columns.
    pub npy_base64: Option<String>,
    /// Metres per unit of depth; 0.001 for PNG and 1 for NPY if absent.
    pub metres_per_unit: Option<f64>,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// 4 x 4, row by row, metres.
    pub world_from_camera: Option<[[f64; 4]; 4]>,
    /// Instead of the matrix.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Instead of the matrix.
    pub translation_m: Option<[f64; 3]>,
    /// What pixels without a return mean; the service's setting if absent.
    pub misses: Option<Misses>,
}

impl ScanRequest {
    /// The scan.
    pub fn into_scan(self, config: &SessionConfig, may_read_files: bool) -> Result<Scan, Refusal> {
        let bad = |message: &str| Refusal::new(400, "bad_scan", message);
        let given = [
            self.points.is_some(),
            self.points_base64.is_some(),
            self.cloud_base64.is_some(),
            self.depth.is_some(),
            self.file.is_some(),
        ];
        if given.iter().filter(|g| **g).count() != 1 {
            return Err(bad("give exactly one of points, points_base64, cloud_base64, depth and file"));
        }
        let metres = self.unit.metres();
        let from = self.from.map(|p| Point3::from(Vector3::from(p) * metres));
        if from.is_some_and(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(bad("from: not finite"));
        }
        if let Some(depth) = self.depth {
            if self.from.is_some() || self.normals.is_some() {
                return Err(bad("a depth image has its pose, and neither from nor normals"));
            }
            return depth.into_scan(config);
        }
        if self.file.is_some() && !may_read_files {
            return Err(Refusal::new(403, "no_files", "files are read over stdin only: send the points"));
        }
        let file = match (&self.file, &self.cloud_base64) {
            (Some(file), _) => Some(load::cloud(file.as_ref(), self.unit)),
            (None, Some(text)) => {
                let bytes = STANDARD.decode(text).map_err(|e| bad(&format!("cloud_base64: {e}")))?;
                Some(load::cloud_bytes(self.cloud_name.as_deref().unwrap_or("cloud.ply"), &bytes, self.unit))
            }
            (None, None) => None,
        };
        if let Some(scan) = file {
            let mut scan = scan.map_err(|e| Refusal::new(400, "bad_file", format!("{e:#}")))?;
            if let (Scan::Cloud { from: known, .. }, Some(from)) = (&mut scan, from) {
                *known = Some(from);
            }
            return Ok(scan);
        }
        let raw = match (self.points, self.points_base64) {
            (Some(points), _) => points,
            (None, Some(text)) => decode_points(&text).map_err(|m| bad(&m))?,
            (None, None) => Vec::new(),
        };
        let points: Vec<Point3<f64>> = raw.into_iter().map(|p| Point3::from(Vector3::from(p) * metres)).collect();
        let normals: Vec<Vector3<f64>> = self.normals.unwrap_or_default().into_iter().map(Vector3::from).collect();
        if !normals.is_empty() && normals.len() != points.len() {
            return Err(bad(&format!("{} normals for {} points", normals.len(), points.len())));
        }
        Ok(Scan::Cloud { cloud: PointCloud { points, normals }, from })
    }
}

fn decode_points(text: &str) -> Result<Vec<[f64; 3]>, String> {
    let bytes = STANDARD.decode(text).map_err(|e| format!("points_base64: {e}"))?;
    if bytes.len() % 12 != 0 {
        return Err(format!("points_base64: {} bytes are not x, y, z of 4 bytes each", bytes.len()));
    }
    let value = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(bytes.chunks_exact(12).map(|p| [value(&p[..4]), value(&p[4..8]), value(&p[8..])]).collect())
}

impl DepthRequest {
    fn into_scan(self, config: &SessionConfig) -> Result<Scan, Refusal> {
        let bad = |message: String| Refusal::new(400, "bad_depth", message);
        let decode = |key: &str, text: &str| STANDARD.decode(text).map_err(|e| bad(format!("{key}: {e}")));
        let image = match (&self.png_base64, &self.npy_base64) {
            (Some(text), None) => load::depth_png(&decode("png_base64", text)?, self.metres_per_unit),
            (None, Some(text)) => load::depth_npy(&decode("npy_base64", text)?, self.metres_per_unit),
            _ => return Err(bad("give exactly one of png_base64 and npy_base64".to_owned())),
        };
        let depth = image.map_err(|e| bad(format!("{e:#}")))?;
        let [fx, fy, cx, cy] = self.intrinsics;
        let camera = PinholeCamera { width: depth.size[0], height: depth.size[1], fx, fy, cx, cy };
        if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite())) {
            return Err(bad("intrinsics: fx, fy, cx, cy with fx and fy positive".to_owned()));
        }
        let world_from_camera = match (self.world_from_camera, self.quaternion_xyzw, self.translation_m) {
            (Some(matrix), None, None) => load::rigid(&matrix).map_err(bad)?,
            (None, Some(quaternion), Some(translation)) => from_quaternion(quaternion, translation).map_err(bad)?,
            _ => return Err(bad("give world_from_camera, or quaternion_xyzw and translation_m".to_owned())),
        };
        Ok(Scan::Depth { camera, depth, world_from_camera, misses: self.misses.unwrap_or(config.misses) })
    }
}
