//! Policies, metrics and the paper's tables: objects x policies x episodes through one loop, with confidence intervals.

mod args;
pub mod batches;
pub mod benchmark;
pub mod bootstrap;
pub mod config;
mod idle;
pub mod journal;
pub mod learned;
pub mod metrics;
#[cfg(feature = "networks")]
pub mod networks;
#[cfg(not(feature = "networks"))]
#[path = "no_networks.rs"]
pub mod networks;
pub mod objects;
pub mod policies;
pub mod program;
pub mod record;
pub mod report;
pub mod run;
