//! The reactive controller: corrects the view of a frontier that the last scan did not resolve.

use super::state::Surface;
use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};

/// Angle by which the view turns for a miss of `x` at distance `d`: atan((s + 1) x / d) - atan(x / d).
fn overshoot(scale: f64, x: f64, d: f64) -> f64 {
    (scale * x * d / (d * d + (scale + 1.0) * x * x)).atan()
}

fn rotation(axis: &Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    Unit::try_new(*axis, 0.0)
        .map_or_else(UnitQuaternion::identity, |axis| UnitQuaternion::from_axis_angle(&axis, angle))
}

impl Surface {
    /// Called while the frontier that the last view was meant for is still a frontier after its scan.
    pub(super) fn correct_view(&mut self, i: u32, scan: &[Point3<f64>]) {
        if scan.is_empty() || !self.useful {
            self.free(i);
            return;
        }
        let d = self.params.distance;
        let centroid = Point3::from(scan.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / scan.len() as f64);
        let stored = &mut self.points[i as usize];
        let p = stored.position;
        let basis = Matrix3::from_columns(&[stored.normal, stored.frontier, stored.boundary]);
        let miss = basis.transpose() * (p - centroid);
        let position = if miss.norm() < stored.closest {
            let s = stored.scale;
            let mut x = stored.view - p;
            x = rotation(&stored.boundary, overshoot(s, miss[1], d)) * (x + (s + 1.0) * miss[1] * stored.frontier);
            x = rotation(&stored.frontier, overshoot(s, miss[2], d)) * (x + (s + 1.0) * miss[2] * stored.boundary);
            stored.scale *= 2.0;
            stored.closest = miss.norm();
            p + x
        } else if stored.may_switch {
            stored.may_switch = false;
            stored.closest = f64::INFINITY;
            stored.scale = 1.0;
            stored.observed_from
        } else {
            self.free(i);
            return;
        };
        stored.looking = (p - position).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        stored.view = p - d * stored.looking;
    }
}

#[cfg(test)]
mod tests {
    use super::overshoot;

    #[test]
    fn the_angle_is_a_difference_of_arctangents() {
        for s in [1.0, 2.0, 8.0] {
            for x in [-0.3, -0.01, 0.0, 0.02, 0.4] {
                let d: f64 = 1.2;
                let expected = ((s + 1.0) * x / d).atan() - (x / d).atan();
                assert!((overshoot(s, x, d) - expected).abs() < 1e-12, "s {s} x {x}");
            }
        }
    }
}
