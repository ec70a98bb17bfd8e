use super::*;
use formats::sequence::SequenceScan;
use nalgebra::Vector3;

/// A square of 20 mm, scanned from above or from below, at these heights.
fn square(scans: &[(f64, f64)]) -> Recording {
    let scan = |&(height, from): &(f64, f64)| {
        let points = (0..1600).map(|k| Point3::new(0.0005 * f64::from(k % 40), 0.0005 * f64::from(k / 40), height));
        let view = View { target: Point3::new(0.01, 0.01, 0.0), position: Point3::new(0.01, 0.01, from) };
        SequenceScan { points: points.collect(), world_from_camera: view.world_from_camera(), image: None }
    };
    let sequence = Sequence {
        up: Vector3::y(),
        working_distance_m: 1.0,
        tolerance_m: Some(0.0006),
        region_m: None,
        background: None,
        scans: scans.iter().map(scan).collect(),
    };
    Recording::new(sequence, 0.002)
}

#[test]
fn scans_that_lie_apart_by_their_noise_are_one_surface() {
    let single = square(&[(0.0, 1.0), (0.0, 1.0)]);
    assert!(single.spread_m() < 1e-6, "{}", single.spread_m());
    let apart = square(&[(0.0, 1.0), (0.0012, 1.0)]);
    // Both lie 0.6 mm from their mean.
    assert!((0.0005..0.0015).contains(&apart.spread_m()), "{}", apart.spread_m());
    assert_eq!(apart.reference().len(), single.reference().len());
    for scan in 0..2 {
        assert_eq!(apart.covered_by(scan).len(), apart.reference().len(), "scan {scan} covers all of it");
    }
    assert!(apart.reference().iter().all(|p| (p.z - 0.0006).abs() < 1e-6), "{:?}", apart.reference()[0]);
}

#[test]
fn the_two_sides_of_a_sheet_stay_two_surfaces() {
    let sheet = square(&[(0.0, -1.0), (0.0012, 1.0)]);
    let shares = [0, 1].map(|scan| sheet.covered_by(scan).len() as f64 / sheet.reference().len() as f64);
    assert_eq!(shares, [0.5, 0.5]);
    assert_eq!(sheet.spread_m(), 0.0, "no point was measured twice");
}
