//! A scan as a request carries it.

use super::Object;
use crate::load::{self, DepthCamera, Loaded, Origin};
use crate::service::Refusal;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geometry::{Lens, PointCloud};
use nalgebra::{Point3, Vector3};
use planning::pose::{from_quaternion, rigid};
use planning::scan::FARTHEST_M;
use planning::{NoReturn, Reading, Scan};
use serde::de::{Deserializer, Error, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::borrow::Cow;
use std::path::Path;

/// Points of a scan.
const POINTS: usize = 1 << 22;
/// Pixels of a depth image.
const PIXELS: usize = 1 << 23;
/// Working memory of a point, bytes: copies, indices, the cells of thinning.
const PER_POINT: usize = 80;

/// Memory that it takes to make a scan ready, bytes.
pub fn work(scan: &Scan) -> usize {
    match scan {
        Scan::Cloud { cloud, .. } | Scan::Lines { cloud, .. } => PER_POINT * cloud.len(),
        Scan::Depth { depth, .. } => {
            4 * depth.depth.len() + PER_POINT * depth.depth.iter().filter(|d| **d > 0.0).count()
        }
    }
}

/// Bytes in base64 of a file that does not hold more than `most` of `what`.
fn decoded(key: &str, text: &Text, most: usize, what: &str) -> Result<Vec<u8>, Refusal> {
    let bytes = STANDARD.decode(text.bytes()).map_err(|e| Refusal::new(400, "bad_scan", format!("{key}: {e}")))?;
    match formats::declared::count(&bytes).filter(|count| *count > most as u64) {
        Some(count) => Err(Refusal::new(413, "too_large", format!("{key}: {count} {what}, at most {most} are taken"))),
        None => Ok(bytes),
    }
}

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

/// A scan: exactly one of `points`, `points_base64`, `cloud_base64`, `depth` and (over stdin only) `file`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScanRequest<'a> {
    /// `[[x, y, z], ...]`.
    pub points: Option<Triples>,
    /// Little-endian f32 x, y, z, x, y, z, ...; NaN where a pixel has no return.
    #[serde(borrow)]
    pub points_base64: Option<Text<'a>>,
    /// A file of a cloud, with its name for the format.
    pub cloud_base64: Option<Text<'a>>,
    /// Such as `scan.pcd`.
    pub cloud_name: Option<String>,
    /// One per point.
    pub normals: Option<Triples>,
    /// Unit of the points and of `from` (and of nothing else); metres, or what the file names, if absent.
    pub unit: Option<Unit>,
    /// Where the camera was, world frame.
    pub from: Option<Origin>,
    /// A depth image.
    #[serde(borrow)]
    pub depth: Option<Object<DepthRequest<'a>>>,
    /// The turntable's angle, degrees, where the scan is in the cell's frame.
    pub table_angle_deg: Option<f64>,
    /// Path of a cloud.
    pub file: Option<String>,
    /// How long it may take from its arrival on; the service's setting if absent.
    pub deadline_ms: Option<u64>,
}

/// Text where it stands in the body.
#[derive(Clone, Debug, Deserialize)]
pub struct Text<'a>(#[serde(borrow)] Cow<'a, str>);

impl Text<'_> {
    fn bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// A body with the cloud in this file.
///
/// # Errors
/// The file cannot be read.
pub fn cloud_body(
    path: &Path,
    unit: Option<Unit>,
    from: Option<Origin>,
    table_angle_deg: Option<f64>,
) -> Result<Vec<u8>, Refusal> {
    ScanRequest { unit, from, table_angle_deg, ..Default::default() }.with_file(path)
}

/// `[[x, y, z], ...]`, at most [`POINTS`].
#[derive(Clone, Debug, Default)]
pub struct Triples(Vec<[f64; 3]>);

impl<'de> Deserialize<'de> for Triples {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Triples;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("[[x, y, z], ...]")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Triples, A::Error> {
                let mut triples = Vec::new();
                while let Some(triple) = list.next_element()? {
                    if triples.len() == POINTS {
                        return Err(A::Error::custom(format!("more than {POINTS} points: thin them")));
                    }
                    triples.push(triple);
                }
                Ok(Triples(triples))
            }
        }
        deserializer.deserialize_seq(List)
    }
}

