//! Adjustment of all registered scans together: each was registered onto those before it alone, and what came later may hold it
//! better. Gauss and Newton over all poses (Lu and Milios 1997) on pairs from every scan to every other, symmetric in the two
//! normals (Rusinkiewicz 2019), with the robot's accuracy as a prior.

use super::information::row;
use super::prior::Prior;
use super::{Frame, PoseError, RegistrationConfig, robust};
use geometry::{NeighborGrid, PointCloud};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, Translation3, Vector3, Vector6};

/// Tolerances within which pairs are looked for: scans were registered before.
const REACH: f64 = 1.5;
/// Cosine from which on normals are alike.
const LIKE: f64 = 0.7;
/// Spacings that the nearest point may lie off along the surface: farther away, the other scan ends there.
const BESIDE: f64 = 1.0;
/// Steps of Gauss and Newton.
const STEPS: usize = 3;
/// Tolerances of a step that is none.
const STILL: f64 = 0.01;
/// Points that are looked for in other scans in one step, about: time stays even where there are many scans.
const SEARCHES: usize = 15_000;
/// Damping, per pair.
const DAMPING: f64 = 1e-6;

/// A scan that was registered.
pub struct Piece<'a> {
    /// Its points, with normals, where they are now.
    pub cloud: &'a PointCloud,
    /// Mean distance of its points, metres.
    pub spacing: f64,
    /// From where its pose put it to where it is now, and how well the robot knows that pose; `None` for a scan that stays.
    pub given: Option<(Isometry3<f64>, PoseError)>,
}

/// A piece about the frame's centre.
struct Part {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    grid: NeighborGrid,
    spacing: f64,
    /// Its six lengths so far and what is known of them; `None` where it stays.
    prior: Option<(Vector6<f64>, Prior)>,
    /// From where it was.
    pose: Isometry3<f64>,
}

/// A point of one part and the surface of another, about the centre.
struct Pair {
    parts: [usize; 2],
    p: Vector3<f64>,
    n: Vector3<f64>,
    r: f64,
}

/// How each scan is to move, world frame, so that all fit together. The answer follows from the arguments alone.
pub fn adjust(pieces: &[Piece], tolerance: f64, config: &RegistrationConfig) -> Vec<Isometry3<f64>> {
    let clouds: Vec<&PointCloud> = pieces.iter().map(|piece| piece.cloud).collect();
    let frame = Frame::around(&clouds);
    let mut parts: Vec<Part> = pieces.iter().map(|piece| Part::of(piece, &frame)).collect();
    let searches = pieces.iter().map(|piece| piece.cloud.len()).sum::<usize>() * pieces.len().saturating_sub(1);
    let stride = searches.div_ceil(SEARCHES).max(1);
    for step in 0..STEPS {
        let pairs = find_pairs(&parts, tolerance, stride, step);
        let Some(motion) = solve(&parts, &pairs, &frame, tolerance, stride, config.prior) else { break };
        for (part, s) in parts.iter_mut().filter(|part| part.prior.is_some()).zip(&motion) {
            let (turn, shift) = frame.motion(s);
            part.pose = Isometry3::from_parts(shift.into(), turn) * part.pose;
        }
        if motion.iter().all(|s| s.amax() < STILL * tolerance) {
            break;
        }
    }
    let center = frame.center.coords;
    parts.into_iter().map(|part| Translation3::from(center) * part.pose * Translation3::from(-center)).collect()
}

impl Part {
    fn of(piece: &Piece, frame: &Frame) -> Self {
        let points: Vec<_> = piece.cloud.points.iter().map(|p| p - frame.center.coords).collect();
        let unit = |n: &Vector3<f64>| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let prior = piece.given.as_ref().map(|(moved, error)| {
            let shift = moved * frame.center - frame.center;
            (frame.lengths(&moved.rotation, &shift), Prior::new(error, frame, piece.cloud))
        });
        Self {
            grid: NeighborGrid::new(&points, 2.0 * piece.spacing),
            normals: piece.cloud.normals.iter().map(unit).collect(),
            points,
            spacing: piece.spacing,
            prior,
            pose: Isometry3::identity(),
        }
    }
}

