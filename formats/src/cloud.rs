//! Point clouds from PLY, PCD, XYZ/TXT and NPY files.

mod npy;
mod pcd;
mod xyz;

pub(crate) use npy::read_array;

pub use crate::ply::{ColoredPoint, write_ply, write_ply_scene};

use crate::FormatError;
use geometry::PointCloud;
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

/// Endings of the files that [`read_cloud`] reads, lower case.
pub const EXTENSIONS: [&str; 7] = ["ply", "pcd", "xyz", "txt", "npy", "xyzn", "csv"];

/// A cloud as its file holds it, in the file's unit and frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudFile {
    /// The points with finite coordinates; normals where the file gives a finite one for each of them.
    pub cloud: PointCloud,
    /// Number of points left out because a coordinate is not finite.
    pub dropped: usize,
    /// The image that an organised cloud comes from.
    pub grid: Option<Grid>,
    /// `world_from_camera` of the sensor where the file tells it (PCD's `VIEWPOINT`, unless it is the identity,
    /// which writers put where they know nothing).
    pub viewpoint: Option<Isometry3<f64>>,
}

/// Where the points of an organised cloud lie in their image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Grid {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major pixel of every point of the cloud, rising.
    pub pixels: Vec<u32>,
}

impl CloudFile {
    /// Keeps what is finite. `size` is the width and height of an organised cloud.
    pub(crate) fn gather(
        path: &Path,
        rows: impl Iterator<Item = ([f64; 3], Option<[f64; 3]>)>,
        size: Option<(usize, usize)>,
    ) -> Result<Self, FormatError> {
        let mut file = CloudFile::default();
        let mut pixels = vec![];
        let mut all_normals = true;
        for (index, (position, normal)) in rows.enumerate() {
            if position.iter().any(|x| !x.is_finite()) {
                file.dropped += 1;
                continue;
            }
            file.cloud.points.push(Point3::from(position));
            match normal {
                Some(n) if n.iter().all(|x| x.is_finite()) => file.cloud.normals.push(Vector3::from(n)),
                _ => all_normals = false,
            }
            if size.is_some() {
                pixels.push(index as u32);
            }
        }
        if !all_normals {
            file.cloud.normals.clear();
        }
        if file.cloud.is_empty() {
            let found = format!("{} points, none with finite coordinates", file.dropped);
            return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one point" });
        }
        file.grid = size.map(|(width, height)| Grid { width, height, pixels });
        Ok(file)
    }
}

/// Reads a cloud; the ending of the name (in any case) says the format.
///
/// # Errors
/// A file that cannot be read, is not of its format, or holds no point with finite coordinates.
pub fn read_cloud(path: &Path) -> Result<CloudFile, FormatError> {
    let bytes = std::fs::read(path).map_err(|e| FormatError::io(path, "read", e))?;
    parse_cloud(path, &bytes)
}

/// [`read_cloud`] on bytes at hand; `path` gives the format and stands in the errors.
///
/// # Errors
/// As [`read_cloud`].
pub fn parse_cloud(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    match crate::extension(path).as_str() {
        "ply" => crate::ply::parse_cloud(path, bytes),
        "pcd" => pcd::parse(path, bytes),
        "xyz" | "txt" | "xyzn" | "csv" => xyz::parse(path, bytes),
        "npy" => npy::parse(path, bytes),
        found => Err(FormatError::UnknownType {
            path: path.to_owned(),
            found: format!(".{found}"),
            expected: ".ply, .pcd, .xyz, .txt, .csv or .npy",
        }),
    }
}
