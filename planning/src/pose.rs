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
mod tests {
    use super::*;
    use nalgebra::Point3;
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

    #[test]
    fn a_matrix_off_by_rounding_becomes_the_rotation_next_to_it() {
        let exact = view([1.0, 2.0, 0.5]).world_from_camera();
        let mut rows = Pose::from(&exact).matrix;
        rows[0][0] += 8e-3;
        rows[1][2] -= 5e-3;
        let (found, off) = rigid(&rows).expect("near a rotation");
        assert!(off > 2e-3 && off < 1e-2, "{off}");
        assert!(found.rotation.angle_to(&exact.rotation) < 1e-2, "{found:?}");
        assert_eq!(found.translation, exact.translation);
        rows[0][0] += 0.3;
        assert!(rigid(&rows).expect_err("too far").contains("not a rigid motion"));
        rows[0][0] = f64::NAN;
        assert!(rigid(&rows).expect_err("no number").contains("not finite"));
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