/// Every `stride`-th point of each part with the nearest of each other, others in every step.
fn find_pairs(parts: &[Part], tolerance: f64, stride: usize, step: usize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (i, one) in parts.iter().enumerate() {
        for (j, other) in parts.iter().enumerate() {
            if i == j || (one.prior.is_none() && other.prior.is_none()) {
                continue;
            }
            let between = other.pose.inverse() * one.pose;
            let reach = (REACH * tolerance).max(2.0 * other.spacing);
            let beside = BESIDE * one.spacing.max(other.spacing);
            for k in ((step + i + j) % stride..one.points.len()).step_by(stride) {
                let q = between * one.points[k];
                let Some(found) = other.grid.nearest_within(&q, reach) else { continue };
                let gap = other.points[found.index] - q;
                let (n, own) = (other.normals[found.index], between.rotation * one.normals[k]);
                if n.dot(&own) <= LIKE {
                    continue;
                }
                let n = (n + own).normalize();
                if (gap - n.dot(&gap) * n).norm() > beside {
                    continue;
                }
                let r = n.dot(&gap);
                pairs.push(Pair { parts: [i, j], p: (one.pose * one.points[k]).coords, n: other.pose.rotation * n, r });
            }
        }
    }
    pairs
}

/// The step of each part that moves, in their order; `None` where too little overlaps.
fn solve(
    parts: &[Part],
    pairs: &[Pair],
    frame: &Frame,
    tolerance: f64,
    stride: usize,
    with_prior: bool,
) -> Option<Vec<Vector6<f64>>> {
    let mut unknowns = 0;
    let columns: Vec<Option<usize>> = parts
        .iter()
        .map(|part| {
            unknowns += usize::from(part.prior.is_some());
            part.prior.as_ref().map(|_| 6 * (unknowns - 1))
        })
        .collect();
    if unknowns == 0 || pairs.len() < 6 * unknowns {
        return None;
    }
    let scale = robust::scale(pairs.iter().map(|pair| pair.r), tolerance);
    let mut blocks = vec![Matrix6::<f64>::zeros(); parts.len() * parts.len()];
    let mut slopes = vec![Vector6::<f64>::zeros(); parts.len()];
    for Pair { parts: [i, j], p, n, r } in pairs {
        let Some(weight) = robust::weight(*r, scale) else { continue };
        // Each overlap is met from both sides.
        let weight = 0.5 * stride as f64 * weight;
        let line = row(p, n, frame.radius);
        blocks[i * parts.len() + j].syger(weight, &line, &line, 1.0);
        slopes[*i].axpy(weight * r, &line, 1.0);
        slopes[*j].axpy(-weight * r, &line, 1.0);
    }
    let mut system = DMatrix::<f64>::zeros(6 * unknowns, 6 * unknowns);
    let mut gradient = DVector::<f64>::zeros(6 * unknowns);
    for (at, block) in blocks.iter_mut().enumerate() {
        block.fill_upper_triangle_with_lower_triangle();
        let (i, j) = (at / parts.len(), at % parts.len());
        for (a, b, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
            if let (Some(a), Some(b)) = (columns[a], columns[b]) {
                let mut view = system.fixed_view_mut::<6, 6>(a, b);
                view += sign * *block;
            }
        }
    }
    for ((part, slope), column) in parts.iter().zip(&slopes).zip(&columns) {
        let (Some((before, prior)), &Some(at)) = (&part.prior, column) else { continue };
        let (mut own, mut slope) = (Matrix6::identity() * (DAMPING * pairs.len() as f64), *slope);
        if with_prior {
            let total = before + frame.lengths(&part.pose.rotation, &part.pose.translation.vector);
            let (stiffness, pull) = prior.pull(&total, scale);
            own += stiffness;
            slope -= pull;
        }
        let mut view = system.fixed_view_mut::<6, 6>(at, at);
        view += own;
        gradient.fixed_rows_mut::<6>(at).copy_from(&slope);
    }
    let step = system.cholesky()?.solve(&gradient);
    Some((0..unknowns).map(|k| step.fixed_rows::<6>(6 * k).into_owned()).collect())
}

#[cfg(test)]
mod tests;
