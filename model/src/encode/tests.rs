use super::*;
use geometry::{PointCloud, View, rng::stream};
use nalgebra::Point3;
use planning::CandidateView;

fn cloud(count: usize) -> PointCloud {
    let points = (0..count).map(|i| Point3::new(i as f64, 2.0 * i as f64, 5.0)).collect();
    PointCloud { points, normals: vec![Vector3::z(); count] }
}

fn candidates() -> [CandidateView; 2] {
    [1.0, 4.0].map(|x| {
        let target = Point3::new(x, 2.0 * x, 5.0);
        CandidateView { view: View { target, position: target + Vector3::new(0.0, 0.0, 3.0) }, density: x }
    })
}

fn observation<'a>(cloud: &'a PointCloud, candidates: &'a [CandidateView]) -> Observation<'a> {
    Observation { cloud, candidates, view_order: 2, working_distance: 3.0, cameras: Vec::new() }
}

fn rows(values: &[f32]) -> Vec<[f32; 3]> {
    values.as_chunks::<3>().0.to_vec()
}

#[test]
fn small_clouds_are_repeated_evenly_or_padded() {
    let (cloud, candidates) = (cloud(5), candidates());
    let config = EncodeConfig { points: 13, normalisation: Normalisation::AsIs, ..EncodeConfig::default() };
    let observation = observation(&cloud, &candidates);
    let repeated = encode(&observation, &config, &mut stream(1, "e")).unwrap();
    for p in &cloud.points {
        let row = as_f32(&p.coords);
        let times = rows(&repeated.points).iter().filter(|r| **r == row).count();
        assert!((2..=3).contains(&times), "{row:?} {times} times among 13");
    }
    let padded = encode(&observation, &EncodeConfig { fill: Fill::Zeros, ..config }, &mut stream(1, "e")).unwrap();
    assert_eq!(rows(&padded.points)[4], [4.0, 8.0, 5.0]);
    assert!(padded.points[15..].iter().chain(&padded.normals[15..]).all(|x| *x == 0.0));
    assert_eq!((padded.density, padded.view_order), (vec![0.25, 1.0], 2.0));
    assert_eq!(padded.directions, [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
}

#[test]
fn large_clouds_are_thinned_without_repetition_by_the_stream() {
    let (cloud, candidates) = (cloud(300), candidates());
    let config = EncodeConfig { points: 100, normalisation: Normalisation::AsIs, ..EncodeConfig::default() };
    let draw = |name: &str| encode(&observation(&cloud, &candidates), &config, &mut stream(1, name)).unwrap();
    let mut taken: Vec<u32> = rows(&draw("a").points).iter().map(|r| r[0] as u32).collect();
    taken.sort_unstable();
    taken.dedup();
    assert_eq!(taken.len(), 100);
    assert_eq!(draw("a"), draw("a"));
    assert_ne!(draw("a"), draw("b"));
}

#[test]
fn cloud_normalisation_centres_and_scales() {
    let (cloud, candidates) = (cloud(11), candidates());
    let config = EncodeConfig { points: 11, diagonal_fraction: 0.5, ..EncodeConfig::default() };
    let encoded = encode(&observation(&cloud, &candidates), &config, &mut stream(1, "e")).unwrap();
    let points: Vec<_> = rows(&encoded.points).iter().map(|r| Vector3::from(*r)).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.inf(p), h.sup(p)));
    assert!((low + high).norm() < 1e-7, "centred");
    assert!(((high - low).norm() - 0.1).abs() < 1e-7, "half of 0.2");
    // The second target is the cloud's fifth point: it moves with the cloud.
    let target = Vector3::from(rows(&encoded.targets)[1]);
    assert!(points.iter().any(|p| (p - target).norm() < 1e-7));
}

