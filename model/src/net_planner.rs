//! BENBV-Net as a planner: candidates, encoding, forward pass, ranking. No burn type in its interface.

use crate::benbv::BenbvNet;
use crate::checkpoint::{self, Checkpoint, CheckpointError};
use crate::config::BenbvNetConfig;
use crate::device::{self, DeviceError};
use crate::encode::{self, EncodeConfig, EncodeError, Fill};
use burn::module::Module;
use burn::tensor::Device;
use planning::planner::checked;
use planning::{
    CandidateConfig, CandidateView, Observation, PlanError, Planner, RankedView, ScanState, candidate_views_among,
};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of [`NetPlanner`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NetPlannerConfig {
    /// Device by name: `cpu`, `wgpu`, `cuda` (see [`device::open`]).
    pub device: String,
    /// How candidates are made.
    pub candidates: CandidateConfig,
}

impl Default for NetPlannerConfig {
    fn default() -> Self {
        Self { device: "cpu".to_string(), candidates: CandidateConfig::default() }
    }
}

/// Why a network planner cannot start.
#[derive(Debug, thiserror::Error)]
pub enum NetPlannerError {
    /// The device is not to be had.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The weights are not to be had.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
}

/// The policy `benbv-net`: scores the candidate views of the cloud's boundary by the network.
#[derive(Clone)]
pub struct NetPlanner {
    net: BenbvNet,
    info: Checkpoint<BenbvNetConfig>,
    config: NetPlannerConfig,
    device: Device,
}

/// The weights that every program carries (`weights/benbv-net`), a safetensors file.
pub const BUNDLED_WEIGHTS: &[u8] = include_bytes!("../../weights/benbv-net/model.safetensors");

impl NetPlanner {
    /// From a checkpoint directory.
    pub fn load(directory: &Path, config: NetPlannerConfig) -> Result<Self, NetPlannerError> {
        let device = device::open(&config.device)?;
        let (net, info) = checkpoint::load(directory, &device)?;
        Ok(Self::new(net, info, config))
    }

    /// From the text of `checkpoint.toml` and the bytes of `model.safetensors`: weights inside a program.
    pub fn from_bytes(description: &str, weights: &[u8], config: NetPlannerConfig) -> Result<Self, NetPlannerError> {
        let device = device::open(&config.device)?;
        let (net, info) = checkpoint::load_bytes(description, weights, &device)?;
        Ok(Self::new(net, info, config))
    }

    /// With the weights that come with the source (`weights/benbv-net`), which every program carries.
    pub fn bundled(config: NetPlannerConfig) -> Result<Self, NetPlannerError> {
        Self::from_bytes(include_str!("../../weights/benbv-net/checkpoint.toml"), BUNDLED_WEIGHTS, config)
    }

    /// From a network at hand, on its device.
    pub fn new(net: BenbvNet, info: Checkpoint<BenbvNetConfig>, config: NetPlannerConfig) -> Self {
        let net = net.valid();
        let device = net.devices().into_iter().next().unwrap_or_else(Device::flex).inner();
        Self { net, info, config, device }
    }

    /// What the checkpoint says of the weights.
    pub fn checkpoint(&self) -> &Checkpoint<BenbvNetConfig> {
        &self.info
    }

    /// Settings.
    pub fn config(&self) -> &NetPlannerConfig {
        &self.config
    }

    /// Scores of the observation's candidates, in their order, each in (0, 1).
    pub fn score(&self, observation: &Observation, rng: &mut ChaCha8Rng) -> Result<Vec<f32>, EncodeError> {
        let config = self.encode_config(observation.cloud.len());
        let encoded = encode::encode(observation, &config, rng)?;
        let width = encoded.candidates();
        let input = encode::to_input(&[encoded], width, &self.device)?;
        let scores = self.net.forward(input).into_data(); // [1, K]
        Ok(scores.convert::<f32>().try_to_vec().unwrap_or_default())
    }

    /// Candidates with their scores, best first; equal scores keep the order of the candidates.
    pub fn rank(
        &self,
        candidates: &[CandidateView],
        state: &ScanState,
        rng: &mut ChaCha8Rng,
    ) -> Result<Vec<RankedView>, EncodeError> {
        let observation = Observation {
            cloud: &state.cloud,
            candidates,
            view_order: state.num_scans.saturating_sub(1),
            working_distance: state.working_distance,
        };
        let scores = self.score(&observation, rng)?;
        let mut ranked: Vec<_> = candidates
            .iter()
            .zip(scores)
            .map(|(c, score)| RankedView { view: c.view, score: f64::from(score), gain: None, overlap: None })
            .collect();
        ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(ranked)
    }

    /// The checkpoint's encoding. Repeating points of a small cloud changes no maximum over points, so planning
    /// leaves the repetitions out.
    fn encode_config(&self, points: usize) -> EncodeConfig {
        let config = &self.info.encode;
        match config.fill {
            Fill::Repeat => EncodeConfig { points: config.points.min(points), ..config.clone() },
            Fill::Zeros => config.clone(),
        }
    }
}

impl Planner for NetPlanner {
    fn name(&self) -> &str {
        "benbv-net"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let config = &self.config.candidates;
        let near = state.neighborhoods(config.boundary.neighbors);
        let candidates = candidate_views_among(&state.cloud, &near, state.working_distance, config, rng);
        if candidates.is_empty() {
            return Err(PlanError::NoBoundary);
        }
        let ranked = self.rank(&candidates, state, rng).map_err(|e| PlanError::failed("benbv-net", e.to_string()))?;
        checked("benbv-net", ranked, PlanError::failed("benbv-net", "the network scored no candidate"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{PointCloud, rng::stream};
    use nalgebra::{Point3, Vector3};
    use planning::candidate_views;

    /// A bumpy open sheet of 600 points, seen from above.
    fn state() -> ScanState {
        let mut cloud = PointCloud::default();
        for i in 0..600 {
            let (x, y) = (f64::from(i % 30) * 0.003, f64::from(i / 30) * 0.003);
            cloud.points.push(Point3::new(x, y, 0.01 * (40.0 * x).sin() * (30.0 * y).cos()));
            cloud.normals.push(Vector3::new(-0.1 * (x * 50.0).cos(), 0.05, 1.0).normalize());
        }
        ScanState { cloud, num_scans: 2, grid_size: 0.003, working_distance: 0.5, ..ScanState::default() }
    }

    fn planner(encode: EncodeConfig) -> NetPlanner {
        let config = BenbvNetConfig::tiny();
        let device = Device::flex();
        device.seed(3);
        let info = Checkpoint::new::<BenbvNet>(config.clone(), encode);
        NetPlanner::new(config.init(&device).materialize(), info, NetPlannerConfig::default())
    }

    #[test]
    fn ranks_candidates_best_first_and_repeats() {
        let mut planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
        let rank = |planner: &mut NetPlanner| planner.rank_views(&state(), &mut stream(1, "test")).expect("views");
        let ranked = rank(&mut planner);
        assert!(ranked.len() > 3, "the sheet has a boundary: {}", ranked.len());
        assert!(ranked.windows(2).all(|w| w[0].score >= w[1].score));
        assert!(ranked.iter().all(|r| r.score > 0.0 && r.score < 1.0));
        assert_eq!(ranked, rank(&mut planner), "same stream, same ranking");
    }

    #[test]
    fn what_cannot_be_ranked_is_an_error_that_says_why() {
        let mut planner = planner(EncodeConfig::default());
        let nothing = planner.rank_views(&ScanState::default(), &mut stream(1, "test"));
        assert_eq!(nothing, Err(PlanError::NoBoundary));
        let state = state();
        let candidates = candidate_views(&state.cloud, 0.5, &CandidateConfig::default(), &mut stream(1, "t"));
        let mut broken = state;
        broken.cloud.points[7].x = f64::NAN;
        let error = planner.rank(&candidates, &broken, &mut stream(1, "t")).unwrap_err();
        assert_eq!(error.to_string(), "point 7 is not finite; remove such points first");
    }

    #[test]
    fn a_network_that_answers_nan_fails_and_is_not_at_its_end() {
        let mut planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
        planner.net = planner.net.clone().map(&mut Poison);
        let error = planner.rank_views(&state(), &mut stream(1, "test")).expect_err("NaN");
        assert!(!error.is_end(), "{error}");
        assert_eq!(error.to_string(), "planner benbv-net failed: a view was scored NaN");
    }

    /// Every weight becomes NaN.
    struct Poison;

    impl burn::module::ModuleMapper for Poison {
        fn map_float<const D: usize>(
            &mut self,
            param: burn::module::Param<burn::tensor::Tensor<D>>,
        ) -> burn::module::Param<burn::tensor::Tensor<D>> {
            param.map(|weights| weights * f32::NAN)
        }
    }

    #[test]
    fn cloud_normalisation_ignores_translation_and_unit() {
        let planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
        let state = state();
        let candidates = candidate_views(&state.cloud, 0.5, &CandidateConfig::default(), &mut stream(1, "t"));
        let scores = |scale: f64, shift: Vector3<f64>| {
            let place = |p: &Point3<f64>| Point3::from(p.coords * scale + shift);
            let mut moved = state.clone();
            moved.cloud.points.iter_mut().for_each(|p| *p = place(p));
            let mut candidates = candidates.clone();
            for c in &mut candidates {
                c.view.target = place(&c.view.target);
                c.view.position = place(&c.view.position);
                c.density /= scale;
            }
            let observation = Observation {
                cloud: &moved.cloud,
                candidates: &candidates,
                view_order: 1,
                working_distance: 0.5 * scale,
            };
            planner.score(&observation, &mut stream(1, "score")).unwrap()
        };
        let still = scores(1.0, Vector3::zeros());
        for (a, b) in still.iter().zip(scores(1000.0, Vector3::new(50.0, -20.0, 7.0))) {
            assert!((a - b).abs() < 1e-5, "{a} became {b}");
        }
    }
}
