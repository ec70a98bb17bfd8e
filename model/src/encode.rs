//! From observations to tensors: the only way, for trainer and planner alike (docs/method.md, 'Network input and
//! output').
//!
//! Two steps, so that a loader's threads can do the first: [`encode`] makes plain arrays of one observation
//! (normalised, resampled), [`to_input`] pads a batch of them and uploads it.

use crate::benbv::NetInput;
use burn::tensor::{Device, Tensor, TensorData};
use nalgebra::{Rotation3, Vector3};
use planning::Observation;
use rand::Rng;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Frame and scale in which the network sees a cloud (docs/method.md, 'Real clouds').
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalisation {
    /// Coordinates as they are: objects of 0.2 m diagonal about the origin (published).
    AsIs,
    /// The centre of the cloud's bounding box goes to the origin and its diagonal to
    /// 0.2 x [`EncodeConfig::diagonal_fraction`]: scores do not depend on translation and unit of the input.
    #[default]
    Cloud,
}

/// How the network's axes lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Orientation {
    /// As the world's (published).
    #[default]
    AsIs,
    /// The mean of the cloud's normals points to +Z, by the shortest turn: what is left open of the world's
    /// orientation is one angle, and the side that has been scanned is always up.
    MeanNormal,
}

/// What becomes of a cloud with fewer points than the network takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fill {
    /// Points are repeated: the maximum over points does not change.
    #[default]
    Repeat,
    /// Points at the origin with zero normals are added (published).
    Zeros,
}

/// How observations become tensors; part of a checkpoint, since weights are of use only with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EncodeConfig {
    /// Points per cloud, N.
    pub points: usize,
    /// Frame and scale.
    pub normalisation: Normalisation,
    /// Axes.
    pub orientation: Orientation,
    /// Fewer points than N.
    pub fill: Fill,
    /// Diagonal of the cloud after `cloud` normalisation as a share of 0.2. A trainer draws it afresh for each
    /// sample, so that partly seen objects are in the training distribution; planners leave it at 1.
    pub diagonal_fraction: f64,
}

impl Default for EncodeConfig {
    fn default() -> Self {
        Self {
            points: 4096,
            normalisation: Normalisation::Cloud,
            orientation: Orientation::AsIs,
            fill: Fill::Repeat,
            diagonal_fraction: 1.0,
        }
    }
}

impl EncodeConfig {
    /// The published encoding: coordinates as they are, zero padding.
    pub fn paper() -> Self {
        Self { normalisation: Normalisation::AsIs, fill: Fill::Zeros, ..Self::default() }
    }
}

/// Diagonal of a normalised object's bounding box, metres (docs/method.md, 'Setting').
pub const OBJECT_DIAGONAL: f64 = 0.2;

/// Why an observation cannot be encoded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// No points.
    #[error("the cloud is empty; a scan must come before the first decision")]
    EmptyCloud,
    /// Points without normals.
    #[error(
        "the cloud has {points} points and {normals} normals; the network needs one per point: estimate them first"
    )]
    NoNormals {
        /// Points found.
        points: usize,
        /// Normals found.
        normals: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{what} {index} is not finite; remove such points first")]
    NotFinite {
        /// `point`, `normal` or `candidate`.
        what: &'static str,
        /// Its index.
        index: usize,
    },
    /// Nothing to score.
    #[error("there is no candidate view to score")]
    NoCandidates,
    /// More candidates than the batch is wide.
    #[error("sample {sample} has {found} candidates, but the batch is {width} wide; raise `candidates`")]
    TooManyCandidates {
        /// Index in the batch.
        sample: usize,
        /// Candidates found.
        found: usize,
        /// Width of the batch.
        width: usize,
    },
    /// Samples of different resolution in one batch.
    #[error("sample {sample} has {found} points, the first of the batch {expected}")]
    MixedPoints {
        /// Index in the batch.
        sample: usize,
        /// Points found.
        found: usize,
        /// Points of the first sample.
        expected: usize,
    },
}

/// One observation in the network's terms, as plain arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Encoded {
    /// Positions, N x 3.
    pub points: Vec<f32>,
    /// Normals, N x 3.
    pub normals: Vec<f32>,
    /// Candidates' targets, K x 3 (real candidates only).
    pub targets: Vec<f32>,
    /// Candidates' unit directions target -> camera, K x 3.
    pub directions: Vec<f32>,
    /// Density at the targets divided by the largest, K.
    pub density: Vec<f32>,
    /// Number of scans done minus one.
    pub view_order: f32,
}

impl Encoded {
    /// Number of candidates.
    pub fn candidates(&self) -> usize {
        self.density.len()
    }
}

/// Normalises and resamples one observation. The random stream decides which points are taken.
pub fn encode(observation: &Observation, config: &EncodeConfig, rng: &mut impl Rng) -> Result<Encoded, EncodeError> {
    check(observation)?;
    let cloud = observation.cloud;
    let (centre, scale) = frame(observation, config);
    let turn = turn(observation, config);
    let place = |p: &nalgebra::Point3<f64>| turn * (p.coords - centre) * scale;

    let n = config.points;
    let mut encoded = Encoded { view_order: observation.view_order as f32, ..Encoded::default() };
    encoded.points.reserve(3 * n);
    encoded.normals.reserve(3 * n);
    for index in resample(cloud.len(), n, config.fill, rng) {
        match index {
            Some(i) => {
                encoded.points.extend(as_f32(&place(&cloud.points[i])));
                encoded.normals.extend(as_f32(&(turn * cloud.normals[i])));
            }
            None => {
                encoded.points.extend([0.0; 3]);
                encoded.normals.extend([0.0; 3]);
            }
        }
    }
    let largest = observation.candidates.iter().map(|c| c.density).fold(0.0, f64::max);
    let unit = if largest > 0.0 { largest } else { 1.0 };
    for candidate in observation.candidates {
        encoded.targets.extend(as_f32(&place(&candidate.view.target)));
        encoded.directions.extend(as_f32(&(turn * candidate.direction())));
        encoded.density.push((candidate.density / unit) as f32);
    }
    Ok(encoded)
}