#[test]
fn the_mean_normal_goes_up_however_the_world_is_turned() {
    let points: Vec<Point3<f64>> =
        (0..7).map(|i| Point3::new(f64::from(i), f64::from(i * i % 5), f64::from(i % 3))).collect();
    let normals = points.iter().map(|p| (p.coords + Vector3::new(1.0, -2.0, 0.5)).normalize()).collect();
    let cloud = PointCloud { points, normals };
    let config = EncodeConfig {
        points: 7,
        normalisation: Normalisation::AsIs,
        orientation: Orientation::MeanNormal,
        ..EncodeConfig::default()
    };
    let turned = |turn: Rotation3<f64>| {
        let cloud = PointCloud {
            points: cloud.points.iter().map(|p| turn * p).collect(),
            normals: cloud.normals.iter().map(|n| turn * n).collect(),
        };
        let views = candidates().map(|c| CandidateView {
            view: View { target: turn * c.view.target, position: turn * c.view.position },
            ..c
        });
        encode(&observation(&cloud, &views), &config, &mut stream(1, "e")).unwrap()
    };
    let heights = |e: &Encoded| -> Vec<f32> {
        [&e.points, &e.normals, &e.targets, &e.directions].into_iter().flatten().skip(2).step_by(3).copied().collect()
    };
    let straight = turned(Rotation3::identity());
    let sum = rows(&straight.normals).iter().fold(Vector3::zeros(), |sum, n| sum + Vector3::from(*n));
    assert!(sum.xy().norm() < 1e-5 && sum.z > 1.0, "{sum}");
    let up: Vector3<f64> = cloud.normals.iter().sum();
    let down = Rotation3::rotation_between(&up, &-Vector3::z()).unwrap();
    for turn in [Rotation3::from_euler_angles(0.3, -1.2, 2.0), Rotation3::from_euler_angles(3.0, 1.0, -0.4), down] {
        for (a, b) in heights(&turned(turn)).iter().zip(heights(&straight)) {
            assert!((a - b).abs() < 1e-5, "{a} and {b}");
        }
    }
    let opposed = PointCloud { points: cloud.points[..2].to_vec(), normals: vec![Vector3::x(), -Vector3::x()] };
    let encoded = encode(&observation(&opposed, &candidates()), &config, &mut stream(1, "e")).unwrap();
    assert_eq!(encoded.directions, [0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "normals that cancel say nothing");
}

#[test]
fn past_cameras_are_told_beside_each_candidate() {
    let (cloud, candidates) = (cloud(5), candidates());
    let config = EncodeConfig { points: 5, ..EncodeConfig::default() };
    // Above the first target, at the place of the second candidate's camera, and on a target itself.
    let [first, second] = candidates.map(|c| c.view);
    let cameras = vec![first.target + Vector3::new(0.0, 0.0, 7.0), second.position, first.target];
    let known = Observation { cameras, ..observation(&cloud, &candidates) };
    let encoded = encode(&known, &config, &mut stream(1, "e")).unwrap();
    assert_eq!((encoded.cameras(), encoded.past.len()), (3, 2 * 3 * 3));
    let offsets = rows(&encoded.past);
    let aside = (second.position - first.target).normalize() - Vector3::z();
    let wanted = [Vector3::zeros(), aside, -Vector3::z()];
    for (offset, want) in offsets[..3].iter().zip(wanted) {
        assert!((Vector3::from(*offset) - want.cast::<f32>()).norm() < 1e-6, "{offset:?}, expected {want}");
    }
    assert_eq!(offsets[4], [0.0; 3], "the second candidate's own place");
    let unknown = encode(&observation(&cloud, &candidates), &config, &mut stream(1, "e")).unwrap();
    assert_eq!(Encoded { past: Vec::new(), ..encoded.clone() }, unknown, "nothing else changes");
    assert!(to_input(std::slice::from_ref(&unknown), 2, &Device::flex()).unwrap().past.is_none());
    let past = to_input(&[unknown, encoded], 3, &Device::flex()).unwrap().past.unwrap();
    assert_eq!(
        (past.offsets.dims(), past.known.into_data().try_to_vec::<f32>().unwrap()),
        ([2, 3, 3, 3], vec![0.0, 1.0])
    );
}

#[test]
fn what_cannot_be_encoded_is_explained() {
    let (good, candidates) = (cloud(5), candidates());
    let config = EncodeConfig::default();
    let fail = |cloud: &PointCloud, candidates: &[CandidateView]| {
        encode(&observation(cloud, candidates), &config, &mut stream(1, "e")).unwrap_err()
    };
    assert_eq!(fail(&PointCloud::default(), &candidates), EncodeError::EmptyCloud);
    assert_eq!(fail(&good, &[]), EncodeError::NoCandidates);
    let bare = PointCloud { normals: vec![], ..good.clone() };
    assert_eq!(fail(&bare, &candidates), EncodeError::NoNormals { points: 5, normals: 0 });
    let mut odd = candidates;
    odd[1].density = f64::NAN;
    assert_eq!(fail(&good, &odd), EncodeError::NotFinite { what: "candidate", index: 1 });
    let one = encode(&observation(&good, &candidates), &config, &mut stream(1, "e")).unwrap();
    let error = to_input(&[one], 1, &Device::flex()).unwrap_err();
    assert_eq!(error, EncodeError::TooManyCandidates { sample: 0, found: 2, width: 1 });
}
