//! Coverage, overlap, and the score that weighs them (docs/method.md, 'Setting' and 'Score').

use crate::PointCloud;
use crate::neighbors::NeighborGrid;
use nalgebra::Point3;

/// What a candidate view brings.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ViewScore {
    /// Coverage after adding the scan, in [0, 1].
    pub coverage: f64,
    /// Overlap of the scan with the cloud before it; `None` if the scan is empty.
    pub overlap: Option<f64>,
    /// W C + (1 - W) OR(O).
    pub score: f64,
}

/// Share of the surface points that have a cloud point strictly closer than `tolerance` metres; 0 for an empty
/// surface.
///
/// ```
/// use nalgebra::Point3;
///
/// let surface: Vec<_> = (0..100).map(|i| Point3::new(0.01 * f64::from(i), 0.0, 0.0)).collect();
/// assert_eq!(geometry::coverage(&surface[..50], &surface, 0.002), 0.5);
/// ```
pub fn coverage(cloud: &[Point3<f64>], surface: &[Point3<f64>], tolerance: f64) -> f64 {
    share_within(surface, &NeighborGrid::new(cloud, 2.0 * tolerance), tolerance).unwrap_or(0.0)
}

/// Share of the scan's points that have a point of the cloud strictly closer than `tolerance` metres; `None` for an
/// empty scan.
///
/// ```
/// use nalgebra::Point3;
///
/// let points: Vec<_> = (0..100).map(|i| Point3::new(0.01 * f64::from(i), 0.0, 0.0)).collect();
/// assert_eq!(geometry::overlap(&points[40..60], &points[..50], 0.002), Some(0.5));
/// assert_eq!(geometry::overlap(&[], &points, 0.002), None);
/// ```
pub fn overlap(scan: &[Point3<f64>], cloud: &[Point3<f64>], tolerance: f64) -> Option<f64> {
    share_within(scan, &NeighborGrid::new(cloud, 2.0 * tolerance), tolerance)
}

/// Share of the points that have a point of the grid strictly closer than `tolerance` metres; `None` without points.
pub fn share_within(points: &[Point3<f64>], grid: &NeighborGrid, tolerance: f64) -> Option<f64> {
    let close = points.iter().filter(|p| grid.any_within(p, tolerance)).count();
    (!points.is_empty()).then(|| close as f64 / points.len() as f64)
}

/// The surface points that have a cloud point strictly closer than `tolerance` metres, in their order, each with the
/// normal of the nearest cloud point: what the published code keeps as its accumulated cloud (docs/method.md,
/// 'Setting').
pub fn matched_surface(cloud: &PointCloud, surface: &[Point3<f64>], tolerance: f64) -> PointCloud {
    let grid = NeighborGrid::new(&cloud.points, 2.0 * tolerance);
    let mut matched = PointCloud::default();
    for p in surface {
        if let Some(nearest) = grid.nearest_within(p, tolerance) {
            matched.points.push(*p);
            if cloud.has_normals() {
                matched.normals.push(cloud.normals[nearest.index]);
            }
        }
    }
    matched
}

/// OR(O): rewards an overlap between 0.4 and 0.5 with 1, falls to 0 at 0 and at 1.
pub fn overlap_response(overlap: f64) -> f64 {
    if overlap < 0.4 {
        -6.25 * overlap * overlap + 5.0 * overlap
    } else if overlap <= 0.5 {
        1.0
    } else {
        -4.0 * overlap * overlap + 4.0 * overlap
    }
}

/// W: weight of coverage against overlap, from the coverage before the scan.
pub fn coverage_weight(current_coverage: f64) -> f64 {
    1.0 / (1.0 + (-10.0 * (current_coverage - 0.5)).exp())
}

/// s = W C + (1 - W) OR(O) with W from the coverage before the scan. An empty scan (`None`) has no overlap: OR = 0.
///
/// ```
/// // Early on overlap counts, later coverage.
/// let [early, late] = [0.1, 0.9].map(|covered| geometry::score_view(0.95, Some(0.45), covered).score);
/// assert!(early > 0.99 && late < 0.96);
/// ```
pub fn score_view(coverage: f64, overlap: Option<f64>, current_coverage: f64) -> ViewScore {
    let weight = coverage_weight(current_coverage);
    let response = overlap.map_or(0.0, overlap_response);
    ViewScore { coverage, overlap, score: weight * coverage + (1.0 - weight) * response }
}

#[cfg(test)]
mod tests;
