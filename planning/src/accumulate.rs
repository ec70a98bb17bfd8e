//! Every way of merging scans into the accumulated cloud.

use crate::config::SessionConfig;
use crate::scan::PreparedScan;
use crate::thin;
use geometry::coverage::matched_surface;
use geometry::{PointCloud, VoxelOrigin};
use nalgebra::Point3;

/// What the accumulated cloud consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accumulate {
    /// Points as they were measured, none nearer to another than a radius: the rule moves with the cloud.
    #[default]
    Thinned,
    /// The points measured, averaged in voxels that stay where they are.
    #[serde(alias = "measured")]
    Averaged,
    /// As published: the reference points matched so far. Planners then see samples of the true surface.
    Matched,
}

impl Accumulate {
    /// Where the voxels lie that average a cloud.
    pub fn voxel_origin(self) -> VoxelOrigin {
        match self {
            Self::Matched => VoxelOrigin::CloudMinimum,
            Self::Thinned | Self::Averaged => VoxelOrigin::World,
        }
    }
}

/// The points of all scans, thinned.
pub(crate) fn all_thinned(scans: &[PreparedScan], grid_size: f64, config: &SessionConfig) -> PointCloud {
    let mut cloud = PointCloud::default();
    scans.iter().for_each(|scan| cloud.merge(&scan.cloud));
    if scans.len() == 1 {
        return cloud;
    }
    let kept = thinned(&cloud.points, grid_size, config.max_points, config.seed);
    thin::select(&cloud, &kept)
}

/// The cloud and a scan, averaged in voxels of `grid_size` metres.
pub fn averaged(cloud: &PointCloud, scan: &PointCloud, grid_size: f64, origin: VoxelOrigin) -> PointCloud {
    let mut merged = cloud.clone();
    merged.merge(scan);
    merged.voxel_downsample(grid_size, origin)
}

/// As published: the reference points within `tolerance` of the averaged cloud; of the first scan itself.
pub fn matched(
    cloud: &PointCloud,
    scan: &PointCloud,
    reference: &[Point3<f64>],
    grid_size: f64,
    tolerance: f64,
) -> PointCloud {
    if cloud.is_empty() {
        return matched_surface(scan, reference, tolerance);
    }
    matched_surface(&averaged(cloud, scan, grid_size, VoxelOrigin::CloudMinimum), reference, tolerance)
}

/// Indices of the points of all scans together that stay: about as dense as averaging with the grid size would leave
/// them, and about `max_points` of them at most.
pub fn thinned(points: &[Point3<f64>], grid_size: f64, max_points: usize, seed: u64) -> Vec<usize> {
    let least = 0.73 * grid_size;
    let kept = thin::thin(points, least);
    if max_points == 0 || kept.len() <= max_points {
        return kept;
    }
    let left: Vec<Point3<f64>> = kept.iter().map(|&i| points[i]).collect();
    let spacing = thin::spacing_of_all(&left, max_points, seed);
    thin::thin_to(points, thin::radius_for(&left, max_points, spacing, seed).max(least), max_points, seed).indices
}

/// Surface samples averaged like the cloud: what coverage is a share of.
pub fn reference_surface(samples: &[Point3<f64>], grid_size: f64, accumulate: Accumulate) -> Vec<Point3<f64>> {
    let cloud = PointCloud { points: samples.to_vec(), normals: Vec::new() };
    cloud.voxel_downsample(grid_size, accumulate.voxel_origin()).points
}
