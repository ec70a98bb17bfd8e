//! Point clouds from PLY, PCD, XYZ/TXT and NPY files.

mod columns;
mod lzf;
mod npy;
mod pcd;
mod xyz;

pub(crate) use columns::{Unit, has_marks, names, with_unit};
pub(crate) use npy::read_array;
pub(crate) use pcd::declared_points as pcd_points;

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
    /// The points with finite coordinates; normals where the file gives any, zero for those that it lacks.
    pub cloud: PointCloud,
    /// Number of points left out: a coordinate is not finite, or (0, 0, 0) stands for no return.
    pub dropped: usize,
    /// The image that an organised cloud comes from.
    pub grid: Option<Grid>,
    /// `world_from_camera` of the sensor where the file tells it (PCD's `VIEWPOINT`, unless it is the identity,
    /// which writers put where they know nothing).
    pub viewpoint: Option<Isometry3<f64>>,
    /// The unit that the file names, metres.
    pub metres_per_unit: Option<f64>,
    /// A unit that the file names and that is not known here: without another one its lengths cannot be told.
    pub unknown_unit: Option<String>,
    /// What a user should know of how the file was read: what was guessed, what was left out.
    pub notes: Vec<String>,
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
    /// Keeps what was measured: not what is not finite, nor (0, 0, 0) in an organised cloud (`size`: its width and height)
    /// or wherever it stands more than once, as it does for pixels without a return.
    pub(crate) fn gather(
        path: &Path,
        rows: impl Iterator<Item = ([f64; 3], Option<[f64; 3]>)>,
        size: Option<(usize, usize)>,
    ) -> Result<Self, FormatError> {
        let mut file = CloudFile::default();
        let mut pixels = vec![];
        let mut any_normal = false;
        let mut zeros = 0;
        for (index, (position, normal)) in rows.enumerate() {
            if position.iter().any(|x| !x.is_finite()) {
                file.dropped += 1;
                continue;
            }
            if position == [0.0; 3] {
                zeros += 1;
                if size.is_some() {
                    continue;
                }
            }
            file.cloud.points.push(Point3::from(position));
            if let Some(normal) = normal {
                let known = normal.iter().all(|x| x.is_finite());
                any_normal |= known && normal != [0.0; 3];
                file.cloud.normals.push(if known { Vector3::from(normal) } else { Vector3::zeros() });
            }
            if size.is_some() {
                pixels.push(index as u32);
            }
        }
        if !any_normal {
            file.cloud.normals.clear();
        }
        // In organised clouds these are the pixels without a return.
        if file.dropped > 0 && size.is_none() {
            let found = "points have a non-finite coordinate and were dropped";
            file.notes.push(format!("{} {found}", file.dropped));
        }
        if zeros > 1 || (zeros > 0 && size.is_some()) {
            file.dropped += zeros;
            file.notes.push(format!("{zeros} points at exactly (0, 0, 0) are treated as pixels without a return"));
            file.leave_out_zeros();
        }
        if file.cloud.is_empty() {
            let found = format!("{} points, none with finite coordinates", file.dropped);
            return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one point" });
        }
        file.grid = size.map(|(width, height)| Grid { width, height, pixels });
        Ok(file)
    }

    fn leave_out_zeros(&mut self) {
        let PointCloud { points, normals } = &mut self.cloud;
        let measured = |p: &Point3<f64>| p.coords != Vector3::zeros();
        let mut kept = points.iter().map(measured);
        normals.retain(|_| kept.next() == Some(true));
        points.retain(measured);
    }

    /// With what a reader has to say.
    pub(crate) fn with_notes(mut self, notes: impl IntoIterator<Item = String>) -> Self {
        self.notes.extend(notes);
        self
    }
}

/// Whether columns that no name explains are normals: of unit length (within 5 %), or zero where one is missing, and not the
/// same for all, as a colour may be.
fn are_normals<'a>(columns: impl Iterator<Item = &'a [f64; 3]>) -> bool {
    let (mut first, mut unit, mut all, mut vary) = (None, 0, 0, false);
    for column in columns.filter(|c| c.iter().all(|x| x.is_finite())) {
        let length = Vector3::from(*column).norm();
        if length != 0.0 && (length - 1.0).abs() >= 0.05 {
            return false;
        }
        all += 1;
        unit += usize::from(length != 0.0);
        vary |= *first.get_or_insert(column) != column;
    }
    vary && 2 * unit > all
}

/// What is said where such columns are no normals.
fn columns_ignored() -> String {
    "columns 4 to 6 are not unit vectors, or all the same: treated as colours and ignored".to_owned()
}

/// Reads a cloud; the ending of the name (in any case) says the format.
///
/// # Errors
/// A file that cannot be read, is not of its format, or holds no point with finite coordinates.
pub fn read_cloud(path: &Path) -> Result<CloudFile, FormatError> {
    let bytes = crate::file::read(path)?;
    parse_cloud(path, &bytes)
}

/// [`read_cloud`] on bytes at hand; `path` gives the format and stands in the errors.
///
/// ```
/// use std::path::Path;
///
/// let file = formats::cloud::parse_cloud(Path::new("a.xyz"), b"0 0 0.5\n0.1 0 0.5\nnan 0 0\n")?;
/// assert_eq!((file.cloud.len(), file.dropped), (2, 1));
/// # Ok::<(), formats::FormatError>(())
/// ```
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

#[cfg(test)]
mod tests;
