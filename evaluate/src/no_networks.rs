//! Stands in for the networks where the program is built without them.

use crate::config::EvaluateConfig;
use crate::policies::BoxedPlanner;
use std::path::Path;

/// Why a network cannot be had.
#[derive(Debug, thiserror::Error)]
#[error("this program was built without networks; build it with `--features networks`")]
pub struct WeightsError;

/// No weights.
#[derive(Default)]
pub struct Networks;

impl Networks {
    /// For any settings.
    pub fn new(_config: &EvaluateConfig) -> Self {
        Self
    }

    /// There is nothing to put on a device.
    ///
    /// # Errors
    /// Never.
    pub fn check_device(&self) -> Result<(), WeightsError> {
        Ok(())
    }

    /// None.
    pub fn benbv_net_digest(&self, _directory: Option<&Path>) -> Option<String> {
        None
    }

    /// None.
    ///
    /// # Errors
    /// Never.
    pub fn of_auto(&self) -> Result<Option<planning::Network>, WeightsError> {
        Ok(None)
    }

    /// None.
    pub fn pc_nbv_digest(&self) -> Option<String> {
        None
    }

    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn benbv_net<'a>(&self, _directory: Option<&Path>) -> Result<BoxedPlanner<'a>, WeightsError> {
        Err(WeightsError)
    }

    /// None.
    ///
    /// # Errors
    /// Always.
    pub fn pc_nbv<'a>(&self, _name: &str, _published: bool) -> Result<BoxedPlanner<'a>, WeightsError> {
        Err(WeightsError)
    }
}
