//! Candidate views at the boundary of a cloud (docs/method.md, 'Boundary and candidate views').

use geometry::boundary::{BoundaryConfig, boundary_points};
use geometry::cluster::{nearest_neighbor_order, representatives};
use geometry::density::density_from;
use geometry::neighbors::Neighborhoods;
use geometry::{PointCloud, View};
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use rand_chacha::ChaCha8Rng;

/// A candidate for the next view, made at a boundary point of the cloud (method, 'Boundary and candidate views').
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CandidateView {
    /// Target (the boundary point) and camera position.
    pub view: View,
    /// Density at the target: 1 / (mean distance to 30 nearest neighbours + 1e-6), not yet divided by the
    /// maximum over the candidates.
    pub density: f64,
}

impl CandidateView {
    /// Unit vector from the target to the camera.
    pub fn direction(&self) -> Vector3<f64> {
        self.view.direction()
    }
}

/// Input of the network, before it becomes tensors: the accumulated cloud, the ordered candidates, the number of
/// scans done minus one, and where they were taken from.
#[derive(Clone, Debug)]
pub struct Observation<'a> {
    /// The accumulated cloud with normals, not resampled.
    pub cloud: &'a PointCloud,
    /// Candidates in the order of the greedy traversal.
    pub candidates: &'a [CandidateView],
    /// Number of scans done minus one: 0 for the first decision.
    pub view_order: usize,
    /// Working distance in metres (the `cloud` normalisation scales it).
    pub working_distance: f64,
    /// Positions of the past cameras, given or estimated, world frame, in any order; empty where they are not known.
    pub cameras: Vec<Point3<f64>>,
}

/// Which of the tilts a target gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Angles {
    /// One: the first, second, third, first ... with the position in the order, as published.
    #[default]
    Cycle,
    /// All of them, in a row: three times as many candidates.
    All,
}

/// Settings of the candidate views.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CandidateConfig {
    /// Number of boundary targets: k of the k-means (20). Fewer where the boundary has fewer points.
    pub num_targets: usize,
    /// Tilts of the viewing direction against the normal: negative leans out over the unseen side (-45, 0, 45).
    pub tilts_deg: Vec<f64>,
    /// Which of the tilts each target gets.
    pub angles: Angles,
    /// Turn by the full tilt about the unit axis. Off, the turn is shortened by |u x n| as in the published code.
    pub unit_axis: bool,
    /// The boundary criterion.
    pub boundary: BoundaryConfig,
}

impl Default for CandidateConfig {
    fn default() -> Self {
        Self {
            num_targets: 20,
            tilts_deg: vec![-45.0, 0.0, 45.0],
            angles: Angles::Cycle,
            unit_axis: true,
            boundary: BoundaryConfig::default(),
        }
    }
}

impl CandidateConfig {
    /// As published: the shortened turn and the frame of the published boundary criterion.
    pub fn paper() -> Self {
        let boundary = BoundaryConfig { published_frame: true, ..BoundaryConfig::default() };
        Self { unit_axis: false, boundary, ..Self::default() }
    }

    /// Most candidates that a decision can have.
    pub fn max_candidates(&self) -> usize {
        match self.angles {
            Angles::Cycle => self.num_targets,
            Angles::All => self.num_targets * self.tilts_deg.len(),
        }
    }
}

/// The candidates, in the order of the greedy traversal of their targets, each `working_distance` metres from its
/// target, by the neighbourhoods of `config.boundary.neighbors` points. Empty if the cloud has no boundary or no normals. A target with a zero normal gives none; one without
/// an outward direction (its neighbours surround it evenly) is looked at along its normal.
pub fn candidate_views(
    cloud: &PointCloud,
    neighborhoods: &Neighborhoods,
    working_distance: f64,
    config: &CandidateConfig,
    rng: &mut ChaCha8Rng,
) -> Vec<CandidateView> {
    let boundary = boundary_points(cloud, neighborhoods, &config.boundary);
    let positions: Vec<Point3<f64>> = boundary.iter().map(|&i| cloud.points[i]).collect();
    let chosen: Vec<usize> = representatives(&positions, config.num_targets, rng);
    let targets: Vec<Point3<f64>> = chosen.iter().map(|&i| positions[i]).collect();
    let ordered = nearest_neighbor_order(&targets).into_iter().map(|i| boundary[chosen[i]]);

    let mut candidates = Vec::with_capacity(config.max_candidates());
    let num_tilts = config.tilts_deg.len();
    for (position, i) in ordered.enumerate() {
        let target = cloud.points[i];
        let Some(normal) = cloud.normals[i].try_normalize(0.0) else { continue };
        let outward = outward_direction(cloud, neighborhoods, i);
        let density = density_from(neighborhoods.distance_sum(i), neighborhoods.k());
        let tilts = match config.angles {
            Angles::Cycle if num_tilts > 0 => &config.tilts_deg[position % num_tilts..][..1],
            _ => &config.tilts_deg[..],
        };
        candidates.extend(tilts.iter().map(|&tilt| {
            let direction = tilted(&normal, &outward, tilt.to_radians(), config.unit_axis);
            CandidateView { view: View { target, position: target + working_distance * direction }, density }
        }));
    }
    candidates
}

/// u: unit vector from the mean of the point's neighbours (itself excluded) to the point; zero if they coincide.
fn outward_direction(cloud: &PointCloud, neighborhoods: &Neighborhoods, i: usize) -> Vector3<f64> {
    let point = cloud.points[i];
    let others = || neighborhoods.ids(i).iter().filter(|&&id| id as usize != i);
    let sum = others().fold(Vector3::zeros(), |sum, &id| sum + (cloud.points[id as usize] - point));
    (-sum).try_normalize(1e-12).unwrap_or_else(Vector3::zeros)
}

/// The normal turned by `angle` about u x n.
fn tilted(normal: &Vector3<f64>, outward: &Vector3<f64>, angle: f64, unit_axis: bool) -> Vector3<f64> {
    match Unit::try_new_and_get(outward.cross(normal), 1e-9) {
        Some((axis, length)) => {
            let angle = if unit_axis { angle } else { angle * length };
            Rotation3::from_axis_angle(&axis, angle) * normal
        }
        None => *normal,
    }
}

#[cfg(test)]
mod tests;