/// A depth image with its camera.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthRequest<'a> {
    /// 16-bit grey PNG.
    #[serde(borrow)]
    pub png_base64: Option<Text<'a>>,
    /// NPY, rows x columns.
    pub npy_base64: Option<Text<'a>>,
    /// Metres per unit of depth; 0.001 for PNG and 1 for NPY if absent.
    pub metres_per_unit: Option<f64>,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: [f64; 4],
    /// Of the lens; none if absent.
    pub distortion: Option<Object<Distortion>>,
    /// 4 x 4, row by row, metres.
    pub world_from_camera: Option<[[f64; 4]; 4]>,
    /// Instead of the matrix.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// Instead of the matrix.
    pub translation_m: Option<[f64; 3]>,
    /// What pixels without a return mean; the service's setting if absent.
    pub misses: Option<NoReturn>,
}

/// Distortion of a lens.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// `none`, `brown_conrady` or `fisheye`.
    pub model: String,
    /// k1 k2 p1 p2 [k3 [k4 k5 k6]], or k1 k2 k3 k4.
    pub coefficients: Vec<f64>,
}

impl ScanRequest<'_> {
    /// The same with what is in its file in place of the path.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn with_its_file(&self) -> Result<Vec<u8>, Refusal> {
        self.with_file(Path::new(self.file.as_deref().unwrap_or_default()))
    }

    fn with_file(&self, path: &Path) -> Result<Vec<u8>, Refusal> {
        let wrong = |e: anyhow::Error| Refusal::new(400, "bad_file", format!("{e:#}"));
        let bytes = load::named_bytes(path).map_err(wrong)?;
        // Told now, in terms of the file.
        load::named_cloud(path, &bytes, self.unit, self.from).map_err(wrong)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let mut whole =
            json!({ "cloud_base64": STANDARD.encode(bytes), "cloud_name": name, "unit": self.unit, "from": self.from });
        if self.table_angle_deg.is_some() {
            whole["table_angle_deg"] = json!(self.table_angle_deg);
        }
        if self.deadline_ms.is_some() {
            whole["deadline_ms"] = json!(self.deadline_ms);
        }
        Ok(whole.to_string().into_bytes())
    }

    /// The scan.
    pub fn into_scan(self, may_read_files: bool) -> Result<Loaded, Refusal> {
        let table_angle_deg = self.table_angle_deg;
        if table_angle_deg.is_some_and(|angle| angle.is_nan() || angle.abs() >= 1e6) {
            return Err(Refusal::new(400, "bad_scan", "table_angle_deg: expected an angle in degrees"));
        }
        let mut loaded = self.read(may_read_files)?;
        loaded.reading.table_angle_deg = table_angle_deg;
        Ok(loaded)
    }

    fn read(self, may_read_files: bool) -> Result<Loaded, Refusal> {
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
        let metres = self.unit.unwrap_or_default().metres();
        let positions = self.from.iter().flat_map(|from| from.positions());
        if positions.map(|p| Vector3::from(*p) * metres).any(|p| is_far(&p)) {
            return Err(bad("from: farther away than a million metres"));
        }
        if matches!(self.from, Some(Origin::Path([first, last])) if first == last) {
            return Err(bad("from: a path needs two different points"));
        }
        if let Some(Object(depth)) = self.depth {
            if self.from.is_some() || self.normals.is_some() {
                return Err(bad("a depth image has its pose, and neither from nor normals"));
            }
            return depth.into_scan();
        }
        if self.file.is_some() && !may_read_files {
            return Err(Refusal::new(403, "no_files", "files are read over stdin only: send the points"));
        }
        let file = match (&self.file, &self.cloud_base64) {
            (Some(file), _) => {
                let path = Path::new(file);
                Some(load::named_bytes(path).and_then(|bytes| load::named_cloud(path, &bytes, self.unit, self.from)))
            }
            (None, Some(text)) => {
                let bytes = decoded("cloud_base64", text, PIXELS, "points")?;
                let name = self.cloud_name.as_deref().unwrap_or("cloud.ply");
                Some(load::cloud_bytes(name, &bytes, self.unit, self.from))
            }
            (None, None) => None,
        };
        if let Some(scan) = file {
            return scan.map_err(|e| Refusal::new(400, "bad_file", format!("{e:#}")));
        }
        let raw = match (self.points, self.points_base64) {
            (Some(points), _) => points.0,
            (None, Some(text)) => decode_points(text.bytes()).map_err(|m| bad(&m))?,
            (None, None) => Vec::new(),
        };
        let points: Vec<Point3<f64>> = raw.into_iter().map(|p| Point3::from(Vector3::from(p) * metres)).collect();
        let normals: Vec<Vector3<f64>> = self.normals.unwrap_or_default().0.into_iter().map(Vector3::from).collect();
        if !normals.is_empty() && normals.len() != points.len() {
            return Err(bad(&format!("{} normals for {} points", normals.len(), points.len())));
        }
        let cloud = PointCloud { points, normals };
        let scan = match self.from.and_then(|from| from.path(metres)) {
            Some(path) => Scan::Lines { cloud, path },
            None => Scan::Cloud { cloud, from: self.from.map(|from| from.middle(metres)) },
        };
        Ok(Loaded {
            scan,
            reading: Reading { notes: Vec::new(), metres_per_unit: Some(metres), table_angle_deg: None },
        })
    }
}

