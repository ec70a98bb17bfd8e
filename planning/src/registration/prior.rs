//! What the robot's accuracy says about a correction before anything is measured, and what is left of the error afterwards.

use super::Frame;
use super::icp::Fit;
use geometry::PointCloud;
use nalgebra::{Matrix3, Matrix6, Point3, Vector6};

/// Standard deviations below this are none, metres (and times the radius, in rotation).
const LEAST_M: f64 = 1e-7;

/// How well the robot knows a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Standard deviation per axis, metres.
    pub sigma_m: f64,
    /// The same of the rotation, radians.
    pub sigma_rad: f64,
    /// The point about which it turns; `None`: the middle of the object.
    pub about: Option<Point3<f64>>,
}

/// The same in a frame, and over the points of a scan.
pub(super) struct Prior {
    /// Of the six lengths, square metres.
    covariance: Matrix6<f64>,
    /// Its inverse.
    precision: Matrix6<f64>,
    /// Mean over the scan's points of D^T D, D the six lengths' effect on a point.
    spread: Matrix6<f64>,
    /// Root mean square displacement of the scan's points that is expected, metres.
    pub rms: f64,
}

impl Prior {
    pub fn new(error: &PoseError, frame: &Frame, scan: &PointCloud) -> Self {
        let (turn, shift) = (error.sigma_rad * frame.radius, error.sigma_m);
        let mut own = Matrix6::zeros();
        for k in 0..3 {
            own[(k, k)] = turn.max(LEAST_M).powi(2);
            own[(k + 3, k + 3)] = shift.max(LEAST_M).powi(2);
        }
        // A turn about another point shifts the middle too.
        let arm = error.about.map_or(Default::default(), |about| frame.center - about);
        let mut moved = Matrix6::identity();
        moved.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-arm.cross_matrix() / frame.radius));
        let covariance = moved * own * moved.transpose();
        let precision = covariance.cholesky().map_or_else(Matrix6::zeros, |c| c.inverse());
        let mut spread = Matrix6::zeros();
        for p in &scan.points {
            let by_turn = -(p - frame.center).cross_matrix() / frame.radius;
            let mut add = |at: (usize, usize), block: Matrix3<f64>| {
                let mut view = spread.fixed_view_mut::<3, 3>(at.0, at.1);
                view += block;
            };
            add((0, 0), by_turn.transpose() * by_turn);
            add((0, 3), by_turn.transpose());
            add((3, 0), by_turn);
        }
        spread /= scan.len().max(1) as f64;
        spread.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
        let rms = (spread * covariance).trace().max(0.0).sqrt();
        Self { covariance, precision, spread, rms }
    }

    /// What it adds to the equations of a step, at six lengths in all and a scale of the residuals: to the matrix, and from the gradient.
    pub fn pull(&self, total: &Vector6<f64>, scale: f64) -> (Matrix6<f64>, Vector6<f64>) {
        let variance = scale * scale;
        (self.precision * variance, self.precision * total * variance)
    }

    /// Root mean square error of the points that is left, metres. `weight` is what each point counts, so that denser scans of
    /// the same surface are not believed more: their errors go together.
    pub fn error_after(&self, fit: &Fit, weight: f64, with_prior: bool) -> f64 {
        let measured = fit.normal * (weight / (fit.scale * fit.scale));
        // Without the prior a free motion is still no worse than the robot's own error.
        let least = if with_prior { self.precision } else { self.precision * 1e-3 };
        let left = (measured + least).cholesky().map_or(self.covariance, |c| c.inverse());
        (self.spread * left).trace().max(0.0).sqrt()
    }
}