/// Pads a batch to `width` candidates and uploads it. Samples must have the same number of points.
pub fn to_input(batch: &[Encoded], width: usize, device: &Device) -> Result<NetInput, EncodeError> {
    let b = batch.len();
    let n = batch.first().map_or(0, |e| e.points.len() / 3);
    let mut rows = Encoded::default();
    let (mut order, mut counts) = (Vec::with_capacity(b), Vec::with_capacity(b));
    for (sample, e) in batch.iter().enumerate() {
        let k = e.candidates();
        if k == 0 {
            return Err(EncodeError::NoCandidates);
        }
        if k > width {
            return Err(EncodeError::TooManyCandidates { sample, found: k, width });
        }
        if e.points.len() != 3 * n {
            return Err(EncodeError::MixedPoints { sample, found: e.points.len() / 3, expected: n });
        }
        rows.points.extend_from_slice(&e.points);
        rows.normals.extend_from_slice(&e.normals);
        for (all, own, columns) in [
            (&mut rows.targets, &e.targets, 3),
            (&mut rows.directions, &e.directions, 3),
            (&mut rows.density, &e.density, 1),
        ] {
            all.extend_from_slice(own);
            all.resize(all.len() + (width - k) * columns, 0.0);
        }
        order.push(e.view_order);
        counts.push(k);
    }
    let device = device.clone().inner();
    let three = |data, rows| Tensor::<3>::from_data(TensorData::new(data, [b, rows, 3]), &device);
    let two = |data, columns| Tensor::<2>::from_data(TensorData::new(data, [b, columns]), &device);
    Ok(NetInput {
        points: three(rows.points, n),
        normals: three(rows.normals, n),
        targets: three(rows.targets, width),
        directions: three(rows.directions, width),
        density: two(rows.density, width),
        view_order: two(order, 1),
        counts,
    })
}

fn check(observation: &Observation) -> Result<(), EncodeError> {
    let cloud = observation.cloud;
    if cloud.is_empty() {
        return Err(EncodeError::EmptyCloud);
    }
    if !cloud.has_normals() {
        return Err(EncodeError::NoNormals { points: cloud.points.len(), normals: cloud.normals.len() });
    }
    if observation.candidates.is_empty() {
        return Err(EncodeError::NoCandidates);
    }
    let finite = |what, found: Option<usize>| match found {
        Some(index) => Err(EncodeError::NotFinite { what, index }),
        None => Ok(()),
    };
    finite("point", cloud.points.iter().position(|p| !p.iter().all(|x| x.is_finite())))?;
    finite("normal", cloud.normals.iter().position(|n| !n.iter().all(|x| x.is_finite())))?;
    finite(
        "candidate",
        observation.candidates.iter().position(|c| !c.view.is_valid() || !c.density.is_finite() || c.density < 0.0),
    )
}

/// Origin and scale of the network's frame.
fn frame(observation: &Observation, config: &EncodeConfig) -> (Vector3<f64>, f64) {
    match config.normalisation {
        Normalisation::AsIs => (Vector3::zeros(), 1.0),
        Normalisation::Cloud => {
            let (low, high) = observation.cloud.bounding_box();
            let diagonal = (high - low).norm();
            let size = OBJECT_DIAGONAL * config.diagonal_fraction;
            // A single point has no size; it is only centred.
            (nalgebra::center(&low, &high).coords, if diagonal > 0.0 { size / diagonal } else { 1.0 })
        }
    }
}

/// Rotation into the network's frame.
fn turn(observation: &Observation, config: &EncodeConfig) -> Rotation3<f64> {
    match config.orientation {
        Orientation::AsIs => Rotation3::identity(),
        Orientation::MeanNormal => {
            let sum: Vector3<f64> = observation.cloud.normals.iter().sum();
            // None where the normals cancel (nothing to do) or point straight down (any half turn will do).
            Rotation3::rotation_between(&sum, &Vector3::z()).unwrap_or_else(|| {
                if sum.z < 0.0 { Rotation3::from_axis_angle(&Vector3::x_axis(), PI) } else { Rotation3::identity() }
            })
        }
    }
}

/// `n` indices into `len` points: without replacement from a larger cloud; a smaller one in full, then repeated
/// as evenly as can be, or filled up with `None`.
fn resample(len: usize, n: usize, fill: Fill, rng: &mut impl Rng) -> Vec<Option<usize>> {
    let draw = |amount: usize, rng: &mut _| rand::seq::index::sample(rng, len, amount).into_iter().map(Some);
    if len >= n {
        return draw(n, rng).collect();
    }
    match fill {
        Fill::Repeat => {
            let mut taken: Vec<_> = (0..n - n % len).map(|i| Some(i % len)).collect();
            taken.extend(draw(n % len, rng));
            taken.shuffle(rng);
            taken
        }
        Fill::Zeros => (0..n).map(|i| (i < len).then_some(i)).collect(),
    }
}

fn as_f32(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[cfg(test)]
mod tests {
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
        Observation { cloud, candidates, view_order: 2, working_distance: 3.0 }
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
            [&e.points, &e.normals, &e.targets, &e.directions]
                .into_iter()
                .flatten()
                .skip(2)
                .step_by(3)
                .copied()
                .collect()
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
}
