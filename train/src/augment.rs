//! Augmentation: what a decision could as well have looked like. Scores stay as they are, since they do not
//! change with a rigid motion or the unit of length.

use geometry::{PointCloud, View};
use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use planning::CandidateView;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// Large rotations, made before the small ones of [`AugmentConfig::rotation_deg`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Turn {
    /// None (published).
    #[default]
    None,
    /// Any angle about the vertical (Z).
    Vertical,
    /// Any rotation, uniform over all of them.
    Any,
}

/// Settings of the augmentation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AugmentConfig {
    /// Augmented visits to a sample per epoch beside an unchanged one (published: 2); 0 visits each sample once,
    /// augmented.
    pub copies: u32,
    /// Rotations about X, Y and Z, each uniform within +- this, degrees.
    pub rotation_deg: f64,
    /// Large rotations.
    pub turn: Turn,
    /// Scale factor, uniform in 1 +- this (without effect under `cloud` normalisation).
    pub scale: f64,
    /// Standard deviation of Gaussian noise on every coordinate of the cloud, metres.
    pub noise_m: f64,
    /// Largest share of points left out; the share is uniform from 0.
    pub dropout: f64,
    /// Share of the samples whose past cameras are withheld, so that the network also ranks where they are not known.
    pub forget_cameras: f64,
    /// Standard deviation of the error of a past camera's direction, about each axis, as if it were estimated, degrees.
    pub camera_error_deg: f64,
    /// Range of the cloud's diagonal after `cloud` normalisation as a share of 0.2 m, drawn uniformly: a partly
    /// seen object is smaller than the whole.
    pub diagonal_fraction: [f64; 2],
}

impl Default for AugmentConfig {
    fn default() -> Self {
        AugmentConfig {
            copies: 0,
            rotation_deg: 10.0,
            turn: Turn::None,
            scale: 0.0,
            noise_m: 0.0,
            dropout: 0.0,
            forget_cameras: 0.0,
            camera_error_deg: 0.0,
            diagonal_fraction: [0.8, 1.0],
        }
    }
}

impl AugmentConfig {
    /// Nothing is changed.
    pub fn none() -> Self {
        AugmentConfig { rotation_deg: 0.0, diagonal_fraction: [1.0, 1.0], ..Default::default() }
    }

    /// Visits to a sample per epoch.
    pub fn visits(&self) -> usize {
        1 + self.copies as usize
    }

    /// Whether visit `visit` (from 0) of a sample is augmented.
    pub fn changes_visit(&self, visit: usize) -> bool {
        self.copies == 0 || visit > 0
    }

    /// The cloud's diagonal for this sample, as a share of 0.2 m.
    pub fn draw_diagonal_fraction(&self, rng: &mut impl Rng) -> f64 {
        let [low, high] = self.diagonal_fraction;
        low + (high - low) * rng.random::<f64>()
    }

    /// Changes a cloud, its candidates, the working distance and the past cameras alike. Draws the same amount of numbers
    /// for the same number of points and cameras, whatever they are used for.
    pub fn apply(
        &self,
        cloud: &mut PointCloud,
        candidates: &mut [CandidateView],
        working_distance: &mut f64,
        cameras: &mut Vec<Isometry3<f64>>,
        rng: &mut impl Rng,
    ) {
        let rotation = self.draw_rotation(rng);
        let scale = 1.0 + self.scale * (2.0 * rng.random::<f64>() - 1.0);
        if self.dropout > 0.0 {
            drop_points(cloud, self.dropout * rng.random::<f64>(), rng);
        }
        if self.noise_m > 0.0 {
            for p in &mut cloud.points {
                p.coords += Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * self.noise_m;
            }
        }
        let matrix = rotation.matrix();
        let moved = matrix * scale;
        cloud.points.iter_mut().for_each(|p| p.coords = moved * p.coords);
        cloud.normals.iter_mut().for_each(|n| *n = matrix * *n);
        for c in candidates {
            let View { target, position } = c.view;
            c.view = View { target: (moved * target.coords).into(), position: (moved * position.coords).into() };
        }
        *working_distance *= scale;
        for camera in &mut *cameras {
            camera.translation.vector = moved * camera.translation.vector;
            camera.rotation = UnitQuaternion::from_rotation_matrix(&rotation) * camera.rotation;
        }
        self.blur_cameras(cloud, cameras, rng);
    }

    /// Withholds the past cameras, or turns each about the centre of the cloud.
    fn blur_cameras(&self, cloud: &PointCloud, cameras: &mut Vec<Isometry3<f64>>, rng: &mut impl Rng) {
        if self.forget_cameras > 0.0 && rng.random::<f64>() < self.forget_cameras {
            cameras.clear();
        }
        if self.camera_error_deg > 0.0 && !cloud.is_empty() {
            let (low, high) = cloud.bounding_box();
            let centre = nalgebra::center(&low, &high);
            let error = self.camera_error_deg.to_radians();
            for camera in cameras {
                let turn = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * error;
                camera.append_rotation_wrt_point_mut(&UnitQuaternion::from_scaled_axis(turn), &centre);
            }
        }
    }

    fn draw_rotation(&self, rng: &mut impl Rng) -> Rotation3<f64> {
        let turn = match self.turn {
            Turn::None => Rotation3::identity(),
            Turn::Vertical => {
                Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU * rng.random::<f64>())
            }
            Turn::Any => uniform_rotation(rng),
        };
        let limit = self.rotation_deg.to_radians();
        let mut angle = || limit * (2.0 * rng.random::<f64>() - 1.0);
        let (x, y, z) = (angle(), angle(), angle());
        Rotation3::from_euler_angles(x, y, z) * turn
    }
}

/// Uniform over all rotations: a quaternion of four independent Gaussians.
fn uniform_rotation(rng: &mut impl Rng) -> Rotation3<f64> {
    let q = nalgebra::Quaternion::from(std::array::from_fn::<f64, 4, _>(|_| rng.sample(StandardNormal)));
    UnitQuaternion::try_new(q, 1e-12).unwrap_or_default().to_rotation_matrix()
}

/// Leaves out each point with probability `share`, but never all.
fn drop_points(cloud: &mut PointCloud, share: f64, rng: &mut impl Rng) {
    let keep: Vec<bool> = cloud.points.iter().map(|_| rng.random::<f64>() >= share).collect();
    if !keep.contains(&true) {
        return;
    }
    let with_normals = cloud.has_normals();
    let mut flags = keep.iter();
    cloud.points.retain(|_| flags.next().copied().unwrap_or(true));
    if with_normals {
        let mut flags = keep.iter();
        cloud.normals.retain(|_| flags.next().copied().unwrap_or(true));
    }
}

#[cfg(test)]
mod tests;
