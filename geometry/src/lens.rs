//! What a lens does to the rays of a pinhole camera: the models of OpenCV, ROS and Kalibr (docs/formats.md, 'Cameras').

use nalgebra::{Matrix2, Vector2};

/// Distortion of a lens: where the ray x / z, y / z of the camera frame falls in the image plane at distance 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Lens {
    /// None.
    #[default]
    Pinhole,
    /// Brown and Conrady's, as OpenCV orders it: k1, k2, p1, p2, k3, k4, k5, k6 (`plumb_bob` with k4 to k6 zero,
    /// `rational_polynomial` with them).
    BrownConrady([f64; 8]),
    /// OpenCV's `fisheye`, Kalibr's and ROS's `equidistant`: k1 to k4 of the angle to the axis.
    Fisheye([f64; 4]),
}

/// Steps of Newton's method at most; five do for common lenses.
const STEPS: usize = 40;
/// Rays are exact to this, in units of the focal length.
const EXACT: f64 = 1e-12;
/// What a pinhole image can still show, radians off the axis (75 degrees).
pub const WIDEST: f64 = 1.309;

impl Lens {
    /// Whether it does nothing.
    pub fn is_pinhole(&self) -> bool {
        match self {
            Self::Pinhole => true,
            Self::BrownConrady(k) => k.iter().all(|k| *k == 0.0),
            Self::Fisheye(_) => false,
        }
    }

    /// By the name that OpenCV, ROS, Kalibr or RealSense give the model, with as many coefficients as it has; later ones may be left
    /// out where they are zero.
    ///
    /// # Errors
    /// What is wrong with it, and what is expected.
    pub fn named(model: &str, coefficients: &[f64]) -> Result<Self, String> {
        if let Some(odd) = coefficients.iter().find(|k| !k.is_finite()) {
            return Err(format!("a coefficient of {odd}"));
        }
        let count = coefficients.len();
        let padded = |most: usize| -> Result<[f64; 8], String> {
            if count > most && coefficients[most..].iter().any(|k| *k != 0.0) {
                return Err(format!("{count} coefficients for {model}, which has {most} here"));
            }
            Ok(std::array::from_fn(|i| coefficients.get(i).copied().filter(|_| i < most).unwrap_or(0.0)))
        };
        let first4 = |k: [f64; 8]| [k[0], k[1], k[2], k[3]];
        match model.to_ascii_lowercase().as_str() {
            "none" | "pinhole" => match coefficients.iter().all(|k| *k == 0.0) {
                true => Ok(Self::Pinhole),
                false => Err(format!("{count} coefficients, not all zero, for a lens without distortion")),
            },
            "brown_conrady" | "plumb_bob" | "radtan" | "rational_polynomial" => {
                if !(count == 0 || (4..=14).contains(&count)) {
                    return Err(format!("{count} coefficients for {model}, which has k1 k2 p1 p2 [k3 [k4 k5 k6]]"));
                }
                padded(8).map(Self::BrownConrady)
            }
            "fisheye" | "equidistant" | "equidist" | "kannala_brandt4" => padded(4).map(|k| Self::Fisheye(first4(k))),
            _ => Err(format!(
                "model {model}, expected none, brown_conrady (plumb_bob, radtan, rational_polynomial) or fisheye (equidistant)"
            )),
        }
    }

    /// The model's name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Pinhole => "none",
            Self::BrownConrady(_) => "brown_conrady",
            Self::Fisheye(_) => "fisheye",
        }
    }

    /// Its coefficients.
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::Pinhole => &[],
            Self::BrownConrady(k) => k,
            Self::Fisheye(k) => k,
        }
    }

    /// Where the ray (x / z, y / z) falls.
    pub fn distort(&self, ray: Vector2<f64>) -> Vector2<f64> {
        self.with_slope(ray).0
    }

    /// The ray that falls there; `None` where no ray does, or the model has turned back on itself before it.
    pub fn undistort(&self, at: Vector2<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Pinhole => Some(at),
            Self::BrownConrady(_) => {
                let mut ray = at;
                for _ in 0..STEPS {
                    let (found, slope) = self.with_slope(ray);
                    let off = found - at;
                    if off.norm() < EXACT {
                        break;
                    }
                    ray -= slope.try_inverse()? * off;
                }
                let (found, slope) = self.with_slope(ray);
                let stands = (found - at).norm() < 1e-9 && slope.determinant() > 0.0 && slope.trace() > 0.0;
                (stands && self.rises_to(ray)).then_some(ray)
            }
            Self::Fisheye(k) => {
                let radius = at.norm();
                if radius == 0.0 {
                    return Some(at);
                }
                let mut angle = radius.min(std::f64::consts::FRAC_PI_2);
                for _ in 0..STEPS {
                    let (found, slope) = fisheye(k, angle);
                    if (found - radius).abs() < EXACT {
                        break;
                    }
                    angle -= (found - radius) / slope;
                }
                let stands =
                    (fisheye(k, angle).0 - radius).abs() < 1e-9 && (0.0..std::f64::consts::FRAC_PI_2).contains(&angle);
                let rises = (1..=32).all(|i| fisheye(k, angle * f64::from(i) / 32.0).1 > 0.0);
                (stands && rises).then(|| at * (angle.tan() / radius))
            }
        }
    }

    /// Whether the model keeps the order of rays from the axis to this one: beyond, what it says is no lens.
    pub fn rises_to(&self, ray: Vector2<f64>) -> bool {
        (1..=16).all(|i| {
            let slope = self.with_slope(ray * (f64::from(i) / 16.0)).1;
            slope.determinant() > 0.0 && slope.trace() > 0.0
        })
    }

    /// Where a ray falls, and the derivative.
    fn with_slope(&self, ray: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (ray.x, ray.y);
        match self {
            Self::Pinhole => (ray, Matrix2::identity()),
            Self::BrownConrady([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let r2 = x * x + y * y;
                let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
                let radial = above / below;
                // By r2.
                let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
                let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
                let slope = (above_slope - radial * below_slope) / below;
                let at = Vector2::new(
                    x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                    y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
                );
                let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
                let jacobian = Matrix2::new(
                    radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
                    cross,
                    cross,
                    radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
                );
                (at, jacobian)
            }
            Self::Fisheye(k) => {
                let radius = ray.norm();
                if radius < 1e-12 {
                    return (ray, Matrix2::identity());
                }
                let (found, slope) = fisheye(k, radius.atan());
                let scale = found / radius;
                let along = slope / (1.0 + radius * radius);
                let unit = ray / radius;
                (ray * scale, Matrix2::identity() * scale + unit * unit.transpose() * (along - scale))
            }
        }
    }
}

/// Distance from the middle at this angle to the axis, and its derivative.
fn fisheye(k: &[f64; 4], angle: f64) -> (f64, f64) {
    let a2 = angle * angle;
    let radius = angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
    let slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
    (radius, slope)
}

#[cfg(test)]
mod tests;
