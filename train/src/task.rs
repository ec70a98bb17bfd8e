//! What is trained on what: the part of training that differs between networks.

use crate::TrainError;
use crate::metrics::RankingMetrics;
use burn::tensor::{Device, Tensor};
use model::encode::EncodeConfig;
use model::published::Network;

/// Training samples with the loss of a network on them. Batches are made by loader threads, in any order: what
/// is in one depends on the seed, the epoch and the visits alone.
pub trait Task: Sync {
    /// The network.
    type Net: Network;
    /// Some samples, ready for the device.
    type Batch: Send;

    /// Sizes of the network.
    fn network(&self) -> <Self::Net as Network>::Config;

    /// The same with nothing random in its forward pass, for comparing devices: each draws different random numbers.
    fn network_without_dropout(&self) -> <Self::Net as Network>::Config {
        self.network()
    }

    /// How observations become its input.
    fn encode(&self) -> EncodeConfig;

    /// Visits to samples in an epoch.
    fn visits(&self) -> usize;

    /// The samples of these visits. Those that cannot be used are left out; why is said by [`Task::refusals`].
    ///
    /// # Errors
    /// Data that cannot be read any more.
    fn batch(&self, epoch: u32, visits: &[usize]) -> Result<Self::Batch, TrainError>;

    /// Samples of a batch, and the number of terms in its loss (its weight beside other batches).
    fn size(batch: &Self::Batch) -> (usize, usize);

    /// Mean loss of a batch.
    fn loss(&self, net: &Self::Net, batch: &Self::Batch, device: &Device) -> Tensor<1>;

    /// Loss and ranking on the held-out objects; `net` is in evaluation mode.
    fn validate(&self, net: &Self::Net, device: &Device) -> Result<Validation, TrainError>;

    /// Closed-loop episodes; `None` where the settings want none.
    fn episodes(&self, net: &Self::Net, device: &Device) -> Option<Episodes>;

    /// Samples refused since the last call, each with its reason.
    fn refusals(&self) -> Vec<String>;

    /// Names the data, so that a run is not resumed on another set.
    fn data_name(&self) -> String;
}

/// Result of a validation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Validation {
    /// Mean loss.
    pub loss: f64,
    /// Quality of the order of the candidates.
    pub ranking: RankingMetrics,
}

/// Result of a round of episodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Episodes {
    /// Episodes that counted.
    pub count: usize,
    /// Mean final coverage, in [0, 1].
    pub coverage: f64,
    /// Mean number of views to 90 % coverage.
    pub views_to_90: f64,
}
