//! Where a cloud was scanned from, told by the cloud itself: a surface shows its front to the camera, and from there no
//! part of it hides another.

use crate::{CameraPose, PastScan, Seen};
use geometry::{PointCloud, View, orient_normals_toward};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;

/// A cloud of which less than this share faces one camera is taken for several scans merged.
const FACING: f64 = 0.9;
/// Directions that are tried for the cameras of a merged cloud.
const DIRECTIONS: usize = 200;
/// Cosine between normal and direction under which a point does not count as seen.
const GRAZING: f64 = 0.3;
/// Cameras of a merged cloud: no more, once this share of its points is explained, or one explains less than that.
const MOST: usize = 16;
const EXPLAINED: f64 = 0.97;
const LEAST: f64 = 0.02;

/// The scans that a cloud without a known camera stands for, each with an estimated camera `distance` metres from the
/// middle of its points: one where the cloud faces one camera, whose normals are then turned towards it; else as many as
/// explain the points. The normals point outwards before ([`geometry::orient_normals_among`]).
pub fn estimated_scans(cloud: &mut PointCloud, distance: f64, spacing: f64) -> Vec<PastScan> {
    let middle = middle(&cloud.points);
    let sum: Vector3<f64> = cloud.normals.iter().filter_map(|n| n.try_normalize(0.0)).sum();
    let Some(direction) = sum.try_normalize(1e-9) else { return Vec::new() };
    let eye = middle + distance * direction;
    let facing = cloud.points.iter().zip(&cloud.normals).filter(|(p, n)| n.dot(&(eye - *p)) > 0.0).count();
    if facing as f64 >= FACING * cloud.len() as f64 {
        orient_normals_toward(cloud, &eye);
        return vec![scan(eye, cloud.points.clone())];
    }
    merged_scans(cloud, &middle, distance, spacing)
}

fn scan(position: Point3<f64>, points: Vec<Point3<f64>>) -> PastScan {
    let view = View { target: middle(&points), position };
    PastScan { world_from_camera: view.world_from_camera(), seen: Seen::Points(points), pose: CameraPose::Estimated }
}

fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64)
}

/// Greedily the direction from which most of the points not yet explained are seen.
fn merged_scans(cloud: &PointCloud, middle: &Point3<f64>, distance: f64, spacing: f64) -> Vec<PastScan> {
    let normals: Vec<Vector3<f64>> = cloud.normals.iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect();
    // Some of the cloud's own normals, so that the answer moves with it.
    let step = normals.len().div_ceil(DIRECTIONS).max(1);
    let directions: Vec<Vector3<f64>> = normals.iter().step_by(step).copied().filter(|n| n.norm() > 0.5).collect();
    let aside = |d: &Vector3<f64>| directions.iter().map(|other| d.cross(other)).find(|c| c.norm() > 0.1);
    let look = |d: &Vector3<f64>| match aside(d) {
        Some(u) => visible(cloud, &normals, middle, [d, &u.normalize()], 3.0 * spacing),
        None => Vec::new(),
    };
    let seen: Vec<Vec<usize>> = directions.par_iter().map(look).collect();
    let mut open = vec![true; cloud.len()];
    let mut left = cloud.len() as f64;
    let mut scans = Vec::new();
    while scans.len() < MOST && left > (1.0 - EXPLAINED) * cloud.len() as f64 {
        let explains =
            |k: usize| seen[k].iter().filter(|&&i| open[i]).map(|&i| normals[i].dot(&directions[k])).sum::<f64>();
        let values: Vec<f64> = (0..directions.len()).map(explains).collect();
        let Some(best) = (0..directions.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])) else { break };
        if values[best] < LEAST * cloud.len() as f64 {
            break;
        }
        for &i in &seen[best] {
            left -= f64::from(u8::from(std::mem::take(&mut open[i])));
        }
        let points = seen[best].iter().map(|&i| cloud.points[i]).collect();
        scans.push(scan(middle + distance * directions[best], points));
    }
    scans
}

/// Indices of the points that face a direction (the second is at a right angle to it) and are not behind others, in
/// cells of this width, metres.
fn visible(
    cloud: &PointCloud,
    normals: &[Vector3<f64>],
    middle: &Point3<f64>,
    [d, u]: [&Vector3<f64>; 2],
    cell: f64,
) -> Vec<usize> {
    let v = d.cross(u);
    let place = |p: &Point3<f64>| {
        let r = p - middle;
        let at = [r.dot(u), r.dot(&v)].map(|x| (x / cell).floor() as i64);
        (at, r.dot(d))
    };
    let mut front: HashMap<[i64; 2], f64> = HashMap::new();
    for p in &cloud.points {
        let (at, height) = place(p);
        front.entry(at).and_modify(|h| *h = h.max(height)).or_insert(height);
    }
    let seen = |&i: &usize| {
        let (at, height) = place(&cloud.points[i]);
        normals[i].dot(d) > GRAZING && height >= front[&at] - 2.0 * cell
    };
    (0..cloud.len()).filter(seen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is seen of a ball of 0.1 m from this direction, at random, with outward normals.
    fn cap(direction: &Vector3<f64>) -> PointCloud {
        let normals: Vec<Vector3<f64>> = (0..DIRECTIONS * 20)
            .map(|i| {
                let z = 1.0 - 2.0 * (i as f64 + 0.5) / (DIRECTIONS * 20) as f64;
                let turn = i as f64 * 2.399_963_229_728_653;
                Vector3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
            })
            .filter(|n| n.dot(direction) > 0.15)
            .collect();
        PointCloud { points: normals.iter().map(|n| Point3::from(0.1 * n)).collect(), normals }
    }

    fn direction_of(scan: &PastScan) -> Vector3<f64> {
        scan.world_from_camera.translation.vector.normalize()
    }

    #[test]
    fn a_scan_tells_where_it_was_taken_from() {
        for direction in [Vector3::z(), Vector3::new(1.0, -2.0, 0.5).normalize()] {
            let scans = estimated_scans(&mut cap(&direction), 1.2, 0.005);
            assert_eq!(scans.len(), 1, "one camera");
            let off = direction_of(&scans[0]).angle(&direction).to_degrees();
            assert!(off < 3.0, "{off} degrees off");
            assert_eq!(scans[0].pose, CameraPose::Estimated);
        }
    }

    #[test]
    fn a_merged_cloud_is_explained_by_cameras_around_it() {
        let (above, below) = (Vector3::z(), Vector3::new(0.3, 0.0, -1.0).normalize());
        let mut cloud = cap(&above);
        cloud.merge(&cap(&below));
        let scans = estimated_scans(&mut cloud, 1.2, 0.005);
        assert!((2..=6).contains(&scans.len()), "{}", scans.len());
        for direction in [above, below] {
            let nearest = scans.iter().map(|s| direction_of(s).angle(&direction)).fold(f64::INFINITY, f64::min);
            assert!(nearest.to_degrees() < 40.0, "{} degrees off", nearest.to_degrees());
        }
    }

    #[test]
    fn nothing_is_told_by_normals_that_cancel() {
        let mut cloud = PointCloud { points: vec![Point3::origin(); 2], normals: vec![Vector3::x(), -Vector3::x()] };
        assert!(estimated_scans(&mut cloud, 1.2, 0.01).is_empty());
    }
}
