//! What RViz shows: the known cloud, its boundary, the candidates by score and the next view.

use crate::messages::{Color, Header, Marker, MarkerArray, Vector3};
use geometry::{BoundaryConfig, Neighborhoods, PinholeCamera, PointCloud, boundary_points};
use nalgebra::Point3;
use planning::answer::Candidate;
use planning::{Answer, SessionConfig};
use serde::Deserialize;

/// More points of the cloud are not sent.
const MOST_POINTS: usize = 20_000;

/// The cloud and the settings, as the service exports them.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Known {
    /// The accumulated cloud.
    pub points_m: Vec<Point3<f64>>,
    /// Its normals.
    pub normals: Vec<nalgebra::Vector3<f64>>,
    /// The settings.
    pub config: SessionConfig,
    /// Mean distance of neighbouring points.
    pub spacing_m: f64,
}

const CLOUD: Color = color(0.67, 0.71, 0.75);
const BOUNDARY: Color = color(1.0, 0.55, 0.1);
const RULED_OUT: Color = color(0.43, 0.43, 0.43);
const NEXT: Color = color(1.0, 0.93, 0.1);

const fn color(r: f32, g: f32, b: f32) -> Color {
    Color { r, g, b, a: 1.0 }
}

/// Of an allowed candidate: violet for the worst, green for the best.
fn by_score(share: f64) -> Color {
    let share = share as f32;
    color(0.35 - 0.24 * share, 0.24 + 0.55 * share, 0.55)
}

/// All markers, after one that takes away those of before.
pub fn markers(known: Known, answer: &Answer, header: &Header) -> MarkerArray {
    let marker = |id: i32, ns: &str, kind: i32, size: f64, color: Color| Marker {
        header: header.clone(),
        ns: ns.to_owned(),
        id,
        r#type: kind,
        action: Marker::ADD,
        scale: Vector3 { x: size, y: size, z: size },
        color,
        ..Marker::default()
    };
    let clear = Marker { header: header.clone(), action: Marker::DELETE_ALL, ..Marker::default() };
    let (size, camera) = (known.spacing_m.max(1e-4), known.config.camera.camera());
    let cloud = PointCloud { points: known.points_m, normals: known.normals };
    let (low, high) = cloud.bounding_box();
    let extent = (high - low).norm().max(1e-3);

    let mut points = marker(0, "cloud", Marker::POINTS, size, CLOUD);
    let step = cloud.len().div_ceil(MOST_POINTS).max(1);
    points.points = cloud.points.iter().step_by(step).map(|p| (*p).into()).collect();
    let mut boundary = marker(1, "boundary", Marker::POINTS, 1.5 * size, BOUNDARY);
    let config = BoundaryConfig::default();
    let near = Neighborhoods::of(&cloud.points, config.neighbors);
    boundary.points = boundary_points(&cloud, &near, &config).into_iter().map(|i| cloud.points[i].into()).collect();

    let width = 0.002 * extent;
    let mut candidates = marker(2, "candidates", Marker::LINE_LIST, width, RULED_OUT);
    let allowed = || answer.candidates.iter().filter(|c| c.objections.is_empty()).map(|c| c.score);
    let (worst, best) = allowed().fold((f64::INFINITY, f64::NEG_INFINITY), |(w, b), s| (w.min(s), b.max(s)));
    for candidate in &answer.candidates {
        let share = if best > worst { (candidate.score - worst) / (best - worst) } else { 1.0 };
        let color = if candidate.objections.is_empty() { by_score(share) } else { RULED_OUT };
        let lines = frustum(candidate, &camera, 0.12 * extent);
        candidates.colors.extend(lines.iter().map(|_| color));
        candidates.points.extend(lines);
    }
    let mut next = marker(3, "next_view", Marker::LINE_LIST, 2.0 * width, NEXT);
    if let Some(view) = answer.next.as_ref().filter(|_| !answer.stop.stop) {
        next.points = frustum(view, &camera, 0.3 * extent);
        next.points.extend([view.position_m, view.target_m].map(|p| Vector3::from(Point3::from(p))));
    }
    // A list without points is an error to RViz.
    let shown = [points, boundary, candidates, next].into_iter().filter(|m| !m.points.is_empty());
    MarkerArray { markers: [clear].into_iter().chain(shown).collect() }
}

/// The edges of a view's frustum, two points each.
fn frustum(candidate: &Candidate, camera: &PinholeCamera, depth: f64) -> Vec<Vector3> {
    let m = &candidate.world_from_camera.matrix;
    let corners = camera.frustum(depth).map(|p| {
        let at = |row: usize| m[row][0] * p.x + m[row][1] * p.y + m[row][2] * p.z + m[row][3];
        Vector3 { x: at(0), y: at(1), z: at(2) }
    });
    (1..5).flat_map(|i| [corners[0], corners[i], corners[i], corners[i % 4 + 1]]).collect()
}
