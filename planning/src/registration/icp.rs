//! Point-to-plane ICP, coarse to fine, with Tukey's weights and the robot's accuracy as a prior.

use super::information::row;
use super::prior::Prior;
use super::{Frame, Icp, Model, RegistrationConfig, robust};
use geometry::PointCloud;
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};

/// Expected displacements within which pairs are first looked for.
const FIRST_REACH: f64 = 1.7;
/// Tolerances within which they are looked for in the end.
const LAST_REACH: f64 = 2.5;
/// Steps of a stage.
const MOST_STEPS: usize = 15;
/// Tolerances of a step that is none, in coarse stages and in the last.
const STILL: [f64; 2] = [0.01, 0.0005];
/// Points of a scan in the coarse stages.
const COARSE: usize = 350;
/// Least pairs, of all points; and of any step, which determines six numbers.
const LEAST_PAIRS: [usize; 2] = [20, 6];
/// Pairs that must remain for those at the rim of the cloud to be dropped.
const WITHOUT_RIM: usize = 60;
/// Damping, per pair.
const DAMPING: f64 = 1e-6;
/// Cosine from which on normals are alike.
pub(super) const LIKE: f64 = 0.5;

/// Where ICP ended.
pub(super) struct Fit {
    /// About the frame's centre.
    pub rotation: UnitQuaternion<f64>,
    pub shift: Vector3<f64>,
    /// Weighted sum of J^T J over the last pairs, and their robust scale in metres.
    pub normal: Matrix6<f64>,
    pub scale: f64,
    /// Root mean square residual of the last pairs, weighted, metres.
    pub rms: f64,
    pub pairs: usize,
    /// Every stage had enough pairs.
    pub finished: bool,
    pub converged: bool,
}

struct Pair {
    /// The moved point from the frame's centre, the normal of the cloud there, and how far the cloud is along it.
    p: Vector3<f64>,
    n: Vector3<f64>,
    r: f64,
    rim: bool,
}

pub(super) fn fit(scan: &PointCloud, model: &Model, frame: &Frame, prior: &Prior, config: &RegistrationConfig) -> Fit {
    let mut fit = Fit {
        rotation: UnitQuaternion::identity(),
        shift: Vector3::zeros(),
        normal: Matrix6::zeros(),
        scale: robust::least_scale(model.tolerance),
        rms: 0.0,
        pairs: 0,
        finished: false,
        converged: false,
    };
    let last = (LAST_REACH * model.tolerance).max(2.0 * model.spacing);
    let mut reach = (FIRST_REACH * prior.rms).max(last);
    let coarse = (scan.len() / COARSE).max(1);
    let mut pairs = Vec::new();
    loop {
        let fine = reach <= last;
        let stride = if fine { 1 } else { coarse };
        if !stage(&mut fit, &mut pairs, scan, model, frame, prior, config, reach, stride, fine) {
            return fit;
        }
        if fine {
            fit.finished = true;
            return fit;
        }
        reach = (0.5 * reach).max(last);
    }
}

/// Steps within one reach; false where there are too few pairs.
fn stage(
    fit: &mut Fit,
    pairs: &mut Vec<Pair>,
    scan: &PointCloud,
    model: &Model,
    frame: &Frame,
    prior: &Prior,
    config: &RegistrationConfig,
    reach: f64,
    stride: usize,
    fine: bool,
) -> bool {
    let least = (LEAST_PAIRS[0] / stride).max(LEAST_PAIRS[1]);
    for _ in 0..MOST_STEPS {
        find_pairs(pairs, fit, scan, model, frame, config.kind, reach, stride);
        if fine && config.kind == Icp::Good && pairs.iter().filter(|pair| !pair.rim).count() >= WITHOUT_RIM {
            pairs.retain(|pair| !pair.rim);
        }
        fit.pairs = pairs.len();
        if pairs.len() < least {
            return false;
        }
        let step = solve(fit, pairs, frame, prior, config.prior, model.tolerance);
        fit.converged = step.norm() < STILL[usize::from(fine)] * model.tolerance;
        if fit.converged {
            break;
        }
        let (turn, shift) = frame.motion(&step);
        fit.rotation = turn * fit.rotation;
        fit.shift = turn * fit.shift + shift;
    }
    true
}

fn find_pairs(
    pairs: &mut Vec<Pair>,
    fit: &Fit,
    scan: &PointCloud,
    model: &Model,
    frame: &Frame,
    kind: Icp,
    reach: f64,
    stride: usize,
) {
    pairs.clear();
    for i in (0..scan.len()).step_by(stride) {
        let p = fit.rotation * (scan.points[i] - frame.center) + fit.shift;
        let Some(j) = model.nearest(&(frame.center + p), reach) else { continue };
        let mut n = model.normals[j];
        if kind == Icp::Good {
            let own = fit.rotation * scan.normals[i];
            if n.dot(&own) <= LIKE * own.norm() {
                continue;
            }
            // Symmetric in the two surfaces (Rusinkiewicz 2019): curvature pulls to neither side.
            n = (n + own.normalize()).normalize();
        }
        let r = n.dot(&(model.cloud.points[j] - frame.center - p));
        pairs.push(Pair { p, n, r, rim: model.rim[j] });
    }
}

/// The step of Gauss and Newton; the sums that it comes from stay in `fit`.
fn solve(
    fit: &mut Fit,
    pairs: &[Pair],
    frame: &Frame,
    prior: &Prior,
    with_prior: bool,
    tolerance: f64,
) -> Vector6<f64> {
    fit.scale = robust::scale(pairs.iter().map(|pair| pair.r), tolerance);
    let (mut normal, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    let (mut squared, mut weights) = (0.0, 0.0);
    for pair in pairs {
        let Some(weight) = robust::weight(pair.r, fit.scale) else { continue };
        let j = row(&pair.p, &pair.n, frame.radius);
        normal.syger(weight, &j, &j, 1.0);
        gradient.axpy(weight * pair.r, &j, 1.0);
        squared += weight * pair.r * pair.r;
        weights += weight;
    }
    normal.fill_upper_triangle_with_lower_triangle();
    fit.normal = normal;
    fit.rms = if weights > 0.0 { (squared / weights).sqrt() } else { 0.0 };
    let mut system = normal + Matrix6::identity() * (DAMPING * pairs.len() as f64);
    if with_prior {
        let (stiffness, pull) = prior.pull(&frame.lengths(&fit.rotation, &fit.shift), fit.scale);
        system += stiffness;
        gradient -= pull;
    }
    system.cholesky().map_or_else(Vector6::zeros, |c| c.solve(&gradient))
}
