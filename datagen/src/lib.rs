//! Simulated scanning and the model-based BENBV search.

pub mod noise;
pub mod scene;

pub use noise::NoiseConfig;
pub use scene::{RenderConfig, RenderScratch, Renderer, Scene};
