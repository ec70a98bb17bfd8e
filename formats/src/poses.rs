//! Camera poses as people have them, told apart by what stands in the file (docs/formats.md, 'Poses'). Whatever its own
//! direction, handedness of storage and unit, a pose comes out as `world_from_camera`, camera +Z forward, metres.

mod colmap;
mod conf;
mod header;
mod json;
mod rows;

use crate::{FormatError, Place, text};
use nalgebra::Isometry3;
use planning::pose::rigid;
use std::path::Path;

/// A pose, and what its file says beside it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilePose {
    /// Camera +Z forward, metres.
    pub world_from_camera: Isometry3<f64>,
    /// fx, fy, cx, cy in pixels.
    pub intrinsics: Option<[f64; 4]>,
    /// Columns and rows of the image that these are of, where the file says so.
    pub size: Option<[u32; 2]>,
    /// Metres per unit of the depth image, where the file says so (BOP's `depth_scale`).
    pub metres_per_unit: Option<f64>,
    /// What the file calls it: an image, a scan, a frame.
    pub name: Option<String>,
    /// How far its rotation was off one: by more than rounding, and the nearest one was taken.
    pub off: f64,
}

/// The poses of a file, and whether they are of cameras.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseFile {
    /// In the order of the file.
    pub poses: Vec<FilePose>,
    /// They place scans, whose camera was elsewhere (Stanford's `.conf`).
    pub of_scans: bool,
}

const EXPECTED: &str = "JSON (a 4 x 4 matrix, {\"world_from_camera\": ...}, a list of those, BOP's scene_camera.json or \
                        scene_gt.json, Open3D's trajectory), rows of 4 x 4 matrices, one matrix per line (12 or 16 numbers), \
                        lines of time x y z qx qy qz qw, Open3D's .log, COLMAP's images.txt or Stanford's .conf";

/// Reads poses.
///
/// # Errors
/// A file that cannot be read, of none of the formats, without a pose, or with one that is no rigid motion.
pub fn read_poses(path: &Path) -> Result<PoseFile, FormatError> {
    let bytes = crate::file::read(path)?;
    parse_poses(path, &bytes)
}

/// [`read_poses`] on bytes at hand; `path` stands in the errors.
///
/// # Errors
/// As [`read_poses`].
pub fn parse_poses(path: &Path, bytes: &[u8]) -> Result<PoseFile, FormatError> {
    let text = text::decode(bytes);
    let mut file = PoseFile::default();
    if text.trim_start().starts_with(['[', '{']) {
        file.poses = json::parse(path, &text)?;
    } else {
        let first = content(&text).next().map_or("", |(_, line)| line);
        file.of_scans = matches!(first.split_whitespace().next(), Some("bmesh" | "camera" | "mesh"));
        file.poses = match () {
            () if file.of_scans => conf::parse(path, &text)?,
            () if colmap::is_image(first) => colmap::parse(path, &text)?,
            () => rows::parse(path, &text)?,
        };
    }
    if file.poses.is_empty() {
        return Err(FormatError::Empty { path: path.to_owned(), found: "no pose".to_owned(), expected: EXPECTED });
    }
    Ok(file)
}

/// Lines with something in them, from 1, without their comments.
fn content(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text::lines(text).map(|(number, line)| (number, text::without_comment(line).trim()));
    lines.filter(|(_, line)| !line.is_empty())
}

/// The numbers of a line, with blanks, commas or semicolons between; `None` where something else stands there too.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let words = line.split(|c: char| c.is_whitespace() || c == ',' || c == ';').filter(|w| !w.is_empty());
    words.map(text::number).collect()
}

/// What a matrix is called, and what it has to be.
type Given = [&'static str; 2];

const ROWS: Given = ["world_from_camera", "a rigid motion, 4 x 4, row by row, metres"];

/// A matrix of a file as a pose.
fn of_matrix(
    path: &Path,
    place: Place,
    [name, expected]: Given,
    rows: &[[f64; 4]; 4],
) -> Result<FilePose, FormatError> {
    // The reason takes the matrix for ours.
    let found = |reason: String| reason.replace(ROWS[0], name).replace(" (the matrix is given row by row)", "");
    let (world_from_camera, off) =
        rigid(rows).map_err(|reason| FormatError::syntax(path, place, found(reason), expected))?;
    Ok(FilePose { world_from_camera, off, ..FilePose::default() })
}

/// Rotation (row by row) and translation of a file as a pose.
fn of_parts(path: &Path, place: Place, given: Given, r: &[f64; 9], t: &[f64; 3]) -> Result<FilePose, FormatError> {
    let row = |i: usize| [r[3 * i], r[3 * i + 1], r[3 * i + 2], t[i]];
    of_matrix(path, place, given, &[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// The same pose, the file having given its inverse.
fn inverse(pose: FilePose) -> FilePose {
    FilePose { world_from_camera: pose.world_from_camera.inverse(), ..pose }
}

#[cfg(test)]
mod tests;
