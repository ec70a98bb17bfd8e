//! Simulated scanning and the model-based BENBV search.

mod args;
pub mod config;
pub mod dataset;
pub mod episode;
pub mod generate;
pub mod history;
pub mod inspect;
pub mod noise;
pub mod output;
mod part;
pub mod pose_error;
pub mod procedural;
pub mod program;
mod progress;
pub mod recording;
pub mod registration;
pub mod scene;
pub mod search;
#[cfg(test)]
mod testing;
pub mod verify;
mod visibility;
mod world;

pub use config::DatagenConfig;
pub use episode::{
    Decision, End, Episode, EpisodeConfig, EpisodeError, EpisodeEvidence, Progress, Stage, VoidEpisode, run_episode,
    run_episode_with, run_session,
};
pub use noise::NoiseConfig;
pub use output::{OutputError, OutputKind, check_output};
pub use pose_error::PoseErrorConfig;
pub use recording::Recording;
pub use registration::{EpisodeRegistration, RegistrationOutcome};
pub use scene::{RenderConfig, RenderScratch, Renderer, Scene};
pub use search::{ScoredViews, SearchConfig, SearchPlanner, score_views};
pub use visibility::visible_from;
pub use world::episode_session;
