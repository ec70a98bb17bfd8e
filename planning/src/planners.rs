//! The planners that need neither a model of the object nor a network.

pub mod auto;
pub mod farthest;
pub mod volumetric;
