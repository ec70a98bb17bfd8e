//! Stands in for the networks where the program is built without them.

use crate::config::EvaluateConfig;

/// No weights.
#[derive(Default)]
pub struct Networks;

impl Networks {
    /// For any settings.
    pub fn new(_config: &EvaluateConfig) -> Self {
        Self
    }

    /// None.
    ///
    /// # Errors
    /// Never.
    pub fn of_auto(&self) -> Result<Option<planning::Network>, String> {
        Ok(None)
    }

    /// None.
    pub fn digest(&self, _family: &str, _variant: Option<&str>) -> Option<String> {
        None
    }
}
