//! What an overlap determines of a rigid motion: the 6 x 6 matrix of point-to-plane registration (Gelfand et al. 2003).

use super::{Frame, Motion};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Areas of a pixel per squared radius, in which [`Information::lambda`] counts: one unit is what the paper's camera has in one
/// pixel (2.33 mm at 1.2 m) of an object whose points lie 65 mm from its centre.
const PIXELS: f64 = (65.0 / 2.333) * (65.0 / 2.333);

/// The sum of J^T J over pieces of surface, each times its area, J = [p x n / radius, n] with p from the frame's centre: how
/// fast the surface's distance grows with each small motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Information {
    /// The sum, square metres.
    pub matrix: Matrix6<f64>,
    area: f64,
    sum: Vector3<f64>,
    outer: Matrix3<f64>,
}

/// J of a point from the frame's centre.
pub(super) fn row(p: &Vector3<f64>, n: &Vector3<f64>, radius: f64) -> Vector6<f64> {
    let turn = p.cross(n) / radius;
    Vector6::new(turn.x, turn.y, turn.z, n.x, n.y, n.z)
}

impl Information {
    /// Adds a piece at `p` from the frame's centre.
    pub fn add(&mut self, p: &Vector3<f64>, n: &Vector3<f64>, area: f64, radius: f64) {
        let j = row(p, n, radius);
        self.matrix.syger(area, &j, &j, 1.0);
        self.area += area;
        self.sum += area * p;
        self.outer += area * p * p.transpose();
    }

    /// The whole symmetric matrix: sums are kept in its lower half.
    pub fn symmetric(&self) -> Matrix6<f64> {
        let mut matrix = self.matrix;
        matrix.fill_upper_triangle_with_lower_triangle();
        matrix
    }

    /// The smallest eigenvalue over the squared radius, in units of a pixel: nearly 0 where a motion is free, 10 where all are
    /// held well. Depends neither on the density of points, nor on the camera, nor on the object's size.
    pub fn lambda(&self, radius: f64) -> f64 {
        if self.area <= 0.0 {
            return 0.0;
        }
        (self.symmetric().symmetric_eigenvalues().min() / (radius * radius) * PIXELS).max(0.0)
    }

    /// The motion that is determined least; `None` without any surface.
    pub fn weakest(&self, frame: &Frame) -> Option<Motion> {
        if self.area <= 0.0 {
            return None;
        }
        let eigen = self.symmetric().symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let v = eigen.eigenvectors.column(least);
        let turn = Vector3::new(v[0], v[1], v[2]) / frame.radius;
        let shift = Vector3::new(v[3], v[4], v[5]);
        let (mean, outer) = (self.sum / self.area, self.outer / self.area);
        Some(Motion::name(&turn, &shift, &frame.center, &mean, &outer))
    }
}
