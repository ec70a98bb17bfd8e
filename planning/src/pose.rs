//! A view as a pose that a robot can use.

use geometry::View;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
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
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Point3, Quaternion, Translation3};
    use proptest::prelude::*;

    fn view(position: [f64; 3]) -> View {
        View { target: Point3::origin(), position: Point3::from(position) }
    }

    #[test]
    fn a_view_along_x_has_the_expected_axes() {
        // Camera at +x looking at the origin, z up: right = forward x up = (-x) x z = +y, down = -z.
        let pose = Pose::from(&world_from_camera(&view([2.0, 0.0, 0.0]), &PoseConfig::default(), &Vector3::z()));
        let expected = Matrix4::new(0., 0., -1., 2., 1., 0., 0., 0., 0., -1., 0., 0., 0., 0., 0., 1.);
        for (row, values) in pose.matrix.iter().enumerate() {
            for (column, value) in values.iter().enumerate() {
                assert!((value - expected[(row, column)]).abs() < 1e-12, "{row} {column}: {:?}", pose.matrix);
            }
        }
    }

    #[test]
    fn settings_turn_the_image() {
        let seen_from = view([1.0, 1.0, 0.5]);
        let upright = world_from_camera(&seen_from, &PoseConfig::default(), &Vector3::z());
        let sideways = PoseConfig { extra_roll_deg: 90.0, ..Default::default() };
        let turned = world_from_camera(&seen_from, &sideways, &Vector3::z());
        assert!((turned * Vector3::x() - upright * Vector3::y()).norm() < 1e-12, "right becomes what was down");
        assert!((turned * Vector3::z() - upright * Vector3::z()).norm() < 1e-12, "the optical axis stays");
        let x_up = world_from_camera(&seen_from, &PoseConfig::default(), &Vector3::x());
        assert!((x_up * -Vector3::y()).x > 0.5, "another up vector turns the image");
        let published =
            world_from_camera(&seen_from, &PoseConfig { roll: Roll::Published, ..Default::default() }, &Vector3::x());
        assert_eq!(published, seen_from.world_from_camera(), "the published roll ignores the setting of up");
    }

    proptest! {
        #[test]
        fn three_forms_agree_and_the_image_is_upright(x in -3.0..3.0f64, y in -3.0..3.0f64, z in -3.0..3.0f64) {
            prop_assume!(x.hypot(y) > 1e-3);
            let v = view([x, y, z]);
            let isometry = world_from_camera(&v, &PoseConfig::default(), &Vector3::z());
            let pose = Pose::from(&isometry);
            let [i, j, k, w] = pose.quaternion_xyzw;
            let again = Isometry3::from_parts(
                Translation3::from(pose.translation_m),
                UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)),
            ).to_homogeneous();
            for row in 0..4 {
                for column in 0..4 {
                    prop_assert!((again[(row, column)] - pose.matrix[row][column]).abs() < 1e-9);
                }
            }
            prop_assert!(w >= 0.0);
            prop_assert!((isometry * -Vector3::y()).z > 0.0, "image-up points up");
            prop_assert!((isometry * Vector3::x()).z.abs() < 1e-9, "the horizon is level");
            let ahead = isometry.inverse() * v.target;
            prop_assert!(ahead.x.abs() < 1e-9 && ahead.y.abs() < 1e-9 && ahead.z > 0.0, "the target is in the centre");
        }
    }
}
