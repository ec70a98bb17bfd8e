//! Weights of `benbv-net`: bundled, or from a checkpoint directory.

use anyhow::{Context, Result};
use model::NetPlanner;
use model::net_planner::NetPlannerConfig;
use planning::{Network, PlanError, Planner, RankedView, ScanState};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

/// The default device.
pub const CPU: &str = "cpu";

/// The network of `--weights`, without it the bundled one, on the device of this name.
pub fn network(directory: Option<&Path>, device: &str) -> Result<Network> {
    // First and by itself: that a device is missing says nothing of the weights.
    model::device::open(device).context("--device")?;
    let config = NetPlannerConfig { device: device.to_owned(), ..NetPlannerConfig::default() };
    Ok(match directory {
        Some(directory) => {
            let loaded = NetPlanner::load(directory, config);
            Network::new(loaded.with_context(|| format!("--weights {}", directory.display()))?)
        }
        None => Network::new(Bundled { config, loaded: None }),
    })
}

/// The bundled weights, read at the first decision that needs them: most need none.
struct Bundled {
    config: NetPlannerConfig,
    loaded: Option<NetPlanner>,
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
