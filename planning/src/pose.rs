//! A view as a pose that a robot can use.

use geometry::View;
use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// How the roll about the optical axis is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Roll {
    /// Image-up as close as possible to `constraints.up`.
    #[default]
    Upright,
    /// The published up vector (see [`View::world_from_camera`]).
    Published,
}

/// Roll of the answered pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseConfig {
    /// Which up.
    pub roll: Roll,
    /// Turned further about the optical axis, clockwise in the image, degrees (a camera mounted on its side: 90).
    pub extra_roll_deg: f64,
}

/// `world_from_camera`, camera +X right, +Y down, +Z forward, metres: the same pose three ways.
///
/// ```
/// use geometry::View;
/// use nalgebra::Point3;
/// use planning::pose::Pose;
///
/// let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.2) };
/// let pose = Pose::from(&view.world_from_camera());
/// assert_eq!(pose.translation_m, [0.0, 0.0, 1.2]);
/// assert!((pose.matrix[2][2] + 1.0).abs() < 1e-12, "+Z, the way it looks, points down");
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// 4 x 4, row by row.
    pub matrix: [[f64; 4]; 4],
    /// Unit quaternion x, y, z, w (the order of ROS), w not negative.
    pub quaternion_xyzw: [f64; 4],
    /// Position of the camera.
    pub translation_m: [f64; 3],
}

/// The pose of a camera at `view`.
pub fn world_from_camera(view: &View, config: &PoseConfig, up: &Vector3<f64>) -> Isometry3<f64> {
    let pose = match config.roll {
        Roll::Upright => view.world_from_camera_with_up(up),
        Roll::Published => view.world_from_camera(),
    };
    pose * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), config.extra_roll_deg.to_radians())
}

/// How a camera is turned about its optical axis at views; the default is the published roll ([`View::world_from_camera`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraRoll(Option<(PoseConfig, Vector3<f64>)>);

impl CameraRoll {
    /// By these settings, `up` being of unit length and in the frame of the views.
    pub fn new(config: &PoseConfig, up: &Vector3<f64>) -> Self {
        // The published roll brings image-up as close to z as can be: the same pose but for rounding, and that of simulated cameras.
        let published = config.roll == Roll::Published || *up == Vector3::z();
        Self((!published || config.extra_roll_deg != 0.0).then_some((*config, *up)))
    }

    /// The pose of a camera at `view`.
    pub fn world_from_camera(&self, view: &View) -> Isometry3<f64> {
        match &self.0 {
            Some((config, up)) => world_from_camera(view, config, up),
            None => view.world_from_camera(),
        }
    }
}

/// A 4 x 4 matrix, row by row, as the rigid motion next to it, and how far its rotation was off (the largest element of the
/// difference).
///
/// # Errors
/// What is wrong: numbers that are not finite, a last row that is not 0 0 0 1, a rotation off by more than 0.1 or mirrored.
pub fn rigid(rows: &[[f64; 4]; 4]) -> Result<(Isometry3<f64>, f64), String> {
    let m = Matrix4::from_fn(|r, c| rows[r][c]);
    if !m.iter().all(|x| x.is_finite()) {
        return Err("world_from_camera has numbers that are not finite".to_owned());
    }
    if (m.row(3) - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)).amax() > 1e-9 {
        return Err("world_from_camera: the last row must be 0 0 0 1 (the matrix is given row by row)".to_owned());
    }
    let given: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
    let svd = given.svd(true, true);
    let nearest = svd.u.zip(svd.v_t).map(|(u, v)| u * v).unwrap_or_else(Matrix3::zeros);
    let off = (nearest - given).amax();
    let determinant = given.determinant();
    if off > MOST_OFF || nearest.determinant() < 0.5 {
        return Err(format!(
            "world_from_camera is not a rigid motion: its rotation is off by {off:.1e}, determinant {determinant:.3}"
        ));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest));
    Ok((Isometry3::from_parts(Translation3::new(m.m14, m.m24, m.m34), rotation), off))
}

/// A quaternion (x, y, z, w; normalised) and a translation as a rigid motion.
///
/// # Errors
/// A quaternion that is not of unit length, numbers that are not finite.
pub fn from_quaternion([x, y, z, w]: [f64; 4], translation: [f64; 3]) -> Result<Isometry3<f64>, String> {
    let quaternion = Quaternion::new(w, x, y, z);
    if !(quaternion.norm() - 1.0).is_finite() || (quaternion.norm() - 1.0).abs() > 0.01 {
        return Err(format!("a quaternion of length {}, not 1", quaternion.norm()));
    }
    if translation.iter().any(|t| !t.is_finite()) {
        return Err("a translation that is not finite".to_owned());
    }
    Ok(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::from_quaternion(quaternion)))
}

/// Rotations are farther off than by rounding, and are refused.
const MOST_OFF: f64 = 0.1;

impl From<&Isometry3<f64>> for Pose {
    fn from(pose: &Isometry3<f64>) -> Self {
        let m = pose.to_homogeneous();
        let q = pose.rotation.quaternion();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        Self {
            matrix: std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)])),
            quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|x| x * sign),
            translation_m: pose.translation.vector.into(),
        }
    }
}

#[cfg(test)]
mod tests;
