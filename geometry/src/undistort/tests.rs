use super::*;
use nalgebra::{Isometry3, Point3, Vector3};

const MILD: Lens = Lens::BrownConrady([0.0712, -0.1841, 0.0006, -0.0011, 0.0934, 0.0, 0.0, 0.0]);
const BARREL: Lens = Lens::BrownConrady([-0.2814, 0.1173, 0.0012, -0.0008, -0.0235, 0.0, 0.0, 0.0]);
const FISHEYE: Lens = Lens::Fisheye([-0.0071, 0.0432, -0.0411, 0.0077]);

fn camera() -> PinholeCamera {
    PinholeCamera { width: 320, height: 240, fx: 250.0, fy: 251.0, cx: 158.3, cy: 121.9 }
}

/// What a distorted camera sees of a plane through (0, 0, 1), and of a nearer square in its middle.
fn shot(lens: &Lens, normal: Vector3<f64>, step: bool) -> DepthImage {
    let camera = camera();
    let mut depth = Vec::new();
    for row in 0..camera.height {
        for column in 0..camera.width {
            let at = camera.unproject(f64::from(column), f64::from(row), 1.0);
            let ray = lens.undistort(at.coords.xy()).expect("in the model");
            let z = normal.z / normal.dot(&Vector3::new(ray.x, ray.y, 1.0));
            depth.push(if step && ray.amax() < 0.2 { 0.8 * z } else { z } as f32);
        }
    }
    DepthImage { origin: [0, 0], size: [camera.width, camera.height], depth }
}

#[test]
fn a_plane_stays_a_plane() {
    let normal = Vector3::new(0.6, -0.3, -1.0).normalize();
    for lens in [MILD, BARREL, FISHEYE] {
        let seen = undistort_depth(&shot(&lens, normal, false), &camera(), &lens);
        let off = |p: &Point3<f64>| (p - Point3::new(0.0, 0.0, 1.0)).dot(&normal).abs();
        let points = seen.image.to_points(&seen.camera, &Isometry3::identity());
        // Seen more flatly, neighbours count as two surfaces.
        let steep = |p: &&Point3<f64>| p.coords.normalize().dot(&normal).abs() > 75f64.to_radians().cos();
        let mut off: Vec<f64> = points.iter().filter(steep).map(off).collect();
        off.sort_by(f64::total_cmp);
        assert!(points.len() > 70_000 && seen.left_out == 0, "{lens:?}: {} points", points.len());
        let [usual, most] = [off[off.len() * 99 / 100], off[off.len() - 1]];
        assert!(usual < 2e-5 && most < 1e-4, "{lens:?}: {usual} m off, {most} m at the edge");
        // Read as a pinhole image it is bent.
        let bent = shot(&lens, normal, false).to_points(&camera(), &Isometry3::identity());
        let bent = bent.iter().map(|p| (p - Point3::new(0.0, 0.0, 1.0)).dot(&normal).abs()).fold(0.0, f64::max);
        assert!(bent > 5e-3, "{lens:?}: {bent}");
    }
}

#[test]
fn nothing_is_made_up_between_two_surfaces() {
    for lens in [MILD, BARREL, FISHEYE] {
        let seen = undistort_depth(&shot(&lens, -Vector3::z(), true), &camera(), &lens);
        let between = seen.image.depth.iter().filter(|z| **z > 0.8001 && **z < 0.9999).count();
        let near = seen.image.depth.iter().filter(|z| (**z - 0.8).abs() < 1e-4).count();
        let expected = 0.16 * seen.camera.fx * seen.camera.fy;
        assert!(between == 0 && (near as f64 / expected - 1.0).abs() < 0.03, "{between} between, {near} of {expected}");
    }
}

#[test]
fn what_a_pinhole_image_cannot_show_is_counted_and_not_missed() {
    let lens = Lens::Fisheye([0.0; 4]);
    let camera = PinholeCamera { width: 400, height: 400, fx: 120.0, fy: 120.0, cx: 199.5, cy: 199.5 };
    let image = DepthImage { origin: [0, 0], size: [400, 400], depth: vec![1.0; 160_000] };
    let seen = undistort_depth(&image, &camera, &lens);
    let pixels = u64::from(seen.camera.width) * u64::from(seen.camera.height);
    assert!(seen.left_out > 60_000 && pixels <= 4 * 160_000 + 4_000, "{} left out, {pixels} pixels", seen.left_out);
    assert!(seen.image.depth.iter().all(|z| *z != 0.0), "nothing returned nothing");
}

#[test]
fn a_focal_length_that_does_not_fit_makes_no_endless_image() {
    let lens = Lens::BrownConrady([0.1, -0.2, 1e-3, -2e-3, 0.05, 0.0, 0.0, 0.0]);
    let image = DepthImage { origin: [0, 0], size: [16, 12], depth: vec![0.7; 192] };
    for (fx, fy) in [(500.0, 5e15), (1e300, 500.0), (1e-300, 1e9), (1e-9, 1e-9)] {
        let camera = PinholeCamera { width: 16, height: 12, fx, fy, cx: 320.0, cy: 239.0 };
        let seen = undistort_depth(&image, &camera, &lens);
        assert!(seen.image.depth.len() <= 2 * 4 * 192, "{fx} {fy}: {} x {}", seen.camera.width, seen.camera.height);
    }
}
