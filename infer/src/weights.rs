//! Weights of `benbv-net`: bundled, or from a checkpoint directory.

use anyhow::{Context, Result};
use model::NetPlanner;
use model::net_planner::NetPlannerConfig;
use planning::Network;
use std::path::Path;

/// The device of programs that are told of none.
pub const CPU: &str = "cpu";

/// The network of `--weights`, without it the bundled one, on the device of this name.
pub fn network(directory: Option<&Path>, device: &str) -> Result<Network> {
    // First and by itself: that a device is missing says nothing of the weights.
    model::device::open(device).context("--device")?;
    let config = NetPlannerConfig { device: device.to_owned(), ..NetPlannerConfig::default() };
    let planner = match directory {
        Some(directory) => {
            NetPlanner::load(directory, config).with_context(|| format!("--weights {}", directory.display()))?
        }
        None => NetPlanner::bundled(config).context("the bundled weights")?,
    };
    Ok(Network::new(planner))
}
