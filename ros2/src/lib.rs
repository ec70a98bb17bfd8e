//! A ROS 2 node around the planner, without a ROS install: what comes over topics becomes the requests that HTTP carries too
//! ([`cloud`], [`image`], [`transforms`]), and answers become messages ([`markers`]). Only `node` talks to a network; all else
//! is tested on bytes. `docs/ros2.md` says how to use it.

pub mod answer;
pub mod cloud;
mod config;
pub mod desk;
mod error;
pub mod image;
pub mod inbox;
pub mod markers;
pub mod messages;
#[cfg(feature = "node")]
pub mod node;
pub mod planner;
pub mod transforms;

pub use config::{Reliability, Ros2Config, Services};
pub use error::MessageError;
