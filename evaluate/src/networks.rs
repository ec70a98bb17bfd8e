//! Trained networks, loaded once and cloned for every episode.

use crate::config::{EvaluateConfig, WeightsConfig};
use crate::policies::BoxedPlanner;
use crate::policies::pc_nbv::PcNbvPlanner;
use geometry::CandidateConfig;
use model::{NetPlanner, NetPlannerConfig, PcNbvModel};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Weights at hand. Nothing is read until a policy asks.
#[derive(Default)]
pub struct Networks {
    weights: WeightsConfig,
    candidates: CandidateConfig,
    benbv_net: Mutex<Option<NetPlanner>>,
    pc_nbv: Mutex<Option<PcNbvModel>>,
}

impl Networks {
    /// For these settings.
    pub fn new(config: &EvaluateConfig) -> Self {
        Self { weights: config.weights.clone(), candidates: config.candidates.clone(), ..Self::default() }
    }

    /// The policy `benbv-net`.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn benbv_net<'a>(&self) -> Result<BoxedPlanner<'a>, String> {
        let mut loaded = self.benbv_net.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if loaded.is_none() {
            let directory = &self.weights.benbv_net;
            let config = NetPlannerConfig { candidates: self.candidates.clone(), ..NetPlannerConfig::default() };
            let planner = match directory.as_os_str().is_empty() {
                true => NetPlanner::bundled(config),
                false => NetPlanner::load(directory, config),
            };
            *loaded = Some(planner.map_err(|e| e.to_string())?);
        }
        loaded.as_ref().map(|p| Box::new(p.clone()) as BoxedPlanner).ok_or_else(|| "not loaded".to_owned())
    }

    /// The policy `pc-nbv`, or `pc-nbv:paper`.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn pc_nbv<'a>(&self, name: &str, published: bool) -> Result<BoxedPlanner<'a>, String> {
        let mut loaded = self.pc_nbv.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if loaded.is_none() {
            let directory = pc_nbv_directory(&self.weights.pc_nbv)?;
            *loaded = Some(PcNbvModel::load(&directory).map_err(|e| e.to_string())?);
        }
        let network = loaded.clone().ok_or_else(|| "not loaded".to_owned())?;
        Ok(Box::new(PcNbvPlanner::new(name, network, published)))
    }
}

/// The configured checkpoint, or the one that comes with the source.
fn pc_nbv_directory(configured: &Path) -> Result<PathBuf, String> {
    if !configured.as_os_str().is_empty() {
        return Ok(configured.to_owned());
    }
    let folders = [PathBuf::from("weights"), Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights")];
    folders.iter().map(|folder| folder.join("pc-nbv")).find(|d| d.exists()).ok_or_else(|| {
        "found no weights/pc-nbv here nor beside the source; train some (train --network pc-nbv) and give --set \
         weights.pc_nbv=DIR"
            .to_owned()
    })
}
