//! One scan as the user gives it, and made ready for planning.

mod lines;

use crate::accumulate::Accumulate;
use crate::config::SessionConfig;
use crate::doubt::{self, PositionDoubt};
use crate::estimate::estimated_scans;
use crate::normals;
use crate::registration::Registered;
use crate::sensor::Dropped;
use crate::support::{self, Plane};
use crate::thin;
use crate::{Budget, CameraPose, NoReturn, PastScan, Seen, Stopped};
use geometry::{
    BoundaryConfig, DepthImage, NeighborGrid, Neighborhoods, PinholeCamera, PointCloud, View, mean_spacing,
    orient_normals_along, orient_normals_consistent, orient_normals_toward,
};
use lines::{abreast, orient_normals_abreast, pieces};
use nalgebra::{Isometry3, Point3, Vector3};
use std::hash::{DefaultHasher, Hasher};
use std::sync::Arc;

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

/// What was done with a scan's points.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ScanReport {
    /// Points given.
    pub read: usize,
    /// With a coordinate that is not finite (pixels without a return, in organised clouds).
    pub not_finite: usize,
    /// With a coordinate beyond [`FARTHEST_M`], as the marks of some sensors for no return are.
    #[serde(default)]
    pub out_of_range: usize,
    /// Nearer or farther than the sensor measures.
    #[serde(default)]
    pub beyond_sensor: usize,
    /// Pixels in the middle of a jump in depth.
    #[serde(default)]
    pub mixed_pixels: usize,
    /// On what the object stands on, or under it.
    #[serde(default)]
    pub on_support: usize,
    /// Outside the region of interest.
    pub outside_region: usize,
    /// Dropped as far from all others.
    pub outliers: usize,
    /// Dropped as equal to another.
    #[serde(default)]
    pub duplicates: usize,
    /// Dropped by thinning.
    pub thinned: usize,
    /// Normals that were missing and were estimated.
    #[serde(default)]
    pub normals_estimated: usize,
    /// Normals that pointed away from the camera and were turned.
    #[serde(default)]
    pub normals_turned: usize,
    /// Whether the normals given were ignored: too few, or not standing on the surface.
    #[serde(default)]
    pub normals_ignored: bool,
    /// Used for planning.
    pub used: usize,
    /// What registering it found, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<Box<Registered>>,
}

impl ScanReport {
    /// One line for people.
    pub fn describe(&self) -> String {
        let mut line = format!("{} points", self.read);
        let parts = [
            (self.not_finite, "without a position"),
            (self.out_of_range, "farther away than a million metres"),
            (self.beyond_sensor, "out of the sensor's range"),
            (self.mixed_pixels, "mixed of two depths"),
            (self.on_support, "of the support"),
            (self.outside_region, "outside the region"),
            (self.duplicates, "given twice"),
            (self.thinned, "thinned out"),
            (self.outliers, "outliers dropped"),
        ];
        for (count, what) in parts.into_iter().filter(|(count, _)| *count > 0) {
            line += &format!(", {count} {what}");
        }
        if self.used != self.read {
            line = format!("{line}: {} used", self.used);
        }
        self.registration.as_ref().map_or(line.clone(), |found| format!("{line}; {}", found.describe()))
    }
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
    /// Whether what the object stands on was found in it.
    pub shows_support: bool,
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
    let (mut dropped, mut on_support) = (Dropped::default(), 0);
    let raw = match &mut scan {
        Scan::Cloud { cloud, .. } | Scan::Lines { cloud, .. } => std::mem::take(cloud),
        Scan::Depth { camera, depth, world_from_camera, .. } => {
            depth.depth.iter_mut().filter(|d| f64::from(**d) > FARTHEST_M).for_each(|d| *d = 0.0);
            dropped = config.sensor.clean(depth, camera);
            on_support = support::clear(depth, camera, world_from_camera, plane, config.support_margin_m);
            PointCloud { points: depth.to_points(camera, world_from_camera), normals: Vec::new() }
        }
    };
    let read = raw.len() + dropped.range + dropped.mixed + on_support;
    let mut report = ScanReport {
        read,
        beyond_sensor: dropped.range,
        mixed_pixels: dropped.mixed,
        on_support,
        ..Default::default()
    };
    let finite = |i: &usize| raw.points[*i].iter().all(|x| x.abs() <= FARTHEST_M);
    let mut kept: Vec<usize> = (0..raw.len()).filter(finite).collect();
    let far = |p: &&Point3<f64>| p.iter().all(|x| x.is_finite()) && p.coords.amax() > FARTHEST_M;
    report.out_of_range = raw.points.iter().filter(far).count();
    report.not_finite = raw.len() - kept.len() - report.out_of_range;
    let is_image = matches!(scan, Scan::Depth { .. });
    if let Some(plane) = plane.filter(|_| !is_image) {
        let before = kept.len();
        kept.retain(|&i| plane.height(&raw.points[i]) > config.support_margin_m);
        report.on_support = before - kept.len();
    }
    if !is_image {
        let before = kept.len();
        let reaches = |p: &Point3<f64>| scan.seen_from(p).is_none_or(|from| config.sensor.reaches((p - from).norm()));
        kept.retain(|&i| reaches(&raw.points[i]));
        report.beyond_sensor = before - kept.len();
    }
    if let Some([low, high]) = config.region_m {
        let before = kept.len();
        kept.retain(|&i| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&raw.points[i][axis])));
        report.outside_region = before - kept.len();
    }
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
        None => past_scans(scan, &cloud.points),
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
            shows_support: false,
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

/// What a planner may know of a scan with these points; nothing where the camera is unknown.
fn past_scans(scan: Scan, points: &[Point3<f64>]) -> Vec<PastScan> {
    match scan {
        Scan::Depth { camera, depth, world_from_camera, misses } => {
            vec![PastScan { world_from_camera, seen: Seen::Depth { camera, depth, misses }, pose: Default::default() }]
        }
        Scan::Cloud { from, .. } => from.map(|position| seen_from(position, points.to_vec())).into_iter().collect(),
        Scan::Lines { path, .. } => {
            pieces(&path, points).into_iter().map(|(at, points)| seen_from(at, points)).collect()
        }
    }
}

/// Points as seen from a position. The orientation is not known and does not matter: it looks at the middle of what it saw.
fn seen_from(position: Point3<f64>, points: Vec<Point3<f64>>) -> PastScan {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let view = View { target: Point3::from(sum / points.len().max(1) as f64), position };
    PastScan { world_from_camera: view.world_from_camera(), seen: Seen::Points(points), pose: Default::default() }
}
