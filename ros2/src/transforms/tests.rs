use super::*;
use crate::messages::{Header, Quaternion, Time, Transform, Vector3};
use nalgebra::{Translation3, UnitQuaternion};

const SECOND: i64 = 1_000_000_000;

fn transform(parent: &str, child: &str, at_ns: i64, pose: &Isometry3<f64>) -> TFMessage {
    let (t, q) = (pose.translation.vector, pose.rotation.quaternion());
    TFMessage {
        transforms: vec![TransformStamped {
            header: Header { stamp: Time::from_nanoseconds(at_ns), frame_id: parent.to_owned() },
            child_frame_id: child.to_owned(),
            transform: Transform {
                translation: Vector3 { x: t.x, y: t.y, z: t.z },
                rotation: Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
            },
        }],
    }
}

fn moved(x: f64, turn_deg: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, turn_deg.to_radians());
    Isometry3::from_parts(Translation3::new(x, 0.0, 0.0), turn)
}

/// base -> flange (moves: 1 m and 90 degrees from second 10 to 11) -> camera (fixed); base -> table (fixed).
fn robot() -> Transforms {
    let mut known = Transforms::new(Duration::from_secs(60));
    for (message, fixed) in [
        (transform("base", "flange", 10 * SECOND, &moved(0.0, 0.0)), false),
        (transform("base", "flange", 11 * SECOND, &moved(1.0, 90.0)), false),
        (transform("flange", "camera", 0, &moved(0.5, 0.0)), true),
        (transform("base", "table", 0, &moved(2.0, 180.0)), true),
    ] {
        assert_eq!(known.take(&message, fixed), Vec::<String>::new());
    }
    known
}

fn near(found: &Isometry3<f64>, expected: &Isometry3<f64>) {
    let off = expected.inverse() * found;
    assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7, "{found}, expected {expected}");
}

#[test]
fn positions_and_rotations_are_interpolated_at_the_time_of_the_scan() {
    let found = robot().lookup("base", "camera", Some(10 * SECOND + SECOND / 2)).expect("known");
    near(&found.pose, &(moved(0.5, 45.0) * moved(0.5, 0.0)));
    assert_eq!(found.gap, Some((1.0, "flange".to_owned())));
    let exact = robot().lookup("base", "camera", Some(11 * SECOND)).expect("known");
    near(&exact.pose, &(moved(1.0, 90.0) * moved(0.5, 0.0)));
    assert_eq!(exact.gap, None);
}

#[test]
fn ways_lead_over_the_common_frame_and_back() {
    let known = robot();
    let at = Some(11 * SECOND);
    let found = known.lookup("table", "camera", at).expect("known").pose;
    near(&found, &(moved(2.0, 180.0).inverse() * moved(1.0, 90.0) * moved(0.5, 0.0)));
    near(&known.lookup("camera", "table", at).expect("known").pose, &found.inverse());
    near(&known.lookup("flange", "camera", Some(99 * SECOND)).expect("fixed").pose, &moved(0.5, 0.0));
    near(&known.lookup("base", "camera", None).expect("the newest").pose, &(moved(1.0, 90.0) * moved(0.5, 0.0)));
    near(&known.lookup("/base", "base", at).expect("itself").pose, &Isometry3::identity());
}

#[test]
fn what_is_missing_is_said() {
    let mut known = robot();
    let said = |known: &Transforms, frame: &str, at: i64| known.lookup("base", frame, Some(at)).expect_err("missing");
    let unknown = said(&known, "gripper", 10 * SECOND);
    assert_eq!(unknown.to_string(), "frame \"gripper\" is not in the tree of transforms (base, camera, flange, table)");
    known.take(&transform("island", "boat", 0, &moved(0.0, 0.0)), true);
    let apart = said(&known, "boat", 10 * SECOND).to_string();
    assert!(apart.contains("no transforms connect \"boat\" (in the tree of \"island\") with \"base\""), "{apart}");
    let new = said(&known, "camera", 11 * SECOND + SECOND / 4);
    assert_eq!(new.to_string(), "the newest transform of \"flange\" in \"base\" is 0.250 s older than the message");
    let old = said(&known, "camera", 9 * SECOND);
    assert!(old.to_string().starts_with("the message is 1.000 s older than the oldest transform kept"), "{old}");
    assert_eq!([&unknown, &new, &old].map(TransformError::may_come), [true, true, false]);
    let none = Transforms::new(Duration::from_secs(1)).lookup("base", "camera", None).expect_err("nothing");
    assert!(none.to_string().contains("none has arrived on /tf or /tf_static"), "{none}");
}

#[test]
fn a_circle_is_no_tree() {
    let mut known = Transforms::new(Duration::from_secs(60));
    for (parent, child) in [("a", "b"), ("b", "c"), ("c", "a")] {
        known.take(&transform(parent, child, 0, &moved(1.0, 0.0)), true);
    }
    assert_eq!(known.lookup("x", "a", None).expect_err("a cycle"), TransformError::Circle { frame: "a".to_owned() });
}

