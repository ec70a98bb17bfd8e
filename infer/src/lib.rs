//! A shell around the crate `planning` for real scans: the program `infer`, and what the Python package shares with it.

mod args;
mod check;
mod direct;
mod frustums;
mod http;
mod kept;
mod lines;
pub mod load;
#[cfg(feature = "ros2")]
mod node;
mod outputs;
pub mod plan;
pub mod program;
pub mod report;
mod request;
mod service;
mod simulate;
pub mod weights;

pub use request::{Unit, changed_settings};
