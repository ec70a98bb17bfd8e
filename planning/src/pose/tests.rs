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
fn forecasts_have_the_answered_pose_and_by_default_the_published_one_to_the_last_bit() {
    let seen_from = view([1.0, 1.0, 0.5]);
    let by_default = CameraRoll::new(&PoseConfig::default(), &Vector3::z());
    assert_eq!(by_default, CameraRoll::default());
    assert_eq!(by_default.world_from_camera(&seen_from), seen_from.world_from_camera());
    let answered = world_from_camera(&seen_from, &PoseConfig::default(), &Vector3::z());
    let off = by_default.world_from_camera(&seen_from).to_homogeneous() - answered.to_homogeneous();
    assert!(off.amax() < 1e-12, "{off}");
    let sideways = PoseConfig { extra_roll_deg: 90.0, ..Default::default() };
    let published = PoseConfig { roll: Roll::Published, ..sideways };
    for (config, up) in [(sideways, Vector3::z()), (PoseConfig::default(), Vector3::x()), (published, Vector3::x())] {
        let expected = world_from_camera(&seen_from, &config, &up);
        assert_eq!(CameraRoll::new(&config, &up).world_from_camera(&seen_from), expected, "{config:?}");
    }
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
