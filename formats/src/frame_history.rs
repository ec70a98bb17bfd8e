//! The frame history that the authors publish: one file per object, one frame per decision, no header.
//!
//! Little endian per frame: u64 N; N x 6 f64 (position, normal); 12 f64 (current target, current camera, next
//! target, next camera); 20 x 6 f64 (target, camera); 20 f64 (scores). The authors' writer writes as many views as
//! it found and their reader takes 20: a frame with fewer cannot be told apart, shifts all that follows, and shows
//! as a count or number that cannot be.

use crate::FormatError;
use crate::error::Place;
use crate::run::atomic_write;
use geometry::{PointCloud, View};
use nalgebra::{Point3, Vector3};
use std::path::Path;

/// Number of candidate views of every frame.
pub const NUM_VIEWS: usize = 20;
/// Coordinates beyond this cannot be: objects measure 0.2 m and cameras stand 1.2 m away.
const FARTHEST: f64 = 1e3;
const POINT: usize = 6 * 8;
const TAIL: usize = (12 + NUM_VIEWS * 6 + NUM_VIEWS) * 8;

/// One decision.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The accumulated cloud with normals.
    pub cloud: PointCloud,
    /// The view of the last scan.
    pub current: View,
    /// The view that was chosen.
    pub next: View,
    /// The candidates, [`NUM_VIEWS`] of them.
    pub candidates: Vec<View>,
    /// Their scores.
    pub scores: Vec<f64>,
}

/// Reads a frame history.
///
/// # Errors
/// A file that cannot be read; a count or number that cannot be, with the frame.
pub fn read_frame_history(path: &Path) -> Result<Vec<Frame>, FormatError> {
    let bytes = crate::file::read(path)?;
    parse_frame_history(path, &bytes)
}

/// [`read_frame_history`] on bytes at hand.
///
/// # Errors
/// As [`read_frame_history`].
pub fn parse_frame_history(path: &Path, bytes: &[u8]) -> Result<Vec<Frame>, FormatError> {
    const HINT: &str = "; an earlier frame may have been written with fewer than 20 views";
    let mut frames = vec![];
    let mut rest = bytes;
    while !rest.is_empty() {
        let place = Place::Frame(frames.len());
        let Some((count, body)) = rest.split_at_checked(8) else {
            return Err(FormatError::truncated(path, place, "the number of points"));
        };
        let count = u64::from_le_bytes(count.try_into().unwrap_or_default());
        let most = (body.len().saturating_sub(TAIL) / POINT) as u64;
        if count == 0 || count > most {
            let expected = format!("1 to {most}, what the rest of the file can hold{HINT}");
            return Err(FormatError::syntax(path, place, format!("{count} points"), expected));
        }
        let (body, after) = body.split_at(count as usize * POINT + TAIL);
        rest = after;
        let numbers: Vec<f64> =
            body.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect();
        let (points, tail) = numbers.split_at(count as usize * 6);
        let (views, scores) = tail.split_at(12 + NUM_VIEWS * 6);
        if let Some(x) = points.iter().chain(views).find(|x| x.is_nan() || x.abs() > FARTHEST) {
            let expected = format!("coordinates up to {FARTHEST} m{HINT}");
            return Err(FormatError::syntax(path, place, format!("{x}"), expected));
        }
        if let Some(score) = scores.iter().find(|s| !(0.0..=1.0).contains(*s)) {
            return Err(FormatError::syntax(path, place, format!("score {score}"), format!("0 to 1{HINT}")));
        }
        let view = |c: &[f64]| View { target: Point3::new(c[0], c[1], c[2]), position: Point3::new(c[3], c[4], c[5]) };
        let mut views = views.chunks_exact(6).map(view);
        let (Some(current), Some(next)) = (views.next(), views.next()) else {
            return Err(FormatError::truncated(path, place, "the current and the next view"));
        };
        frames.push(Frame {
            cloud: PointCloud {
                points: points.chunks_exact(6).map(|c| Point3::new(c[0], c[1], c[2])).collect(),
                normals: points.chunks_exact(6).map(|c| Vector3::new(c[3], c[4], c[5])).collect(),
            },
            current,
            next,
            candidates: views.collect(),
            scores: scores.to_vec(),
        });
    }
    if frames.is_empty() {
        let found = "no byte".to_owned();
        return Err(FormatError::Empty { path: path.to_owned(), found, expected: "at least one frame" });
    }
    Ok(frames)
}

/// Writes a frame history.
///
/// # Errors
/// A frame without normals or with other than 20 candidates, which the format cannot say; what the operating
/// system refuses.
pub fn write_frame_history(path: &Path, frames: &[Frame]) -> Result<(), FormatError> {
    let mut bytes = vec![];
    for (index, frame) in frames.iter().enumerate() {
        let counts = (frame.candidates.len(), frame.scores.len());
        if counts != (NUM_VIEWS, NUM_VIEWS) || !frame.cloud.has_normals() || frame.cloud.is_empty() {
            let found = format!(
                "{} points, {} normals, {} candidates, {} scores",
                frame.cloud.len(),
                frame.cloud.normals.len(),
                counts.0,
                counts.1
            );
            return Err(FormatError::syntax(
                path,
                Place::Frame(index),
                found,
                "points with normals and 20 scored candidates",
            ));
        }
        bytes.extend((frame.cloud.len() as u64).to_le_bytes());
        let points = frame.cloud.points.iter().zip(&frame.cloud.normals).flat_map(|(p, n)| p.iter().chain(n.iter()));
        let views = [frame.current, frame.next];
        let views = views.iter().chain(&frame.candidates).flat_map(|v| v.target.iter().chain(v.position.iter()));
        bytes.extend(points.chain(views).chain(&frame.scores).flat_map(|x| x.to_le_bytes()));
    }
    atomic_write(path, &bytes)
}

#[cfg(test)]
mod tests;
