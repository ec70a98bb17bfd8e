//! One scan as the user gives it, and made ready for planning.

use crate::config::InferConfig;
use crate::thin;
use geometry::{
    BoundaryConfig, DepthImage, Misses, NeighborGrid, Neighborhoods, PastScan, PinholeCamera, PointCloud, Seen, View,
    mean_spacing_among, normals_of, orient_normals_toward,
};
use nalgebra::{Isometry3, Point3};

/// Neighbours of a normal (method, 'Setting').
pub(crate) const NORMAL_NEIGHBORS: usize = 20;
/// Fewer points give no surface to plan on.
pub const MIN_POINTS: usize = 30;

/// What a scan is known by, world frame, metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Scan {
    /// A cloud, and the camera's position if it is known.
    Cloud {
        /// Points, with normals towards the camera or without.
        cloud: PointCloud,
        /// Where it was taken from.
        from: Option<Point3<f64>>,
    },
    /// A depth image with its camera.
    Depth {
        /// Intrinsics.
        camera: PinholeCamera,
        /// The image.
        depth: DepthImage,
        /// The camera's pose.
        world_from_camera: Isometry3<f64>,
        /// What its pixels without a return mean.
        misses: Misses,
    },
}

impl Scan {
    /// Where the camera was, if known.
    pub fn camera_position(&self) -> Option<Point3<f64>> {
        match self {
            Self::Cloud { from, .. } => *from,
            Self::Depth { world_from_camera, .. } => Some(Point3::from(world_from_camera.translation.vector)),
        }
    }
}

/// What became of a scan's points.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ScanReport {
    /// Points given.
    pub read: usize,
    /// With a coordinate that is not finite (pixels without a return, in organised clouds).
    pub not_finite: usize,
    /// Outside the region of interest.
    pub outside_region: usize,
    /// Dropped as far from all others.
    pub outliers: usize,
    /// Dropped as duplicates or by thinning.
    pub thinned: usize,
    /// Used for planning.
    pub used: usize,
}

impl ScanReport {
    /// One line for people.
    pub fn describe(&self) -> String {
        let mut line = format!("{} points", self.read);
        let parts = [
            (self.not_finite, "without a position"),
            (self.outside_region, "outside the region"),
            (self.thinned, "thinned out"),
            (self.outliers, "outliers dropped"),
        ];
        for (count, what) in parts.into_iter().filter(|(count, _)| *count > 0) {
            line += &format!(", {count} {what}");
        }
        if self.used == self.read { line } else { format!("{line}: {} used", self.used) }
    }
}

/// A scan cleaned, thinned, with normals.
#[derive(Clone, Debug)]
pub(crate) struct PreparedScan {
    /// As it came; a cloud's points are moved to `cloud`.
    pub scan: Scan,
    /// Cleaned and thinned, with normals.
    pub cloud: PointCloud,
    /// Whether the normals are known to point towards the camera.
    pub oriented: bool,
    /// Mean distance of its points to the nearest other, metres.
    pub spacing: f64,
    pub report: ScanReport,
}

/// The neighbours of a cloud's points, found once for all: as many as the boundary asks for, which is the most.
pub(crate) fn neighborhoods(points: &[Point3<f64>]) -> Neighborhoods {
    NeighborGrid::new(points, 0.0).neighborhoods_in_parallel(points.len(), BoundaryConfig::default().neighbors)
}

/// Cleans and thins a scan and gives it normals; its points' neighbours come with it.
///
/// # Errors
/// The counts, where fewer than [`MIN_POINTS`] points remain.
pub(crate) fn prepare(mut scan: Scan, config: &InferConfig) -> Result<(PreparedScan, Neighborhoods), ScanReport> {
    let unprojected;
    let raw = match &mut scan {
        Scan::Cloud { cloud, .. } => &*cloud,
        Scan::Depth { camera, depth, world_from_camera, .. } => {
            unprojected = PointCloud { points: depth.to_points(camera, world_from_camera), normals: Vec::new() };
            &unprojected
        }
    };
    let mut report = ScanReport { read: raw.len(), ..Default::default() };
    let has_normals = raw.has_normals() && raw.normals.iter().any(|n| n.norm_squared() > 0.0);
    let finite = |i: &usize| {
        raw.points[*i].iter().all(|x| x.is_finite()) && (!has_normals || raw.normals[*i].iter().all(|x| x.is_finite()))
    };
    let mut kept: Vec<usize> = (0..raw.len()).filter(finite).collect();
    report.not_finite = raw.len() - kept.len();
    if let Some([low, high]) = config.region_m {
        let before = kept.len();
        kept.retain(|&i| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&raw.points[i][axis])));
        report.outside_region = before - kept.len();
    }
    let all = thin::select(raw, &kept);
    let radius = thin::radius_for(&all.points, config.max_points, config.seed);
    let mut cloud = thin::select(&all, &thin::thin(&all.points, radius));
    report.thinned = all.len() - cloud.len();
    let mut near = neighborhoods(&cloud.points);
    let inliers = thin::without_outliers(&near, config.outlier_factor);
    report.outliers = cloud.len() - inliers.len();
    if report.outliers > 0 {
        cloud = thin::select(&cloud, &inliers);
        near = neighborhoods(&cloud.points);
    }
    report.used = cloud.len();
    if cloud.len() < MIN_POINTS {
        return Err(report);
    }
    let mut oriented = has_normals;
    if !has_normals {
        cloud.normals = normals_of(&cloud.points, &near, NORMAL_NEIGHBORS);
        if let Some(from) = scan.camera_position() {
            orient_normals_toward(&mut cloud, &from);
            oriented = true;
        }
    }
    if let Scan::Cloud { cloud: given, .. } = &mut scan {
        *given = PointCloud::default();
    }
    let spacing = mean_spacing_among(&cloud.points, &near);
    Ok((PreparedScan { scan, cloud, oriented, spacing, report }, near))
}

impl PreparedScan {
    /// What a planner may know of this scan; `None` where the camera is unknown.
    pub fn past_scan(&self) -> Option<PastScan> {
        match &self.scan {
            Scan::Depth { camera, depth, world_from_camera, misses } => Some(PastScan {
                world_from_camera: *world_from_camera,
                seen: Seen::Depth { camera: *camera, depth: depth.clone(), misses: *misses },
            }),
            Scan::Cloud { from, .. } => {
                let position = (*from)?;
                // The orientation is not known and does not matter: it looks at the middle of what it saw.
                let sum: nalgebra::Vector3<f64> = self.cloud.points.iter().map(|p| p.coords).sum();
                let view = View { target: Point3::from(sum / self.cloud.len() as f64), position };
                let seen = Seen::Points(self.cloud.points.clone());
                Some(PastScan { world_from_camera: view.world_from_camera(), seen })
            }
        }
    }
}
