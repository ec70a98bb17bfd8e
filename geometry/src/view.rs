//! Where to look from, and at.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A camera position that looks at a target (docs/method.md, 'Setting').
///
/// ```
/// use geometry::View;
/// use nalgebra::Point3;
///
/// let view = View { target: Point3::origin(), position: Point3::new(0.0, -1.2, 0.0) };
/// // The camera's +Z is the way it looks: the target is 1.2 m ahead.
/// let ahead = view.world_from_camera() * Point3::new(0.0, 0.0, 1.2);
/// assert!((ahead - view.target).norm() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct View {
    /// The point looked at.
    pub target: Point3<f64>,
    /// The camera's optical centre.
    pub position: Point3<f64>,
}

impl View {
    /// The view of a camera with this pose: its target lies `distance` metres ahead, along its +Z.
    ///
    /// ```
    /// use geometry::View;
    /// use nalgebra::Point3;
    ///
    /// let view = View { target: Point3::new(0.1, 0.0, 0.3), position: Point3::new(0.1, -1.2, 0.3) };
    /// let again = View::from_pose(&view.world_from_camera(), 1.2);
    /// assert!((again.target - view.target).norm() < 1e-12 && again.position == view.position);
    /// ```
    pub fn from_pose(world_from_camera: &Isometry3<f64>, distance: f64) -> Self {
        let target = world_from_camera * Point3::new(0.0, 0.0, distance);
        Self { target, position: Point3::from(world_from_camera.translation.vector) }
    }

    /// Whether the view has finite coordinates and a direction.
    pub fn is_valid(&self) -> bool {
        let d = self.position - self.target;
        d.iter().all(|x| x.is_finite()) && d.norm() > 0.0
    }

    /// Unit vector from the target to the camera; zero for a degenerate view.
    pub fn direction(&self) -> Vector3<f64> {
        (self.position - self.target).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
    }

    /// The camera pose with the published up vector: with b = unit(camera - target), up = b x unit(z x b),
    /// and (0, sign(b_z), 0) where b is +-z (docs/method.md, 'Setting').
    pub fn world_from_camera(&self) -> Isometry3<f64> {
        self.world_from_camera_with_up(&self.published_up())
    }

    /// The camera pose whose image-up is closest to `up`; falls back to the published up where `up` is
    /// parallel to the viewing direction.
    pub fn world_from_camera_with_up(&self, up: &Vector3<f64>) -> Isometry3<f64> {
        let forward = -self.direction();
        let right = forward
            .cross(up)
            .try_normalize(1e-9)
            .unwrap_or_else(|| forward.cross(&self.published_up()).try_normalize(0.0).unwrap_or_else(Vector3::x));
        let down = forward.cross(&right);
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[right, down, forward]));
        Isometry3::from_parts(Translation3::from(self.position.coords), UnitQuaternion::from_rotation_matrix(&rotation))
    }

    fn published_up(&self) -> Vector3<f64> {
        let b = self.direction();
        match Vector3::z().cross(&b).try_normalize(1e-12) {
            Some(side) => b.cross(&side),
            None => Vector3::new(0.0, b.z.signum(), 0.0),
        }
    }
}
