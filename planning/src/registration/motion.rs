//! Small rigid motions in words.

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Cosine from which on a direction is called by the axis it is next to: within 10 degrees.
const ALONG: f64 = 0.985;
/// Share of a motion that is one shift of all points from which on it is a slide.
const SLIDE: f64 = 0.8;

/// What a motion is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionKind {
    /// All points go the same way.
    Slide,
    /// They turn about an axis.
    Turn,
}

/// A motion, most of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// What it is.
    pub kind: MotionKind,
    /// Its direction or axis, of unit length.
    pub axis: [f64; 3],
    /// A point on the axis, world frame, metres; of a slide the middle of the points.
    pub through_m: [f64; 3],
}

impl Motion {
    /// Names the motion `turn` x p + `shift` of points about `center` with this mean and mean outer product.
    pub(super) fn name(
        turn: &Vector3<f64>,
        shift: &Vector3<f64>,
        center: &Point3<f64>,
        mean: &Vector3<f64>,
        outer: &Matrix3<f64>,
    ) -> Self {
        let of_middle = turn.cross(mean) + shift;
        // The mean of |turn x (p - mean)|^2 from the points' scatter.
        let scatter = outer - mean * mean.transpose();
        let turning = turn.norm_squared() * scatter.trace() - turn.dot(&(scatter * turn));
        let (slides, all) = (of_middle.norm_squared(), of_middle.norm_squared() + turning.max(0.0));
        if slides >= SLIDE * all || turn.norm() == 0.0 {
            let axis = of_middle.try_normalize(0.0).unwrap_or_else(Vector3::x);
            return Self { kind: MotionKind::Slide, axis: axis.into(), through_m: (center + mean).coords.into() };
        }
        let through = center + turn.cross(shift) / turn.norm_squared();
        Self { kind: MotionKind::Turn, axis: turn.normalize().into(), through_m: through.coords.into() }
    }
}

impl fmt::Display for Motion {
    /// `slide along x`, `turn about (0.00, 0.71, 0.71)`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.kind {
            MotionKind::Slide => "slide along ",
            MotionKind::Turn => "turn about ",
        })?;
        let [x, y, z] = self.axis;
        match self.axis.iter().position(|c| c.abs() >= ALONG) {
            Some(k) => write!(f, "{}", ["x", "y", "z"][k]),
            None => write!(f, "({x:.2}, {y:.2}, {z:.2})"),
        }
    }
}
