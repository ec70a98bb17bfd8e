//! What must not change an answer: where the axes lie, the order and the number of the points, the resolution of the
//! camera. The grid's axes and the draw of candidates do change with them, so that equal means within bounds: the next view
//! is no worse than one that the other answer promises, and the shares are the same within a few percent.

use geometry::{DepthImage, PinholeCamera, PointCloud, View, rng};
use nalgebra::{Isometry3, Point3, Vector3};
use planning::config::CameraConfig;
use planning::{Answer, NoReturn, Scan, Session, SessionConfig};
use rand::seq::SliceRandom;

/// Two balls that touch, the larger one of 7 cm: by the nearer intersection of each pixel's ray.
fn depth(camera: &PinholeCamera, pose: &Isometry3<f64>) -> DepthImage {
    let balls = [(Point3::new(0.0, 0.0, 0.0), 0.07), (Point3::new(0.08, 0.02, 0.03), 0.04)];
    let balls = balls.map(|(middle, r)| (pose.inverse() * middle, r));
    let pixel = |i: u32| {
        let ray = camera.unproject(f64::from(i % camera.width), f64::from(i / camera.width), 1.0).coords;
        let hit = |(middle, r): &(Point3<f64>, f64)| {
            let (a, b, c) = (ray.norm_squared(), ray.dot(&middle.coords), middle.coords.norm_squared() - r * r);
            let disc = b * b - a * c;
            (disc > 0.0).then(|| (b - disc.sqrt()) / a)
        };
        balls.iter().filter_map(hit).min_by(f64::total_cmp).unwrap_or(0.0) as f32
    };
    let size = [camera.width, camera.height];
    DepthImage { origin: [0, 0], size, depth: (0..size[0] * size[1]).map(pixel).collect() }
}

fn first_view() -> Isometry3<f64> {
    View { target: Point3::new(0.02, 0.0, 0.0), position: Point3::new(0.3, -0.2, 0.7) }.world_from_camera()
}

fn camera(width: u32) -> CameraConfig {
    CameraConfig { width, height: width * 3 / 4, fov_y_deg: 35.0, intrinsics: None }
}

fn cloud(width: u32) -> PointCloud {
    let camera = camera(width).camera();
    PointCloud { points: depth(&camera, &first_view()).to_points(&camera, &first_view()), normals: Vec::new() }
}

fn config(max_points: usize) -> SessionConfig {
    SessionConfig { working_distance_m: 0.8, camera: camera(640), max_points, ..SessionConfig::default() }
}

fn ask(config: SessionConfig, scan: Scan) -> Answer {
    let mut session = Session::new(config, None).expect("settings in range");
    session.add_scan(scan).expect("a scan");
    session.next_view().expect("an answer")
}

fn from_cloud(cloud: PointCloud, motion: &Isometry3<f64>, max_points: usize) -> Answer {
    let points = cloud.points.iter().map(|p| motion * p).collect();
    let from = motion * Point3::from(first_view().translation.vector);
    ask(config(max_points), Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(from) })
}

/// Holds two answers against each other, the second moved by `motion`.
fn assert_same(a: &Answer, b: &Answer, motion: &Isometry3<f64>, what: &str) {
    let near = |x: f64, y: f64, bound: f64, name: &str| {
        assert!((x - y).abs() <= bound * x.abs().max(y.abs()), "{what}: {name} {x:.4} and {y:.4}");
    };
    let gain = |a: &Answer| a.stop.expected_gain.expect("a prediction");
    near(gain(a), gain(b), 0.1, "the largest gain");
    let missing = |a: &Answer| a.missing.clone().expect("what is missing");
    near(missing(a).share, missing(b).share, 0.1, "the missing share");
    let area = |a: &Answer| a.surface.expect("the surface").known_m2;
    // Sparser points stand for more beyond the edges.
    near(area(a), area(b), 0.15, "the measured area");
    let next = |a: &Answer| a.next.clone().expect("a next view");
    near(next(a).score, next(b).score, 0.07, "the best score");
    assert!(a.candidates.iter().chain(&b.candidates).all(|c| (0.0..=1.0).contains(&c.score)), "{what}: scores");
    // The view chosen is among the best of the other answer too.
    let eye = motion * Point3::from(next(a).position_m);
    let nearest = b.candidates.iter().filter(|c| (Point3::from(c.position_m) - eye).norm() < 0.2);
    let promised = nearest.map(|c| c.score).fold(f64::NEG_INFINITY, f64::max);
    assert!(promised > 0.8 * next(b).score, "{what}: {promised:.3} there, {:.3} at best", next(b).score);
}

#[test]
fn a_rigid_motion_moves_the_answer() {
    let still = from_cloud(cloud(320), &Isometry3::identity(), 10_000);
    for (i, turn) in [[0.5, 0.2, -1.0], [-2.0, 0.3, 0.4], [0.0, 1.6, 0.7]].into_iter().enumerate() {
        let motion = Isometry3::new(Vector3::new(3.0, -1.0, 10.0 * i as f64), turn.into());
        assert_same(&still, &from_cloud(cloud(320), &motion, 10_000), &motion, &format!("motion {i}"));
    }
}

#[test]
fn order_and_duplicates_of_points_do_not_count() {
    let identity = Isometry3::identity();
    let plain = from_cloud(cloud(320), &identity, 10_000);
    let mut shuffled = cloud(320);
    shuffled.points.shuffle(&mut rng::stream(1, "test/order"));
    assert_same(&plain, &from_cloud(shuffled, &identity, 10_000), &identity, "another order");
    let mut twice = cloud(320);
    twice.points.extend_from_within(..);
    assert_same(&plain, &from_cloud(twice, &identity, 10_000), &identity, "every point twice");
}

#[test]
fn density_and_max_points_do_not_count() {
    let identity = Isometry3::identity();
    let plain = from_cloud(cloud(320), &identity, 10_000);
    for (width, max_points) in [(320, 3_000), (640, 10_000), (640, 3_000), (960, 100_000)] {
        let other = from_cloud(cloud(width), &identity, max_points);
        assert_same(&plain, &other, &identity, &format!("{width} pixels wide, {max_points} points"));
    }
}

#[test]
fn the_resolution_of_the_camera_does_not_count() {
    let answer = |width: u32| {
        let camera = camera(width).camera();
        let scan = Scan::Depth {
            camera,
            depth: depth(&camera, &first_view()),
            world_from_camera: first_view(),
            misses: NoReturn::Free,
        };
        ask(SessionConfig { camera: self::camera(width), ..config(10_000) }, scan)
    };
    let plain = answer(640);
    for width in [320, 1280] {
        assert_same(&plain, &answer(width), &Isometry3::identity(), &format!("{width} pixels wide"));
    }
}
