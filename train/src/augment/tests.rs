use super::*;
use geometry::rng::stream;
use nalgebra::Point3;

fn decision() -> (PointCloud, Vec<CandidateView>, f64) {
    let mut rng = stream(3, "test/augment");
    let points: Vec<Point3<f64>> =
        (0..500).map(|_| Point3::from(Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal)) * 0.05)).collect();
    let normals = points.iter().map(|p| p.coords.normalize()).collect();
    let candidates = points[..20]
        .iter()
        .map(|&target| CandidateView {
            view: View { target, position: target + target.coords.normalize() * 1.2 },
            density: 100.0,
        })
        .collect();
    (PointCloud { points, normals }, candidates, 1.2)
}

#[test]
fn nothing_is_changed_where_nothing_is_set() {
    let (mut cloud, mut candidates, mut distance) = decision();
    let before = (cloud.clone(), candidates.clone(), distance);
    AugmentConfig::none().apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(1, "a"));
    assert_eq!((cloud, candidates, distance), before);
    assert_eq!(AugmentConfig::none().draw_diagonal_fraction(&mut stream(1, "a")), 1.0);
}

#[test]
fn rotations_are_rigid_and_within_their_limits() {
    for (turn, seed) in [(Turn::None, 1), (Turn::Vertical, 2), (Turn::Any, 3)] {
        let (mut cloud, mut candidates, mut distance) = decision();
        let before = (cloud.clone(), candidates.clone());
        let config = AugmentConfig { turn, ..Default::default() };
        config.apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(seed, "a"));
        for (i, j) in [(0, 1), (7, 300), (499, 2)] {
            let (d, d0) =
                ((cloud.points[i] - cloud.points[j]).norm(), (before.0.points[i] - before.0.points[j]).norm());
            assert!((d - d0).abs() < 1e-12, "{turn:?} must keep distances");
            let (c, c0) = (cloud.normals[i].dot(&cloud.normals[j]), before.0.normals[i].dot(&before.0.normals[j]));
            assert!((c - c0).abs() < 1e-12, "{turn:?} must keep angles");
        }
        assert!((candidates[5].view.target - cloud.points[5]).norm() < 1e-12, "candidates move with the cloud");
        assert!((candidates[5].direction().dot(&cloud.normals[5]) - 1.0).abs() < 1e-12);
        assert_eq!(distance, 1.2);
        let turned = cloud.points[0].coords.angle(&before.0.points[0].coords).to_degrees();
        if turn == Turn::None {
            assert!(turned > 0.01 && turned < 3.0 * 10.0, "three turns of at most 10 degrees, found {turned}");
        }
    }
}

#[test]
fn past_cameras_move_with_the_cloud_are_blurred_and_forgotten() {
    let camera = Isometry3::new(Vector3::new(0.4, -0.9, 0.7), Vector3::new(0.1, 0.2, 0.3));
    let after = |config: AugmentConfig, seed: u64| {
        let (mut cloud, mut candidates, mut distance) = decision();
        cloud.points.push(camera.translation.vector.into()); // which then shows where the camera has to be
        let mut cameras = vec![camera];
        config.apply(&mut cloud, &mut candidates, &mut distance, &mut cameras, &mut stream(seed, "a"));
        (cloud, cameras)
    };
    let moving = AugmentConfig { turn: Turn::Any, scale: 0.3, ..Default::default() };
    let (cloud, cameras) = after(moving.clone(), 4);
    let place = cloud.points[500].coords;
    assert!((cameras[0].translation.vector - place).norm() < 1e-12);
    let blurred = AugmentConfig { camera_error_deg: 5.0, ..moving.clone() };
    let errors: Vec<f64> = (0..200)
        .map(|seed| {
            let (cloud, cameras) = after(blurred.clone(), seed);
            let (low, high) = cloud.bounding_box();
            let centre = nalgebra::center(&low, &high).coords;
            let (given, told) = (cloud.points[500].coords - centre, cameras[0].translation.vector - centre);
            assert!((told.norm() / given.norm() - 1.0).abs() < 1e-9, "turned about the centre");
            given.angle(&told).to_degrees().powi(2)
        })
        .collect();
    // Two of the three axes turn a direction: its mean square is twice 25.
    let mean = errors.iter().sum::<f64>() / 200.0;
    assert!((35.0..70.0).contains(&mean), "{mean}");
    let forgetting = AugmentConfig { forget_cameras: 0.3, ..moving };
    let forgotten = (0..400).filter(|&seed| after(forgetting.clone(), seed).1.is_empty()).count();
    assert!((90..150).contains(&forgotten), "{forgotten} of 400");
}

#[test]
fn scale_noise_and_drop_out_do_what_they_say() {
    let (mut cloud, mut candidates, mut distance) = decision();
    let before = cloud.clone();
    let config = AugmentConfig { scale: 0.2, ..AugmentConfig::none() };
    config.apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(5, "a"));
    let factor = distance / 1.2;
    assert!(factor != 1.0 && (0.8..=1.2).contains(&factor), "{factor}");
    assert!((cloud.points[9].coords - before.points[9].coords * factor).norm() < 1e-12);
    assert_eq!(cloud.normals, before.normals, "normals have no scale");

    let (mut cloud, mut candidates, mut distance) = decision();
    let config = AugmentConfig { noise_m: 0.001, ..AugmentConfig::none() };
    config.apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(5, "a"));
    let square: f64 = cloud.points.iter().zip(&before.points).map(|(a, b)| (a - b).norm_squared()).sum();
    let deviation = (square / (3.0 * 500.0)).sqrt();
    assert!((deviation - 0.001).abs() < 0.0001, "{deviation}");

    let config = AugmentConfig { dropout: 0.9, ..AugmentConfig::none() };
    config.apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(5, "b"));
    assert!(cloud.len() < 500 && !cloud.is_empty() && cloud.has_normals());
    let mut single = PointCloud { points: vec![Point3::origin()], normals: vec![Vector3::z()] };
    for i in 0..20 {
        let config = AugmentConfig { dropout: 1.0, ..AugmentConfig::none() };
        config.apply(&mut single, &mut [], &mut distance, &mut Vec::new(), &mut stream(i, "c"));
    }
    assert_eq!(single.len(), 1, "the last point stays");
}

#[test]
fn the_same_stream_gives_the_same_change() {
    let config = AugmentConfig { turn: Turn::Any, noise_m: 1e-3, dropout: 0.3, scale: 0.1, ..Default::default() };
    let run = |name: &str| {
        let (mut cloud, mut candidates, mut distance) = decision();
        config.apply(&mut cloud, &mut candidates, &mut distance, &mut Vec::new(), &mut stream(9, name));
        (cloud, candidates, distance)
    };
    assert_eq!(run("x"), run("x"));
    assert_ne!(run("x").0, run("y").0);
}

#[test]
fn any_turn_is_uniform() {
    let mut rng = stream(11, "test/uniform");
    let mean = (0..4000).fold(Vector3::zeros(), |sum, _| sum + uniform_rotation(&mut rng) * Vector3::x()) / 4000.0;
    assert!(mean.norm() < 0.04, "{mean}");
}

#[test]
fn visits_keep_the_original_beside_copies() {
    let two = AugmentConfig { copies: 2, ..Default::default() };
    assert_eq!(two.visits(), 3);
    assert_eq!([0, 1, 2].map(|v| two.changes_visit(v)), [false, true, true]);
    assert!(AugmentConfig::default().changes_visit(0));
}
