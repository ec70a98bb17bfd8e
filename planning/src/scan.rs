//! One scan as the user gives it, and made ready for planning.

mod lines;
mod past;
mod report;
mod sift;
pub(crate) mod veil;

use crate::accumulate::Accumulate;
use crate::config::SessionConfig;
use crate::doubt::{self, PositionDoubt};
use crate::estimate::estimated_scans;
use crate::normals;
use crate::support::Plane;
use crate::thin;
use crate::{Budget, CameraPose, NoReturn, PastScan, Stopped};
use geometry::{
    BoundaryConfig, DepthImage, NeighborGrid, Neighborhoods, PinholeCamera, PointCloud, mean_spacing,
    orient_normals_along, orient_normals_consistent, orient_normals_toward,
};
use lines::{abreast, orient_normals_abreast};
use nalgebra::{Isometry3, Point3, Vector3};
use past::past_scans;
use sift::{Sifted, sift};
use std::hash::{DefaultHasher, Hasher};
use std::sync::Arc;

pub use report::ScanReport;
pub use veil::Veil;

/// Neighbours over which the sign of normals is carried where no camera is known (10).
const ORIENTATION_NEIGHBORS: usize = 10;
/// Neighbours of a normal (20).
pub(crate) const NORMAL_NEIGHBORS: usize = 20;

/// Coordinates farther from the origin than this are none, metres: marks such as 1e30 that stand for no return.
pub const FARTHEST_M: f64 = 1e6;

/// A cloud that is smaller across is none, metres.
pub const SMALLEST_M: f64 = 1e-6;

/// Why a scan cannot be planned on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Refusal {
    /// What was done with its points.
    TooFew(ScanReport),
    /// How large it is, metres.
    TooSmall(f64),
    /// It took too long.
    Stopped(Stopped),
}

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
    /// A cloud of a line scanner, which measures one line of points at a time across the direction in which it moves.
    Lines {
        /// Points, with normals towards the scanner or without.
        cloud: PointCloud,
        /// Where it was at its first and at its last line, or any two other points of its straight path.
        path: [Point3<f64>; 2],
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
        misses: NoReturn,
    },
}

impl Scan {
    /// Where the camera was, if known; of a line scanner the middle of its path.
    pub fn camera_position(&self) -> Option<Point3<f64>> {
        match self {
            Self::Cloud { from, .. } => *from,
            Self::Lines { path: [first, last], .. } => Some(nalgebra::center(first, last)),
            Self::Depth { world_from_camera, .. } => Some(Point3::from(world_from_camera.translation.vector)),
        }
    }

    /// Where the camera was when it measured this point, if known.
    fn seen_from(&self, point: &Point3<f64>) -> Option<Point3<f64>> {
        match self {
            Self::Lines { path, .. } => Some(abreast(path, point)),
            _ => self.camera_position(),
        }
    }
}

/// How a scan was read, where it was a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// What the user should know: what was guessed, what was left out.
    pub notes: Vec<String>,
    /// Metres per unit of its numbers; `None` where that is not known.
    pub metres_per_unit: Option<f64>,
    /// The turntable's angle, degrees, where the scan is in the cell's frame; else it is in the object's.
    pub table_angle_deg: Option<f64>,
}

/// A scan cleaned, thinned, with normals.
#[derive(Clone, Debug)]
pub(crate) struct PreparedScan {
    /// What a planner may know of it: one scan; several, or none, where the camera is not known.
    pub past: Vec<Arc<PastScan>>,
    /// Cleaned and thinned, with normals.
    pub cloud: PointCloud,
    /// Mean distance of its points to the nearest other, metres.
    pub spacing: f64,
    /// The same before thinning.
    pub measured_spacing: f64,
    /// Tells its points, as they were given, from those of any other scan.
    pub fingerprint: u64,
    /// Why the camera position that came with it was not believed.
    pub doubt: Option<PositionDoubt>,
    /// Whether it was registered onto those before it.
    pub moved: bool,
    /// How it was adjusted since, oldest first, each with the number of the scan that was merged then.
    pub adjusted: Vec<(usize, Isometry3<f64>)>,
    /// Which scan of the session it is, from 1, and the one with which it was merged: a later one if it had to wait.
    pub number: usize,
    pub merged_with: usize,
    /// What the object stands on, where it was looked for in this scan and found.
    pub shows_support: Option<Plane>,
    /// Points of that, and of what lies under it, which are no part of the cloud: what an arm may touch.
    pub stood_on: Vec<Point3<f64>>,
    pub report: ScanReport,
    pub reading: Reading,
}

impl PreparedScan {
    /// Where the camera was, if known.
    pub fn camera_position(&self) -> Option<Point3<f64>> {
        let known = self.past.first().filter(|past| past.pose == CameraPose::Given);
        known.map(|past| Point3::from(past.world_from_camera.translation.vector))
    }
}

/// The neighbours of a cloud's points, found once for all: as many as the boundary asks for, which is the most.
pub(crate) fn neighborhoods(points: &[Point3<f64>]) -> Neighborhoods {
    NeighborGrid::new(points, 0.0).neighborhoods_in_parallel(points.len(), BoundaryConfig::default().neighbors)
}

