//! Trained networks, loaded once and cloned for every episode.

use crate::config::{EvaluateConfig, WeightsConfig};
use crate::policies::BoxedPlanner;
use crate::policies::pc_nbv::PcNbvPlanner;
use formats::config::digest;
use model::net_planner::BUNDLED_WEIGHTS;
use model::{NetPlanner, NetPlannerConfig, PcNbvModel};
use planning::{CandidateConfig, Network};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Weights at hand. Nothing is read until a policy asks.
#[derive(Default)]
pub struct Networks {
    weights: WeightsConfig,
    candidates: CandidateConfig,
    /// By directory; those that every program carries have none.
    benbv_net: Mutex<BTreeMap<PathBuf, NetPlanner>>,
    pc_nbv: Mutex<Option<PcNbvModel>>,
}

impl Networks {
    /// For these settings.
    pub fn new(config: &EvaluateConfig) -> Self {
        Self { weights: config.weights.clone(), candidates: config.candidates.clone(), ..Self::default() }
    }

    /// The policy `benbv-net`, with the weights in this directory or else the configured ones.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn benbv_net<'a>(&self, directory: Option<&str>) -> Result<BoxedPlanner<'a>, String> {
        let directory = self.benbv_net_directory(directory);
        let mut loaded = self.benbv_net.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(planner) = loaded.get(&directory) {
            return Ok(Box::new(planner.clone()));
        }
        let config = NetPlannerConfig { candidates: self.candidates.clone(), ..NetPlannerConfig::default() };
        let planner = match directory.as_os_str().is_empty() {
            true => NetPlanner::bundled(config),
            false => NetPlanner::load(&directory, config),
        };
        let planner = planner.map_err(|e| e.to_string())?;
        loaded.insert(directory, planner.clone());
        Ok(Box::new(planner))
    }

    /// The network that `auto` falls back to.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn of_auto(&self) -> Result<Option<Network>, String> {
        Ok(Some(Network::boxed(self.benbv_net(None)?)))
    }

    fn benbv_net_directory(&self, directory: Option<&str>) -> PathBuf {
        directory.map_or_else(|| self.weights.benbv_net.clone(), PathBuf::from)
    }

    /// Digest of the weights that a network's policy uses; `None` for other policies.
    pub fn digest(&self, family: &str, variant: Option<&str>) -> Option<String> {
        let read = |directory: PathBuf| std::fs::read(directory.join(model::checkpoint::WEIGHTS)).unwrap_or_default();
        match family {
            "benbv-net" | "auto" => {
                let directory = self.benbv_net_directory(variant);
                let carried = directory.as_os_str().is_empty();
                Some(if carried { digest(BUNDLED_WEIGHTS) } else { digest(&read(directory)) })
            }
            "pc-nbv" => Some(digest(&read(pc_nbv_directory(&self.weights.pc_nbv).ok()?))),
            _ => None,
        }
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
