//! Trained networks, loaded once and cloned for every episode.

use crate::config::{EvaluateConfig, WeightsConfig};
use crate::policies::BoxedPlanner;
use crate::policies::pc_nbv::PcNbvPlanner;
use formats::config::{digest, to_toml};
use model::checkpoint;
use model::device::{self, DeviceError};
use model::net_planner::BUNDLED_WEIGHTS;
use model::{NetPlanner, NetPlannerConfig, NetPlannerError, PcNbvError, PcNbvModel};
use planning::{CandidateConfig, Network};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Why a network cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The device is not to be had.
    #[error("weights.device: {0}")]
    Device(#[from] DeviceError),
    /// The checkpoint of `benbv-net` is missing or unfit.
    #[error(transparent)]
    BenbvNet(#[from] NetPlannerError),
    /// The checkpoint of `pc-nbv` is missing or unfit.
    #[error(transparent)]
    PcNbv(#[from] PcNbvError),
    /// None are configured, and none are found.
    #[error(
        "found no weights/pc-nbv in the working directory or in a folder above the program; use those of the source tree, or train some (train --network pc-nbv) and give --set weights.pc_nbv=DIR"
    )]
    NoPcNbv,
}

/// What describes [`BUNDLED_WEIGHTS`].
const BUNDLED_DESCRIPTION: &str = include_str!("../../weights/benbv-net/checkpoint.toml");

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

    /// Starts the configured device: a missing one must not merely leave networks out of `all`.
    ///
    /// # Errors
    /// Why it cannot be had.
    pub fn check_device(&self) -> Result<(), WeightsError> {
        device::open(self.device())?;
        Ok(())
    }

    fn device(&self) -> &str {
        self.weights.device.as_deref().unwrap_or("cpu")
    }

    /// The policy `benbv-net`, with the weights in this directory or else the configured ones.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn benbv_net<'a>(&self, directory: Option<&Path>) -> Result<BoxedPlanner<'a>, WeightsError> {
        let directory = self.benbv_net_directory(directory);
        let mut loaded = self.benbv_net.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(planner) = loaded.get(&directory) {
            return Ok(Box::new(planner.clone()));
        }
        let config = NetPlannerConfig { device: self.device().to_owned(), candidates: self.candidates.clone() };
        let planner = match directory.as_os_str().is_empty() {
            true => NetPlanner::bundled(config),
            false => NetPlanner::load(&directory, config),
        };
        let planner = planner?;
        loaded.insert(directory, planner.clone());
        Ok(Box::new(planner))
    }

    /// The network that `auto` falls back to.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn of_auto(&self) -> Result<Option<Network>, WeightsError> {
        Ok(Some(Network::boxed(self.benbv_net(None)?)))
    }

    fn benbv_net_directory(&self, directory: Option<&Path>) -> PathBuf {
        directory.map_or_else(|| self.weights.benbv_net.clone(), PathBuf::from)
    }

    /// Digest of the weights and settings of `benbv-net`.
    pub fn benbv_net_digest(&self, directory: Option<&Path>) -> Option<String> {
        let directory = self.benbv_net_directory(directory);
        Some(if directory.as_os_str().is_empty() {
            digest_of(BUNDLED_WEIGHTS, BUNDLED_DESCRIPTION)
        } else {
            digest_in(&directory)
        })
    }

    /// Digest of the weights and settings of `pc-nbv`; `None` where there are none.
    pub fn pc_nbv_digest(&self) -> Option<String> {
        Some(digest_in(&pc_nbv_directory(&self.weights.pc_nbv).ok()?))
    }

    /// The policy `pc-nbv`, or `pc-nbv:paper`.
    ///
    /// # Errors
    /// What is wrong with the weights.
    pub fn pc_nbv<'a>(&self, name: &str, published: bool) -> Result<BoxedPlanner<'a>, WeightsError> {
        let mut loaded = self.pc_nbv.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let network = match &*loaded {
            Some(network) => network.clone(),
            None => {
                let directory = pc_nbv_directory(&self.weights.pc_nbv)?;
                loaded.insert(PcNbvModel::load_on(&directory, self.device())?).clone()
            }
        };
        Ok(Box::new(PcNbvPlanner::new(name, network, published)))
    }
}

fn digest_in(directory: &Path) -> String {
    let read = |name: &str| std::fs::read(directory.join(name)).unwrap_or_default();
    digest_of(&read(checkpoint::WEIGHTS), &String::from_utf8_lossy(&read(checkpoint::DESCRIPTION)))
}

/// Of a checkpoint's weights and of what its description says of the network and its input: all but where they come from.
fn digest_of(weights: &[u8], description: &str) -> String {
    let settings = description.parse::<toml::Table>().ok().and_then(|mut table| {
        for key in ["provenance", "step"] {
            table.remove(key);
        }
        to_toml(&table).ok()
    });
    digest(&[weights, settings.as_deref().unwrap_or(description).as_bytes()].concat())
}

/// The configured checkpoint, or the one that comes with the source: in the working directory, or in a folder above the
/// program itself, wherever that was copied to.
fn pc_nbv_directory(configured: &Path) -> Result<PathBuf, WeightsError> {
    if !configured.as_os_str().is_empty() {
        return Ok(configured.to_owned());
    }
    let program = std::env::current_exe().unwrap_or_default();
    let folders = std::iter::once(Path::new(".")).chain(program.ancestors().skip(1));
    folders.map(|folder| folder.join("weights/pc-nbv")).find(|d| d.exists()).ok_or(WeightsError::NoPcNbv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_follows_what_changes_answers_and_not_where_weights_come_from() {
        let plain = digest_of(BUNDLED_WEIGHTS, BUNDLED_DESCRIPTION);
        let with = |from: &str, to: &str| {
            assert!(BUNDLED_DESCRIPTION.contains(from), "{from}");
            digest_of(BUNDLED_WEIGHTS, &BUNDLED_DESCRIPTION.replace(from, to))
        };
        for (from, to) in [("points = 256", "points = 128"), ("heads = 4", "heads = 2"), ("\"repeat\"", "\"draw\"")] {
            assert_ne!(with(from, to), plain, "{from}");
        }
        for (from, to) in [("program = \"train", "program = \"other"), ("[encode]", "# A remark.\n[encode]")] {
            assert_eq!(with(from, to), plain, "{from}");
        }
        assert_ne!(digest_of(&BUNDLED_WEIGHTS[1..], BUNDLED_DESCRIPTION), plain);
        let copy = tempfile::tempdir().expect("dir");
        std::fs::write(copy.path().join(checkpoint::WEIGHTS), BUNDLED_WEIGHTS).expect("written");
        assert_ne!(digest_in(copy.path()), plain, "without its description it does not load");
        std::fs::write(copy.path().join(checkpoint::DESCRIPTION), BUNDLED_DESCRIPTION).expect("written");
        assert_eq!(digest_in(copy.path()), plain);
    }
}
