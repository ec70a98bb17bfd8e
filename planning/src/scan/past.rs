//! What a planner may know of a scan.

use super::Scan;
use super::lines::{abreast, pieces};
use super::veil::{LeftOut, Veil};
use crate::{PastScan, Seen};
use geometry::View;
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

/// A scan with these points, `left_out` being those that were measured and are not used; nothing where the camera is unknown.
pub(super) fn past_scans(scan: Scan, points: &[Point3<f64>], left_out: &[LeftOut]) -> Vec<PastScan> {
    match scan {
        Scan::Depth { camera, depth, world_from_camera, misses } => {
            let seen = Seen::Depth { camera, depth, misses };
            vec![PastScan { world_from_camera, seen, pose: Default::default(), veil: None }]
        }
        Scan::Cloud { from, .. } => {
            from.map(|position| seen_from(position, points.to_vec(), left_out)).into_iter().collect()
        }
        Scan::Lines { path, .. } => {
            let pieces = pieces(&path, points);
            let mut beside: Vec<Vec<LeftOut>> = vec![Vec::new(); pieces.len()];
            for one in left_out {
                let from = abreast(&path, &one.point);
                let away = |i: &usize| (pieces[*i].0 - from).norm();
                if let Some(i) = (0..pieces.len()).min_by(|a, b| away(a).total_cmp(&away(b))) {
                    beside[i].push(*one);
                }
            }
            let each = pieces.into_iter().zip(&beside);
            each.map(|((at, points), left_out)| seen_from(at, points, left_out)).collect()
        }
    }
}

/// Points as seen from a position. The orientation is not known and does not matter: it looks at the middle of what it saw.
fn seen_from(position: Point3<f64>, points: Vec<Point3<f64>>, left_out: &[LeftOut]) -> PastScan {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let view = View { target: Point3::from(sum / points.len().max(1) as f64), position };
    let world_from_camera = view.world_from_camera();
    let veil = Veil::of(&world_from_camera, &points, left_out).map(Arc::new);
    PastScan { world_from_camera, seen: Seen::Points(points), pose: Default::default(), veil }
}
