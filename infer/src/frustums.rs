//! Cloud and candidates as a PLY of coloured points and lines, for any viewer.

use formats::FormatError;
use formats::cloud::{ColoredPoint, write_ply_scene};
use geometry::{BoundaryConfig, boundary_points};
use nalgebra::Point3;
use planning::{Answer, Session};
use std::path::Path;

/// Writes the cloud (grey, boundary orange), the candidates' frustums (violet to green by score, grey where ruled
/// out) and the next view's (yellow, with a line to its target).
pub fn write(path: &Path, session: &Session, answer: &Answer) -> Result<(), FormatError> {
    let cloud = session.cloud();
    let mut points: Vec<ColoredPoint> =
        cloud.points.iter().map(|&position| ColoredPoint { position, color: [170, 180, 190] }).collect();
    let boundary = BoundaryConfig::default();
    for i in boundary_points(cloud, &session.state().neighborhoods(boundary.neighbors), &boundary) {
        points[i].color = [255, 140, 26];
    }
    let mut edges = Vec::new();
    let (low, high) = cloud.bounding_box();
    let camera = &session.state().camera;
    let allowed = || answer.candidates.iter().filter(|c| c.objections.is_empty()).map(|c| c.score);
    let (worst, best) = allowed().fold((f64::INFINITY, f64::NEG_INFINITY), |(w, b), s| (w.min(s), b.max(s)));
    for candidate in &answer.candidates {
        let is_next = candidate.rank == 0 && candidate.objections.is_empty();
        let share = if best > worst { (candidate.score - worst) / (best - worst) } else { 1.0 };
        let color = match (is_next, candidate.objections.is_empty()) {
            (true, _) => [255, 237, 26],
            (false, true) => [(90.0 - 60.0 * share) as u8, (60.0 + 140.0 * share) as u8, 140],
            (false, false) => [110, 110, 110],
        };
        let length = (high - low).norm() * if is_next { 0.3 } else { 0.12 };
        let first = points.len() as u32;
        let corners = camera.frustum(length);
        points.extend(corners.iter().map(|corner| {
            let m = &candidate.world_from_camera.matrix;
            let at = |row: usize| m[row][0] * corner.x + m[row][1] * corner.y + m[row][2] * corner.z + m[row][3];
            ColoredPoint { position: Point3::new(at(0), at(1), at(2)), color }
        }));
        for corner in 1..5 {
            edges.push([first, first + corner]);
            edges.push([first + corner, first + corner % 4 + 1]);
        }
        if is_next {
            points.push(ColoredPoint { position: Point3::from(candidate.target_m), color });
            edges.push([first, first + 5]);
        }
    }
    write_ply_scene(path, &points, &edges)
}