/// Where `child` is at this time, milliseconds. By [`tell`], it is as many metres along x.
fn told(known: &Transforms, child: &str, at_ms: i64) -> Result<f64, TransformError> {
    known.lookup("base", child, Some(at_ms * SECOND / 1000)).map(|f| f.pose.translation.x)
}

fn tell(known: &mut Transforms, child: &str, at_ms: i64) -> Vec<String> {
    known.take(&transform("base", child, at_ms * SECOND / 1000, &moved(at_ms as f64, 0.0)), false)
}

#[test]
fn late_ones_are_sorted_in_and_old_ones_forgotten() {
    let mut known = Transforms::new(Duration::from_secs(60));
    for at in [100_000, 100_400, 100_200] {
        assert_eq!(tell(&mut known, "flange", at), Vec::<String>::new());
    }
    assert_eq!(told(&known, "flange", 100_200), Ok(100_200.0));
    assert_eq!(told(&known, "flange", 100_300), Ok(100_300.0));
    tell(&mut known, "flange", 160_200);
    assert!(matches!(told(&known, "flange", 100_000), Err(TransformError::TooOld { .. })), "older than 60 s");
    assert_eq!(told(&known, "flange", 100_200), Ok(100_200.0));
}

#[test]
fn a_clock_set_back_begins_anew_for_all_frames() {
    for (end, start) in [(500_000, 3_000), (30_000, 1_000)] {
        let mut known = robot();
        // A publisher that is late by ten seconds, in either run.
        for at in [end - 20, end] {
            tell(&mut known, "flange", at);
            tell(&mut known, "turntable", at);
            tell(&mut known, "late", at - 10_000);
        }
        // New ones of others, the first of which is the first frame of the new run that is heard of.
        tell(&mut known, "new", start);
        let said = tell(&mut known, "flange", start + 20);
        assert!(said[0].contains("time jumped back"), "{said:?}");
        assert_eq!(told(&known, "flange", start + 20), Ok((start + 20) as f64));
        for old in ["turntable", "late"] {
            assert!(told(&known, old, start + 20).expect_err(old).to_string().contains("not in the tree"));
            assert!(known.lookup("base", old, None).is_err(), "not even the newest");
        }
        // The next of other frames does not take away what is new.
        for (child, at) in [("turntable", start + 40), ("late", start - 9_960), ("flange", start + 60)] {
            assert_eq!(tell(&mut known, child, at), Vec::<String>::new(), "{child}");
        }
        assert_eq!(told(&known, "flange", start + 40), Ok((start + 40) as f64), "between two of the new run");
        assert_eq!(told(&known, "turntable", start + 40), Ok((start + 40) as f64));
        assert_eq!(told(&known, "new", start), Ok(start as f64));
        near(&known.lookup("flange", "camera", None).expect("fixed ones stay").pose, &moved(0.5, 0.0));
    }
}

#[test]
fn a_straggler_of_before_takes_nothing_new_with_it() {
    let mut known = robot();
    for (child, at) in
        [("flange", 30_000), ("turntable", 30_000), ("flange", 1_000), ("turntable", 30_020), ("turntable", 1_010)]
    {
        tell(&mut known, child, at);
    }
    assert_eq!(told(&known, "flange", 1_000), Ok(1_000.0));
    assert_eq!(told(&known, "turntable", 1_010), Ok(1_010.0));
    assert!(told(&known, "turntable", 20_000).is_err());
}

#[test]
fn transforms_that_are_none_are_left_out_and_told_once() {
    let mut known = robot();
    let mut odd = transform("base", "flange", 12 * SECOND, &moved(0.0, 0.0));
    odd.transforms[0].transform.rotation = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
    assert!(known.take(&odd, false)[0].contains("a quaternion of length 0"));
    assert_eq!(known.take(&odd, false), Vec::<String>::new());
    odd.transforms[0].transform.rotation = Quaternion::default();
    odd.transforms[0].transform.translation.x = f64::NAN;
    assert!(known.take(&odd, false)[0].contains("not finite"));
    assert!(known.take(&transform("a", "a", 0, &moved(0.0, 0.0)), false)[0].contains("a frame in itself"));
    assert!(known.take(&transform("", "a", 0, &moved(0.0, 0.0)), false)[0].contains("without a name"));
    let moved_over = known.take(&transform("table", "flange", 12 * SECOND, &moved(0.0, 0.0)), false);
    assert!(moved_over[0].contains("its parent was \"base\" before"), "{moved_over:?}");
    near(&known.lookup("table", "flange", Some(12 * SECOND)).expect("known").pose, &moved(0.0, 0.0));
}
