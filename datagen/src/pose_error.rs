//! Errors of the camera's pose: where the arm stands, and where registration believes that it stands.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Settings of the pose error. Zero switches a part off.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseErrorConfig {
    /// Standard deviation per axis of where the camera ends up about the commanded position, metres.
    pub reach_sigma_m: f64,
    /// The same of its rotation, degrees.
    pub reach_sigma_deg: f64,
    /// Standard deviation per axis and scan of what registration adds to its error, metres. Errors add up: drift.
    pub drift_sigma_m: f64,
    /// The same in rotation about the object's centre, degrees.
    pub drift_sigma_deg: f64,
}

impl Default for PoseErrorConfig {
    /// An arm good to 5 mm and half a degree, and registration that loses 0.3 mm and 0.02 degrees per scan.
    fn default() -> Self {
        Self { reach_sigma_m: 0.005, reach_sigma_deg: 0.5, drift_sigma_m: 0.0003, drift_sigma_deg: 0.02 }
    }
}

/// The error along an episode. The first scan defines the frame and has no drift.
pub(crate) struct PoseError {
    config: PoseErrorConfig,
    drift: Isometry3<f64>,
    scans: usize,
    rng: ChaCha8Rng,
}

impl PoseError {
    pub fn new(config: PoseErrorConfig, rng: ChaCha8Rng) -> Self {
        Self { config, drift: Isometry3::identity(), scans: 0, rng }
    }

    /// Forgets the drift: the scan that comes defines the frame.
    pub fn restart(&mut self) {
        self.drift = Isometry3::identity();
        self.scans = 0;
    }

    /// Where the camera stands and where it is believed to stand, for a commanded `world_from_camera`.
    pub fn poses(&mut self, commanded: &Isometry3<f64>) -> (Isometry3<f64>, Isometry3<f64>) {
        let actual = commanded * disturbance(self.config.reach_sigma_m, self.config.reach_sigma_deg, &mut self.rng);
        let step = disturbance(self.config.drift_sigma_m, self.config.drift_sigma_deg, &mut self.rng);
        if self.scans > 0 {
            self.drift = step * self.drift;
        }
        self.scans += 1;
        (actual, self.drift * actual)
    }
}

/// A small random motion.
pub(crate) fn disturbance(sigma_m: f64, sigma_deg: f64, rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let mut normal = |sigma: f64| Vector3::from_fn(|_, _| sigma * rng.sample::<f64, _>(StandardNormal));
    let (shift, turn) = (normal(sigma_m), normal(sigma_deg.to_radians()));
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::rng::stream;

    #[test]
    fn drift_grows_like_the_root_of_the_number_of_scans() {
        let config =
            PoseErrorConfig { reach_sigma_m: 0.0, reach_sigma_deg: 0.0, drift_sigma_deg: 0.0, drift_sigma_m: 1e-3 };
        let squared_after = |scans: usize| {
            let total: f64 = (0..400)
                .map(|i| {
                    let mut error = PoseError::new(config.clone(), stream(i, "drift"));
                    let last = (0..=scans).map(|_| error.poses(&Isometry3::identity())).last();
                    last.map_or(0.0, |(actual, believed)| {
                        (actual.inverse() * believed).translation.vector.norm_squared()
                    })
                })
                .sum();
            total / 400.0
        };
        assert_eq!(squared_after(0), 0.0, "the first scan has no drift");
        for scans in [1, 4, 16] {
            let expected = 3e-6 * scans as f64;
            assert!((squared_after(scans) / expected - 1.0).abs() < 0.25, "after {scans}: {}", squared_after(scans));
        }
    }

    #[test]
    fn the_arm_misses_by_what_was_asked() {
        let config = PoseErrorConfig { drift_sigma_m: 0.0, drift_sigma_deg: 0.0, ..PoseErrorConfig::default() };
        let mut error = PoseError::new(config, stream(1, "reach"));
        let miss: Vec<f64> = (0..1000).map(|_| error.poses(&Isometry3::identity()).0.translation.vector.x).collect();
        let deviation = (miss.iter().map(|x| x * x).sum::<f64>() / 1000.0).sqrt();
        assert!((deviation / 0.005 - 1.0).abs() < 0.1, "{deviation}");
    }
}
