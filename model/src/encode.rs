//! From observations to tensors: the only way, for trainer and planner alike (docs/method.md, 'Network input and
//! output').
//!
//! Two steps, so that a loader's threads can do the first: [`encode`] makes plain arrays of one observation
//! (normalised, resampled), [`to_input`] pads a batch of them and uploads it.

use crate::benbv::{NetInput, PastCameras};
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

/// What is done with a cloud that has fewer points than the network takes.
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
        /// `point`, `normal`, `candidate` or `camera`.
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
    /// For each candidate and each past camera, the unit vector from the target to the camera minus the candidate's
    /// direction, K x V x 3; empty where no past camera is known.
    pub past: Vec<f32>,
}

impl Encoded {
    /// Number of candidates.
    pub fn candidates(&self) -> usize {
        self.density.len()
    }

    /// Number of past cameras that are known.
    pub fn cameras(&self) -> usize {
        self.past.len() / (3 * self.candidates()).max(1)
    }

    /// The rows of [`Encoded::past`] for `cameras` of them: candidate by candidate, its own repeated as often as
    /// needed; zeros where none is known.
    fn past_rows(&self, cameras: usize) -> Vec<f32> {
        let own = 3 * self.cameras();
        if own == 0 {
            return vec![0.0; self.candidates() * cameras * 3];
        }
        self.past.chunks(own).flat_map(|row| row.iter().copied().cycle().take(3 * cameras)).collect()
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
        for camera in &observation.cameras {
            let seen_from = (camera - candidate.view.target).try_normalize(0.0).unwrap_or_default();
            encoded.past.extend(as_f32(&(turn * (seen_from - candidate.direction()))));
        }
    }
    Ok(encoded)
}

/// Pads a batch to `width` candidates and uploads it. Samples must have the same number of points.
pub fn to_input(batch: &[Encoded], width: usize, device: &Device) -> Result<NetInput, EncodeError> {
    let b = batch.len();
    let n = batch.first().map_or(0, |e| e.points.len() / 3);
    let mut rows = Encoded::default();
    let (mut order, mut counts) = (Vec::with_capacity(b), Vec::with_capacity(b));
    let cameras = batch.iter().map(Encoded::cameras).max().unwrap_or(0);
    let mut known = Vec::with_capacity(b);
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
            (&mut rows.past, &e.past_rows(cameras), 3 * cameras),
        ] {
            all.extend_from_slice(own);
            all.resize(all.len() + (width - k) * columns, 0.0);
        }
        order.push(e.view_order);
        known.push(f32::from(u8::from(e.cameras() > 0)));
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
        past: (cameras > 0).then(|| PastCameras {
            offsets: Tensor::from_data(TensorData::new(rows.past, [b, width, cameras, 3]), &device),
            known: two(known, 1),
        }),
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
    )?;
    finite("camera", observation.cameras.iter().position(|c| !c.iter().all(|x| x.is_finite())))
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
mod tests;
