//! Which points of a scan are used, and what is done with the others.

use super::veil::LeftOut;
use super::{FARTHEST_M, Scan, ScanReport};
use crate::config::SessionConfig;
use crate::support::{self, Plane, Support};
use geometry::{DepthImage, PinholeCamera, PointCloud};
use nalgebra::{Isometry3, Point3};

/// Points nearer to the camera than this share of the working distance are marks that stand for no return: they tell no support.
const AT_CAMERA: f64 = 1e-3;

/// A scan's points, sorted.
pub(super) struct Sifted {
    /// As they came; of an image those that are left of it.
    pub raw: PointCloud,
    /// Those that are used, rising.
    pub kept: Vec<usize>,
    pub report: ScanReport,
    /// What the object stands on, where it was looked for and these points show it.
    pub shows_support: Option<Plane>,
    /// Points of what it stands on, and of what lies under that, as obstacles.
    pub stood_on: Vec<Point3<f64>>,
    /// Points of a cloud that were measured and are neither used nor of what it stands on.
    pub left_out: Vec<LeftOut>,
}

/// Sorts a scan's points, and clears its image of those that are not believed and of what the object stands on: `known`, or else found
/// here if the settings say so.
pub(super) fn sift(scan: &mut Scan, config: &SessionConfig, known: Option<&Plane>) -> Sifted {
    let mut sifted = match scan {
        Scan::Depth { camera, depth, world_from_camera, .. } => {
            of_image(camera, depth, world_from_camera, config, known)
        }
        Scan::Cloud { cloud, .. } | Scan::Lines { cloud, .. } => {
            let raw = std::mem::take(cloud);
            of_cloud(raw, scan, config, known)
        }
    };
    // An image has what is cut away in it still.
    let is_cloud = !matches!(scan, Scan::Depth { .. });
    let Sifted { raw, kept, report, left_out, .. } = &mut sifted;
    let before = kept.len();
    kept.retain(|&i| {
        let point = raw.points[i];
        let inside = in_region(config, &point);
        if is_cloud && !inside {
            left_out.push(LeftOut { point, believed: true });
        }
        inside
    });
    report.outside_region = before - kept.len();
    sifted
}

fn of_image(
    camera: &PinholeCamera,
    depth: &mut DepthImage,
    world_from_camera: &Isometry3<f64>,
    config: &SessionConfig,
    known: Option<&Plane>,
) -> Sifted {
    depth.depth.iter_mut().filter(|d| f64::from(**d) > FARTHEST_M).for_each(|d| *d = 0.0);
    let dropped = config.sensor.clean(depth, camera);
    let shows_support = if looks_for_support(config, known) {
        let points = depth.to_points(camera, world_from_camera);
        find_support(&points.into_iter().filter(is_place).collect::<Vec<_>>(), config)
    } else {
        None
    };
    let plane = known.or(shows_support.as_ref());
    let on = support::clear(depth, camera, world_from_camera, plane, config.support_margin_m);
    let raw = PointCloud { points: depth.to_points(camera, world_from_camera), normals: Vec::new() };
    let mut report = ScanReport {
        read: raw.len() + dropped.range + dropped.mixed + on.len(),
        beyond_sensor: dropped.range,
        mixed_pixels: dropped.mixed,
        on_support: on.len(),
        ..Default::default()
    };
    let kept = places(&raw.points, &mut report);
    let stood_on = support::obstacles(&on, config.seed);
    Sifted { raw, kept, report, shows_support, stood_on, left_out: Vec::new() }
}

fn of_cloud(raw: PointCloud, scan: &Scan, config: &SessionConfig, known: Option<&Plane>) -> Sifted {
    let mut report = ScanReport { read: raw.len(), ..Default::default() };
    let mut kept = places(&raw.points, &mut report);
    let away = |p: &Point3<f64>| scan.seen_from(p).map(|from| (p - from).norm());
    let mut left_out = Vec::new();
    kept.retain(|&i| {
        let point = raw.points[i];
        let reaches = away(&point).is_none_or(|distance| config.sensor.reaches(distance));
        if !reaches {
            left_out.push(LeftOut { point, believed: false });
        }
        reaches
    });
    report.beyond_sensor = left_out.len();
    let shows_support = if looks_for_support(config, known) {
        let measured =
            |p: &Point3<f64>| away(p).is_none_or(|distance| distance > AT_CAMERA * config.working_distance_m);
        let points = kept.iter().map(|&i| raw.points[i]).filter(measured);
        find_support(&points.collect::<Vec<_>>(), config)
    } else {
        None
    };
    let mut on = Vec::new();
    if let Some(plane) = known.or(shows_support.as_ref()) {
        kept.retain(|&i| {
            let above = plane.height(&raw.points[i]) > config.support_margin_m;
            if !above {
                on.push(raw.points[i]);
            }
            above
        });
    }
    report.on_support = on.len();
    let stood_on = support::obstacles(&on, config.seed);
    Sifted { raw, kept, report, shows_support, stood_on, left_out }
}

/// The points that are places, the others counted.
fn places(points: &[Point3<f64>], report: &mut ScanReport) -> Vec<usize> {
    let kept: Vec<usize> = (0..points.len()).filter(|&i| is_place(&points[i])).collect();
    let far = |p: &&Point3<f64>| p.iter().all(|x| x.is_finite()) && p.coords.amax() > FARTHEST_M;
    report.out_of_range = points.iter().filter(far).count();
    report.not_finite = points.len() - kept.len() - report.out_of_range;
    kept
}

fn is_place(p: &Point3<f64>) -> bool {
    p.iter().all(|x| x.abs() <= FARTHEST_M)
}

fn in_region(config: &SessionConfig, p: &Point3<f64>) -> bool {
    config.region_m.is_none_or(|[low, high]| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis])))
}

fn looks_for_support(config: &SessionConfig, known: Option<&Plane>) -> bool {
    known.is_none() && config.support == Support::Auto
}

/// What the object stands on, where these points show it: those in the region of interest, or else all.
fn find_support(points: &[Point3<f64>], config: &SessionConfig) -> Option<Plane> {
    let tolerance = config.tolerance_m.max(0.5 * config.support_margin_m);
    let find = |points: &[Point3<f64>]| support::find(points, &config.constraints.up(), tolerance, config.seed);
    let inside: Vec<Point3<f64>> = points.iter().filter(|p| in_region(config, p)).copied().collect();
    let found = find(&inside);
    if inside.len() < points.len() { found.or_else(|| find(points)) } else { found }
}
