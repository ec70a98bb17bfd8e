//! Weights of `benbv-net`: bundled, or from a checkpoint directory.

use anyhow::{Context, Result};
use model::NetPlanner;
use model::net_planner::NetPlannerConfig;
use planning::Network;
use std::path::Path;

/// The network of `--weights`; without it the bundled one.
pub fn network(directory: Option<&Path>) -> Result<Network> {
    let config = NetPlannerConfig::default();
    let planner = match directory {
        Some(directory) => {
            NetPlanner::load(directory, config).with_context(|| format!("--weights {}", directory.display()))?
        }
        None => NetPlanner::bundled(config).context("the bundled weights")?,
    };
    Ok(Network::new(planner))
}
