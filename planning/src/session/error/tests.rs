use crate::{Scan, Session, SessionConfig};
use geometry::PointCloud;
use nalgebra::Point3;

#[test]
fn coordinates_of_a_survey_are_refused_with_the_way_out() {
    let told = |northing: f64, points: u32| {
        let at = |i: u32| Point3::new(4e5 + 0.004 * f64::from(i % 40), northing + 0.004 * f64::from(i / 40), 100.0);
        let cloud = PointCloud { points: (0..points).map(at).collect(), normals: Vec::new() };
        let mut session = Session::new(SessionConfig::default(), None).expect("in range");
        session.add_scan(Scan::Cloud { cloud, from: None }).expect_err("nothing is left").to_string()
    };
    let far = told(5e6, 1_600);
    assert!(far.contains("1600 farther than a million metres from the origin") && far.contains("subtract an offset"));
    assert!(!told(0.0, 20).contains("offset"), "too few is another matter");
}
