//! Weights of `benbv-net`, from a checkpoint directory.

use anyhow::{Context, Result};
use infer::Network;
use model::NetPlanner;
use model::net_planner::NetPlannerConfig;
use std::path::Path;

/// The network of `--weights`; none without it.
pub fn network(directory: Option<&Path>) -> Result<Option<Network>> {
    let Some(directory) = directory else { return Ok(None) };
    let planner = NetPlanner::load(directory, NetPlannerConfig::default())
        .with_context(|| format!("--weights {}", directory.display()))?;
    Ok(Some(Network::new(planner)))
}