/// Cleans and thins a scan and gives it normals; the neighbours of its points come with it where they were needed.
///
/// # Errors
/// Fewer than `min_points` points remain, they are nearer together than any sensor resolves, or it takes too long.
pub(crate) fn prepare(
    mut scan: Scan,
    config: &SessionConfig,
    plane: Option<&Plane>,
    budget: &Budget,
) -> Result<(PreparedScan, Option<Neighborhoods>), Refusal> {
    let Sifted { raw, kept, mut report, shows_support, stood_on, left_out } = sift(&mut scan, config, plane);
    let in_time = || budget.allows(false).map_err(Refusal::Stopped);
    in_time()?;
    let all = thin::select(&raw, &kept);
    let (low, high) = all.bounding_box();
    let across = (high - low).amax();
    if across > 0.0 && across < SMALLEST_M {
        return Err(Refusal::TooSmall(across));
    }
    let too_many = config.max_points > 0 && all.len() > config.max_points;
    let spacing_of_all = if too_many { thin::spacing_of_all(&all.points, config.max_points, config.seed) } else { 0.0 };
    in_time()?;
    let radius = thin::radius_for(&all.points, config.max_points, spacing_of_all, config.seed);
    let kept = thin::thin_to(&all.points, radius, config.max_points, config.seed);
    let mut cloud = thin::select(&all, &kept.indices);
    report.duplicates = kept.duplicates;
    report.thinned = all.len() - cloud.len() - kept.duplicates;
    in_time()?;
    let mut near = None;
    if config.outlier_factor > 0.0 {
        let found = neighborhoods(&cloud.points);
        let inliers = thin::without_outliers(&cloud.points, &found, config.outlier_factor);
        report.outliers = cloud.len() - inliers.len();
        near = Some(found);
        if report.outliers > 0 {
            cloud = thin::select(&cloud, &inliers);
            near = Some(neighborhoods(&cloud.points));
        }
    }
    report.used = cloud.len();
    if cloud.len() < config.min_points {
        return Err(Refusal::TooFew(report));
    }
    in_time()?;
    let forward = match &scan {
        Scan::Depth { world_from_camera, .. } => Some(world_from_camera * Vector3::z()),
        Scan::Cloud { .. } | Scan::Lines { .. } => None,
    };
    let settled = normals::settle(&mut cloud, near.as_ref());
    (report.normals_ignored, report.normals_estimated) = (settled.ignored, settled.estimated);
    // A known camera decides the sign, whatever a file says.
    let unturned = settled.signed.then(|| cloud.normals.clone());
    let mut oriented = if let (Accumulate::Matched, Some(forward)) = (config.accumulate, forward) {
        orient_normals_along(&mut cloud, &-forward);
        true
    } else if let Scan::Lines { path, .. } = &scan {
        orient_normals_abreast(&mut cloud, path);
        true
    } else if let Some(from) = scan.camera_position() {
        orient_normals_toward(&mut cloud, &from);
        true
    } else {
        settled.signed
    };
    in_time()?;
    let spacing = match &near {
        Some(near) => mean_spacing(&cloud.points, near),
        None => mean_spacing(&cloud.points, &Neighborhoods::of(&cloud.points, 2)),
    };
    let distance = config.working_distances().iter().sum::<f64>() / config.working_distances().len() as f64;
    let doubt = match &scan {
        Scan::Cloud { from: Some(from), .. } => doubt::of_position(&cloud, &all.points, from, distance, spacing),
        Scan::Lines { path, .. } => doubt::of_path(&cloud, path, distance, spacing),
        _ => None,
    };
    if let Some(unturned) = unturned {
        match doubt {
            // What is contradicted is not known: the file's own signs again.
            Some(_) => cloud.normals = unturned,
            None => report.normals_turned = unturned.iter().zip(&cloud.normals).filter(|(a, b)| a != b).count(),
        }
    } else {
        oriented &= doubt.is_none();
    }
    let mut past: Vec<PastScan> = match &doubt {
        Some(_) => Vec::new(),
        None => past_scans(scan, &cloud.points, &left_out),
    };
    if past.is_empty() && !cloud.is_empty() {
        if !oriented {
            let near = near.get_or_insert_with(|| neighborhoods(&cloud.points));
            orient_normals_consistent(&mut cloud, near, ORIENTATION_NEIGHBORS);
        }
        in_time()?;
        let measured = thin::sample(&all.points, 60_000, config.seed, "infer/density");
        past = estimated_scans(&mut cloud, &measured, distance, spacing);
    }
    let past = past.into_iter().map(Arc::new).collect();
    let measured_spacing = if report.thinned > 0 { spacing_of_all.min(spacing) } else { spacing };
    Ok((
        PreparedScan {
            past,
            cloud,
            spacing,
            measured_spacing,
            fingerprint: fingerprint(&all.points),
            doubt,
            moved: false,
            adjusted: Vec::new(),
            number: 0,
            merged_with: 0,
            shows_support,
            stood_on,
            report,
            reading: Reading::default(),
        },
        near,
    ))
}

fn fingerprint(points: &[Point3<f64>]) -> u64 {
    let mut hasher = DefaultHasher::new();
    points.iter().flat_map(|p| p.iter()).for_each(|x| hasher.write_u64(x.to_bits()));
    hasher.finish()
}