fn decode_points(text: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let bytes = STANDARD.decode(text).map_err(|e| format!("points_base64: {e}"))?;
    if bytes.len() > 12 * POINTS {
        return Err(format!("points_base64: more than {POINTS} points: thin them"));
    }
    if bytes.len() % 12 != 0 {
        return Err(format!("points_base64: {} bytes are not x, y, z of 4 bytes each", bytes.len()));
    }
    let value = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(bytes.chunks_exact(12).map(|p| [value(&p[..4]), value(&p[4..8]), value(&p[8..])]).collect())
}

impl DepthRequest<'_> {
    fn into_scan(self) -> Result<Loaded, Refusal> {
        let bad = |message: String| Refusal::new(400, "bad_depth", message);
        let (key, name, text) = match (&self.png_base64, &self.npy_base64) {
            (Some(text), None) => ("png_base64", "depth.png", text),
            (None, Some(text)) => ("npy_base64", "depth.npy", text),
            _ => return Err(bad("give exactly one of png_base64 and npy_base64".to_owned())),
        };
        let bytes = decoded(key, text, PIXELS, "pixels")?;
        let file = load::depth_bytes(name, &bytes, self.metres_per_unit).map_err(|e| bad(format!("{e:#}")))?;
        let pixels = file.image.depth.len();
        if pixels > PIXELS {
            return Err(Refusal::new(413, "too_large", format!("{pixels} pixels, at most {PIXELS} are taken")));
        }
        let (world_from_camera, off) = match (self.world_from_camera, self.quaternion_xyzw, self.translation_m) {
            (Some(matrix), None, None) => rigid(&matrix).map_err(bad)?,
            (None, Some(quaternion), Some(translation)) => {
                (from_quaternion(quaternion, translation).map_err(bad)?, 0.0)
            }
            _ => return Err(bad("give world_from_camera, or quaternion_xyzw and translation_m".to_owned())),
        };
        if is_far(&world_from_camera.translation.vector) {
            return Err(bad("the camera is farther away than a million metres".to_owned()));
        }
        let misses = self.misses.unwrap_or_default();
        let lens = match &self.distortion {
            Some(Object(lens)) => Lens::named(&lens.model, &lens.coefficients),
            None => Ok(Lens::Pinhole),
        };
        let lens = lens.map_err(|found| bad(format!("distortion: found {found}")))?;
        let camera = DepthCamera { intrinsics: self.intrinsics, lens, size: None, metres_per_unit: None };
        let loaded = load::from_depth_file(file, &camera, world_from_camera, misses);
        let mut loaded = loaded.map_err(|e| bad(format!("{e:#}")))?;
        loaded.reading.notes.extend(load::off_rotation(off));
        Ok(loaded)
    }
}

fn is_far(position: &Vector3<f64>) -> bool {
    !position.iter().all(|x| x.abs() <= FARTHEST_M)
}
