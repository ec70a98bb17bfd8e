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
    CandidateConfig, CandidateView, Observation, PlanError, Planner, RankedView, ScanState, candidate_views,
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
            cameras: state.scans.iter().map(|scan| scan.world_from_camera.translation.vector.into()).collect(),
        };
        let scores = self.score(&observation, rng)?;
        let mut ranked: Vec<_> =
            candidates.iter().zip(scores).map(|(c, score)| RankedView::scored(c.view, f64::from(score))).collect();
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
        let candidates = candidate_views(&state.cloud, &near, state.working_distance, config, rng);
        if candidates.is_empty() {
            return Err(PlanError::NoBoundary);
        }
        let ranked = self.rank(&candidates, state, rng).map_err(|e| PlanError::failed("benbv-net", e.to_string()))?;
        checked("benbv-net", ranked, PlanError::failed("benbv-net", "the network scored no candidate"))
    }
}

/// The bundled weights, read at the first decision that needs them: most need none.
pub struct Bundled {
    config: NetPlannerConfig,
    loaded: Option<NetPlanner>,
}

impl Bundled {
    /// Reads nothing yet.
    pub fn new(config: NetPlannerConfig) -> Self {
        Self { config, loaded: None }
    }
}

impl Planner for Bundled {
    fn name(&self) -> &str {
        "benbv-net"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let planner = match self.loaded.take() {
            Some(planner) => planner,
            None => NetPlanner::bundled(self.config.clone())
                .map_err(|why| PlanError::failed("benbv-net", format!("the bundled weights: {why}")))?,
        };
        self.loaded.insert(planner).rank_views(state, rng)
    }
}

#[cfg(test)]
mod tests;
