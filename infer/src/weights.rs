//! Weights of `benbv-net`: bundled, or from a checkpoint directory.

use anyhow::{Context, Result};
use model::NetPlanner;
use model::net_planner::{Bundled, NetPlannerConfig};
use planning::Network;
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
            Network::new(loaded.with_context(|| format!("--weights {directory:?}"))?)
        }
        None => Network::new(Bundled::new(config)),
    })
}
