use super::*;
use crate::{Scan, Session, SessionConfig};
use geometry::rng;
use rand::RngExt;

/// What the pixels of a camera 1.2 m above see of a ball of 10 cm, with outward normals.
fn dome() -> PointCloud {
    let mut cloud = PointCloud::default();
    for i in 0..6_400 {
        let [x, y] = [i % 80, i / 80].map(|k| (f64::from(k) - 39.5) / 40.0 * 0.09);
        let ray = Vector3::new(x, y, -1.0).normalize();
        // |1.2 z + t ray| = 0.1, the nearer one.
        let (b, c) = (1.2 * ray.z, 1.44 - 0.01);
        if b * b > c {
            let p = Vector3::new(0.0, 0.0, 1.2) + ray * (-b - (b * b - c).sqrt());
            cloud.points.push(p.into());
            cloud.normals.push(p / 0.1);
        }
    }
    cloud
}

fn doubt(from: [f64; 3]) -> Option<PositionDoubt> {
    let cloud = dome();
    of_position(&cloud, &cloud.points, &from.into(), 1.2, 0.0028)
}

#[test]
fn a_position_that_cannot_be_is_told_apart_from_one_that_can() {
    for from in [[0.0, 0.0, 1.2], [0.2, 0.1, 0.9], [0.0, -0.3, 0.8]] {
        assert_eq!(doubt(from), None, "{from:?}");
    }
    assert_eq!(doubt([0.0, 0.0, -1.2]), Some(PositionDoubt::Behind));
    assert!(matches!(doubt([0.0, 0.0, 1200.0]), Some(PositionDoubt::TooFar(away)) if away > 1_000.0));
    assert_eq!(doubt([0.0, 0.0, 0.0995]), Some(PositionDoubt::Inside));
    assert_eq!(doubt([0.85, 0.0, 0.85]), Some(PositionDoubt::Elsewhere), "45 degrees beside");
    let in_the_ball = doubt([0.0, 0.0, 0.0012]);
    assert!(matches!(in_the_ball, Some(PositionDoubt::Behind | PositionDoubt::Elsewhere)), "{in_the_ball:?}");
    assert!(matches!(doubt([1.2, 0.0, -0.3]), Some(PositionDoubt::Hidden(share)) if share > 0.4), "its far half");
}

#[test]
fn a_contradicted_position_is_not_used_and_said() {
    let scan = |z: f64| {
        let mut session = Session::new(SessionConfig::default(), None).expect("settings in range");
        let cloud = PointCloud { normals: Vec::new(), ..dome() };
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.0, 0.0, z)) }).expect("a scan");
        let answer = session.next_view().expect("an answer");
        (session.state().cloud.normals[2_000].z, answer)
    };
    let (right, answer) = scan(1.2);
    assert!(right > 0.0 && !answer.warnings.iter().any(|w| w.contains("camera position")), "{:?}", answer.warnings);
    let (estimated, answer) = scan(-1.2);
    assert!(estimated > 0.0, "the surface still faces up");
    assert!(answer.warnings[0].starts_with("the camera position of scan 1 lies behind"), "{:?}", answer.warnings);
    assert_eq!(answer.estimated_cameras.len(), 1);
}

#[test]
fn scans_that_do_not_fit_are_told_apart_from_noise() {
    let mut rng = rng::stream(1, "test/noise");
    let mut moved = |by: [f64; 3], noise: f64| {
        let mut cloud = dome();
        // Other pixels, the same surface.
        cloud.points = cloud.points.iter().step_by(2).map(|p| p + Vector3::from(by)).collect();
        cloud.normals = cloud.normals.iter().step_by(2).copied().collect();
        for p in &mut cloud.points {
            *p += Vector3::from_fn(|_, _| noise * rng.random_range(-1.0..1.0f64));
        }
        cloud
    };
    let tolerance = 0.002;
    let mut misfit = |by: [f64; 3], noise: f64| {
        let old = moved([0.0; 3], noise);
        offset(&old, &moved(by, noise), tolerance, 0.0028).expect("they share surface")
    };
    for noise in [0.0, 0.001, 0.002] {
        assert!(!misfit([0.0; 3], noise).is_misfit(tolerance), "noise {noise}: {:?}", misfit([0.0; 3], noise));
    }
    let off = misfit([0.0, 0.0, 0.005], 0.0005);
    assert!(off.is_misfit(tolerance) && (0.003..0.006).contains(&off.apart_m), "{off:?}");
    assert!(misfit([0.01, 0.0, 0.0], 0.0005).is_misfit(tolerance), "sideways");
    let elsewhere = offset(&dome(), &moved([0.5, 0.0, 0.0], 0.0), tolerance, 0.0028);
    assert_eq!(elsewhere, None, "nothing to compare");
}

#[test]
fn a_view_below_the_table_is_warned_of() {
    let warned = |table: bool, floor: Option<f64>, turntable: Option<crate::TurntableConfig>| {
        // A dome, on the plane it was scanned with or hanging free; only a view from below is given, or from above where it is upside down.
        let mut cloud = PointCloud { normals: Vec::new(), ..dome() };
        let rim = cloud.points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        if table {
            let at = |i: usize| Point3::new(0.003 * (i % 100) as f64 - 0.15, 0.003 * (i / 100) as f64 - 0.15, rim);
            cloud.points.extend((0..10_000).map(at).filter(|p| p.x.hypot(p.y) > 0.1));
        }
        let side = if turntable.is_some() { 1.0 } else { -1.0 };
        let mut config = SessionConfig { turntable, ..Default::default() };
        config.constraints.floor_height_m = floor;
        let mut session = Session::new(config, None).expect("settings in range");
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.0, 0.0, 1.2)) }).expect("a scan");
        let below = geometry::View { target: Point3::origin(), position: Point3::new(0.4, 0.0, side * 1.1) };
        session.set_given_views(vec![below.world_from_camera()]);
        let answer = session.next_view().expect("an answer");
        assert!(answer.next.is_some());
        answer.warnings.iter().any(|w| w.contains("constraints.floor_height_m="))
    };
    assert!(warned(true, None, None), "the plane is evident");
    assert!(!warned(false, None, None), "no sign of a table");
    assert!(!warned(true, Some(-2.0), None), "the user said where it is");
    let over = crate::TurntableConfig { axis_direction: [1.0, 0.0, 0.0], stops_deg: vec![180.0], ..Default::default() };
    assert!(!warned(true, None, Some(over)), "turned over, the camera is above all of it");
}

#[test]
fn few_points_have_no_density_to_doubt_by() {
    let mut cloud = dome();
    cloud.normals = cloud.normals.iter().step_by(40).copied().collect();
    cloud.points = cloud.points.iter().step_by(40).copied().collect();
    assert!(cloud.len() < 300);
    assert_eq!(of_position(&cloud, &cloud.points, &Point3::new(0.0, 0.0, -1.2), 1.2, 0.02), None);
}

#[test]
fn scans_that_meet_at_their_edges_fit() {
    // Two caps of one ball, of which the second begins a little before the first ends.
    let whole = dome();
    let part = |keep: fn(&Point3<f64>) -> bool| {
        let kept: Vec<usize> = (0..whole.len()).filter(|&i| keep(&whole.points[i])).collect();
        crate::thin::select(&whole, &kept)
    };
    let (left, right) = (part(|p| p.x < 0.003), part(|p| p.x > 0.0));
    if let Some(found) = offset(&left, &right, 0.002, 0.0028) {
        assert!(!found.is_misfit(0.002), "{found:?}");
        assert!(found.apart_m < 0.0005, "{found:?}");
    }
}
