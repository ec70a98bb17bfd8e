use super::*;
use crate::{NoReturn, Scan, SessionConfig};
use geometry::DepthImage;

#[test]
fn what_one_look_leaves_open_is_what_closes_the_area_it_saw() {
    let eye = Point3::new(0.0, 0.0, 1e4);
    let grid = |n: i32| (-n..=n).flat_map(move |x| (-n..=n).map(move |y| [x, y].map(|k| f64::from(k) / f64::from(n))));
    let flat: Vec<Point3<f64>> = grid(20).map(|[x, y]| Point3::new(x, y, 0.0)).collect();
    let near = |open: f64, share: f64| assert!((open - share).abs() < 0.015, "{open}, not {share}");
    near(open_share(&flat, &vec![Vector3::z(); flat.len()], &eye), 0.5);
    // Half a ball, as many points per pixel: a disc of a third of the surface closes it.
    let ball: Vec<Point3<f64>> = grid(200)
        .filter_map(|[x, y]| Some(Point3::new(x, y, Some(1.0 - x * x - y * y).filter(|z2| *z2 > 0.0)?.sqrt())))
        .collect();
    let normals: Vec<Vector3<f64>> = ball.iter().map(|p| p.coords).collect();
    near(open_share(&ball, &normals, &eye), 1.0 / 3.0);
    // Both sides: nothing is open.
    let (both, away) = ([flat.clone(), flat.clone()].concat(), vec![-Vector3::z(); flat.len()]);
    near(open_share(&both, &[vec![Vector3::z(); flat.len()], away].concat(), &eye), 0.0);
    assert_eq!(open_share(&[], &[], &eye), 0.0);
}

/// A depth image of a rectangle 1.2 m ahead, its middle in the middle of the image, in pixels of 2.3 mm; around it there is nothing.
fn face(size: [u32; 2], world_from_camera: Isometry3<f64>) -> Scan {
    let camera = SessionConfig::default().camera.camera();
    let origin = [camera.width / 2 - size[0] / 2, camera.height / 2 - size[1] / 2];
    let depth = DepthImage { origin, size, depth: vec![1.2; (size[0] * size[1]) as usize] };
    Scan::Depth { camera, depth, world_from_camera, misses: NoReturn::Free }
}

#[test]
fn of_a_blade_seen_on_its_edge_no_gain_is_told() {
    let answer = |scans: Vec<Scan>| {
        let mut session = Session::new(SessionConfig::default(), None).expect("settings in range");
        scans.into_iter().for_each(|scan| session.add_scan(scan).map(drop).expect("a scan"));
        session.next_view().expect("an answer")
    };
    // 5 mm thick, 40 mm wide, 180 mm long.
    let edge = || face([2, 78], Isometry3::identity());
    let to_the_side = Isometry3::new(Vector3::new(1.2, 0.0, 1.22), Vector3::y() * -std::f64::consts::FRAC_PI_2);
    let side = || face([18, 78], to_the_side);
    let warned = |answer: &Answer| answer.warnings.iter().any(|w| w.contains("does not close"));
    let thin = answer(vec![edge()]);
    assert!(warned(&thin) && !thin.stop.stop && thin.stop.basis.starts_with("unknown: at least"), "{:?}", thin.stop);
    assert_eq!((thin.stop.expected_gain, &thin.missing, &thin.surface), (None, &None, &None));
    assert!(thin.next.expect("a view").expected_gain.is_none());
    // A side that is wide enough, and both: the planner makes out what is missing.
    for scans in [vec![side()], vec![edge(), side()]] {
        let told = answer(scans);
        assert!(!warned(&told) && told.stop.expected_gain.is_some() && told.missing.is_some(), "{:?}", told.stop);
    }
}
