//! Cameras all around the origin.

use crate::View;
use nalgebra::{Point3, Vector3};

/// A camera on the sphere of this radius around the origin that looks at it.
pub fn view_at(direction: &Vector3<f64>, radius: f64) -> View {
    View { target: Point3::origin(), position: Point3::from(radius * direction) }
}

/// Evenly spread directions: the Fibonacci lattice.
pub fn fibonacci(count: usize) -> Vec<Vector3<f64>> {
    let golden_angle = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * cos, r * sin, z)
        })
        .collect()
}
