//! Surface geometry at a frontier point and the view it proposes.

use super::state::Surface;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Chord on the unit sphere within which a scan direction is in the way.
const CHORD: f64 = 0.01;
/// Steps after which the free side is given up as undecided (the published loop has no bound).
const MAX_STEPS: usize = 10_000;

impl Surface {
    /// Fits the tangent plane at a point and proposes the view along its normal.
    pub(super) fn propose(&mut self, i: u32) {
        let (p, observed_from) = {
            let stored = &self.points[i as usize];
            (stored.position, stored.observed_from)
        };
        let near = self.grid.nearest(&p, self.params.k);
        let mean = near.iter().fold(Vector3::zeros(), |s, (_, q)| s + q.coords) / near.len() as f64;
        let covariance = near.iter().fold(Matrix3::zeros(), |s, (_, q)| {
            let d = q.coords - mean;
            s + d * d.transpose()
        });
        let eigen = SymmetricEigen::new(covariance);
        let least = eigen.eigenvalues.imin();
        let axis = |c: usize| eigen.eigenvectors.column(c).into_owned();
        let outward = (p.coords - mean).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let (first, second) = (axis((least + 1) % 3), axis((least + 2) % 3));
        let mut frontier = if first.dot(&outward).abs() >= second.dot(&outward).abs() { first } else { second };
        let mut normal = axis(least);
        if normal.dot(&(observed_from - p)) < 0.0 {
            normal = -normal;
        }
        if frontier.dot(&outward) < 0.0 {
            frontier = -frontier;
        }
        if !self.free_side(&p, &normal) {
            normal = -normal;
        }
        let stored = &mut self.points[i as usize];
        stored.normal = normal;
        stored.frontier = frontier;
        stored.boundary = normal.cross(&frontier);
        stored.looking = -normal;
        stored.view = p + self.params.distance * normal;
    }

    /// Whether free space lies on the normal's side, as far as the current scan tells: steps along both senses until
    /// no scan point lies before the step in its direction.
    fn free_side(&self, p: &nalgebra::Point3<f64>, normal: &Vector3<f64>) -> bool {
        let start = p - self.sensor;
        let free = |a: &Vector3<f64>| {
            let (direction, length) = (a.try_normalize(0.0).unwrap_or_else(Vector3::zeros), a.norm());
            !self
                .scan_rays
                .iter()
                .any(|(ray, distance)| *distance < length && (ray - direction).norm_squared() <= CHORD * CHORD)
        };
        for step in 1..=MAX_STEPS {
            let reach = step as f64 * self.params.probe * normal;
            match (free(&(start + reach)), free(&(start - reach))) {
                (true, _) => return true,
                (false, true) => return false,
                (false, false) => {}
            }
        }
        true
    }
}
