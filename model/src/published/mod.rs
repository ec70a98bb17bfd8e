//! Weights under the names and in the layouts of PyTorch, read from `.safetensors` and `.pth`, written as
//! `.safetensors` that `load_state_dict(strict=True)` takes.

mod export;
mod import;

pub use export::{Precision, to_safetensors};
pub use import::{apply, read_file, read_safetensors};

use crate::benbv::BenbvNet;
use crate::config::{BenbvNetConfig, SizeError};
use burn::store::ModuleSnapshot;
use burn::tensor::Device;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A network whose weights have names known to PyTorch.
pub trait Network: ModuleSnapshot {
    /// Its sizes.
    type Config: Serialize + DeserializeOwned + Clone + Send;
    /// Its name in a checkpoint.
    const KIND: &'static str;

    /// Fresh weights, or what makes the sizes impossible.
    fn create(config: &Self::Config, device: &Device) -> Result<Self, SizeError>;

    /// Weights that a network of this configuration has at the very least.
    fn least_weights(config: &Self::Config) -> f64;

    /// Whether PyTorch keeps the weight of this name as that of a `Conv1d` of kernel 1, [out, in, 1].
    fn is_conv(name: &str) -> bool;
}

impl Network for BenbvNet {
    type Config = BenbvNetConfig;
    const KIND: &'static str = "benbv-net";

    fn create(config: &BenbvNetConfig, device: &Device) -> Result<Self, SizeError> {
        config.validate()?;
        Ok(config.init(device))
    }

    fn least_weights(config: &BenbvNetConfig) -> f64 {
        config.least_weights()
    }

    fn is_conv(name: &str) -> bool {
        let convolutions = ["pos_feat.", "normal_feat.", "past_feat."];
        convolutions.iter().any(|prefix| name.starts_with(prefix)) && name.ends_with(".0.weight")
    }
}

/// Why weights cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file cannot be read or written.
    #[error("{file}: {cause}")]
    Io {
        /// The file.
        file: String,
        /// The cause.
        cause: std::io::Error,
    },
    /// Not a weights file, or a damaged one.
    #[error("{file}: not a readable {format} file: {reason}")]
    Unreadable {
        /// The file.
        file: String,
        /// `safetensors` or `PyTorch`.
        format: &'static str,
        /// The cause.
        reason: String,
    },
    /// Not a kind of file we know.
    #[error("{file}: unknown kind of weights file; expected .safetensors, .pth, .pt or .bin")]
    UnknownKind {
        /// The file.
        file: String,
    },
    /// The tensors do not fit the network.
    #[error("{file} does not fit the network of this configuration:{problems}\n{hint}")]
    Misfit {
        /// The file.
        file: String,
        /// One line per tensor.
        problems: String,
        /// The way out.
        hint: &'static str,
    },
    /// The sizes are impossible.
    #[error("impossible network: {0}")]
    Config(#[from] SizeError),
}
