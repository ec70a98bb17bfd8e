//! What the scans themselves contradict: a camera position that cannot be, scans that do not fit each other.

use crate::answer::length;
use crate::estimate::{Samples, unhidden};
use geometry::{NeighborGrid, PointCloud};
use nalgebra::{Point3, Vector3};

/// Working distances, or diagonals of the cloud, that a camera may be away.
const FARTHEST: f64 = 100.0;
/// Share of the points that must be seen from the camera: 95 % of simulated scans are over 0.81.
const SEEN: f64 = 0.6;
/// The density of points speaks clearly where some camera leaves less than this of it unexplained (a root,
/// [`crate::estimate`]); and against a position that leaves more than this, and than that camera so many times: none of 1,281 true positions of
/// simulated and recorded scans, whole and cut, and 92 to 94 % of those at a right angle, in the middle of the points, or 1,000 times too near
/// (docs/log.md).
const CLEAR: f64 = 0.15;
const UNEXPLAINED: [f64; 2] = [0.35, 3.0];
/// What may speak for the side of the surface that the position is on, where the density and the edges together tell another.
const OTHER_SIDE: f64 = 0.35;
/// Points that have a density to tell.
const LEAST: usize = 300;
/// Points that are asked about the density, and about the fit to other scans.
const ASKED: usize = 1_500;

/// Why a camera position cannot be that of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub enum PositionDoubt {
    /// So far from the cloud, metres.
    TooFar(f64),
    /// In the cloud.
    Inside,
    /// This share of the points is hidden behind others from there.
    Hidden(f64),
    /// The density and the edges of the points say that they were seen from the other side.
    Behind,
    /// The density of the points says that they were seen from elsewhere.
    Elsewhere,
}

impl PositionDoubt {
    /// For people, after 'the camera position of scan 2'.
    pub fn describe(&self) -> String {
        match self {
            Self::TooFar(away) => format!("is {} from its points: a different unit?", length(*away)),
            Self::Inside => "lies in its points".to_owned(),
            Self::Hidden(share) => {
                format!("cannot see {:.0} % of its points, which are hidden behind others from there", 100.0 * share)
            }
            Self::Behind => "lies behind its surface, judging by the density of its points".to_owned(),
            Self::Elsewhere => "does not fit the density of its points, which were seen from elsewhere".to_owned(),
        }
    }
}

/// Why `from` cannot be where this cloud was scanned from; `None` where nothing speaks against it. `measured` are its points
/// before thinning, `distance` is the working distance.
pub fn of_position(
    cloud: &PointCloud,
    measured: &[Point3<f64>],
    from: &Point3<f64>,
    distance: f64,
    spacing: f64,
) -> Option<PositionDoubt> {
    let (low, high) = cloud.bounding_box();
    let (middle, diagonal) = (nalgebra::center(&low, &high), (high - low).norm());
    let away = from - middle;
    if away.norm() > FARTHEST * distance.max(diagonal) {
        return Some(PositionDoubt::TooFar(away.norm()));
    }
    let nearest = cloud.points.iter().map(|p| (p - from).norm()).fold(f64::INFINITY, f64::min);
    if nearest < 2.0 * spacing {
        return Some(PositionDoubt::Inside);
    }
    let seen = unhidden(cloud, from, spacing);
    if seen < SEEN {
        return Some(PositionDoubt::Hidden(1.0 - seen));
    }
    if cloud.len() < LEAST {
        return None;
    }
    let samples = Samples::of(cloud, measured, spacing, ASKED);
    // A position in the points has no distance to fit a camera at.
    let told = samples.direction(away.norm().max(distance)).filter(|told| told.trust.misfit < CLEAR)?;
    let [most, times] = UNEXPLAINED;
    if samples.misfit_from(from) > most.max(times * told.trust.misfit) {
        return Some(PositionDoubt::Elsewhere);
    }
    let clear = told.by_density < 1.0 && told.trust.against_other_side < OTHER_SIDE;
    (clear && told.direction.dot(&away) < 0.0).then_some(PositionDoubt::Behind)
}

/// Why a line scanner cannot have moved along this path; `None` where nothing speaks against it. What is hidden and how dense points are
/// is not asked: they were seen from all along it.
pub fn of_path(cloud: &PointCloud, path: &[Point3<f64>; 2], distance: f64, spacing: f64) -> Option<PositionDoubt> {
    let along = (path[1] - path[0]).try_normalize(0.0)?;
    let away = |p: &Point3<f64>| {
        let from = p - path[0];
        (from - along * from.dot(&along)).norm()
    };
    let (low, high) = cloud.bounding_box();
    let middle = away(&nalgebra::center(&low, &high));
    if middle > FARTHEST * distance.max((high - low).norm()) {
        return Some(PositionDoubt::TooFar(middle));
    }
    let nearest = cloud.points.iter().map(away).fold(f64::INFINITY, f64::min);
    (nearest < 2.0 * spacing).then_some(PositionDoubt::Inside)
}

/// How far apart two scans lie where both should be the same surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// Median distance along the normals, metres.
    pub apart_m: f64,
    /// What points of one scan are apart in that way.
    pub noise_m: f64,
    /// Share of the new scan's points that are near enough to the others to compare.
    pub shared: f64,
}

impl Offset {
    /// Whether they do not fit: apart by clearly more than the noise and than a part of the tolerance.
    pub fn is_misfit(&self, tolerance: f64) -> bool {
        self.shared >= 0.02 && self.apart_m > 2.5 * self.noise_m + 0.3 * tolerance
    }
}

/// Holds a scan against the cloud of those before it, within some tolerances or spacings; `None` where nothing is near.
pub fn offset(old: &PointCloud, new: &PointCloud, tolerance: f64, spacing: f64) -> Option<Offset> {
    let reach = (6.0 * tolerance).max(4.0 * spacing);
    let grid = NeighborGrid::new(&old.points, reach);
    // Not beyond the edge of the other scan, where a curved surface leads away from its nearest points.
    let beside = 2.0 * spacing;
    // How far the nearest other point of the same side of the surface is along the normal of this one.
    let along = |cloud: &PointCloud, p: &Point3<f64>, n: &Vector3<f64>, grid: &NeighborGrid, own: bool| {
        let n = n.try_normalize(0.0)?;
        let (mut least, mut found) = (reach * reach, None);
        grid.for_each_within(p, reach, |j| {
            let d = cloud.points[j] - p;
            let d2 = d.norm_squared();
            let same_side = cloud.normals.get(j).is_some_and(|m| n.dot(m) > 0.5 * m.norm());
            if d2 < least && same_side && !(own && d2 == 0.0) {
                (least, found) = (d2, Some(d));
            }
        });
        let d = found?;
        let apart = n.dot(&d);
        ((d - n * apart).norm() <= beside).then_some(apart.abs())
    };
    let few = |cloud: &PointCloud| {
        let step = cloud.len().div_ceil(ASKED).max(1);
        (0..cloud.len()).step_by(step).collect::<Vec<_>>()
    };
    let asked = few(new);
    let mut apart: Vec<f64> =
        asked.iter().filter_map(|&i| along(old, &new.points[i], new.normals.get(i)?, &grid, false)).collect();
    let own = NeighborGrid::new(&new.points, reach);
    let mut noise: Vec<f64> =
        asked.iter().filter_map(|&i| along(new, &new.points[i], new.normals.get(i)?, &own, true)).collect();
    let shared = apart.len() as f64 / asked.len().max(1) as f64;
    Some(Offset { apart_m: median(&mut apart)?, noise_m: median(&mut noise)?, shared })
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests;
