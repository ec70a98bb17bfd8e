//! Training of next-best-view networks: from shards to checkpoints, resumable at any step, watchable, reproducible.
//!
//! [`data`] opens a set and splits it by object; [`loader`]'s threads let a [`task::Task`] make batches (augmented,
//! resampled afresh each epoch from named random streams); [`trainer`] runs the loop; [`checkpoint`] keeps all that
//! exact resumption needs; [`watch`] shows it.

pub mod agreement;
pub mod augment;
pub mod benbv;
pub mod checkpoint;
pub mod config;
pub mod convert;
pub mod data;
pub mod episodes;
pub mod error;
pub mod gradient;
pub mod learner;
pub mod loader;
pub mod metrics;
pub mod origin;
pub mod pc_nbv;
pub mod pc_nbv_data;
pub mod program;
pub mod quality;
pub mod schedule;
pub mod step;
pub mod task;
pub mod trainer;
pub mod watch;

pub use benbv::BenbvTask;
pub use config::TrainConfig;
pub use data::Dataset;
pub use error::TrainError;
pub use task::Task;
pub use trainer::{Outcome, Run, train};
