//! PC-NBV ready for a planner: no burn type in its interface.

use crate::checkpoint::{self, Checkpoint, CheckpointError};
use crate::device::{self, DeviceError};
use crate::pc_nbv::{self, MIN_POINTS, PcNbvNet, PcNbvNetConfig, VIEWS};
use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use nalgebra::Point3;
use std::path::Path;

/// Why a prediction cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum PcNbvError {
    /// The device is not to be had.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The weights are not to be had.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Too few points for the graph of neighbours.
    #[error("the cloud has {found} points; PC-NBV needs at least {MIN_POINTS}")]
    TooFewPoints {
        /// Points found.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} is not finite; remove such points first")]
    NotFinite {
        /// Its index.
        index: usize,
    },
}

/// A trained PC-NBV.
#[derive(Clone, Debug)]
pub struct PcNbvModel {
    net: PcNbvNet,
    info: Checkpoint<PcNbvNetConfig>,
    device: Device,
}

impl PcNbvModel {
    /// From a checkpoint directory, on the CPU.
    pub fn load(directory: &Path) -> Result<Self, PcNbvError> {
        Self::load_on(directory, "cpu")
    }

    /// From a checkpoint directory, on the device of this name.
    pub fn load_on(directory: &Path, device: &str) -> Result<Self, PcNbvError> {
        let device = device::open(device)?;
        let (net, info) = checkpoint::load(directory, &device)?;
        Ok(Self::new(net, info))
    }

    /// From the text of `checkpoint.toml` and the bytes of `model.safetensors`.
    pub fn from_bytes(description: &str, weights: &[u8]) -> Result<Self, PcNbvError> {
        let (net, info) = checkpoint::load_bytes(description, weights, &Device::flex())?;
        Ok(Self::new(net, info))
    }

    /// From a network at hand, on its device.
    pub fn new(net: PcNbvNet, info: Checkpoint<PcNbvNetConfig>) -> Self {
        let net = net.valid();
        let device = net.devices().into_iter().next().unwrap_or_else(Device::flex).inner();
        Self { net, info, device }
    }

    /// What the checkpoint says of the weights.
    pub fn checkpoint(&self) -> &Checkpoint<PcNbvNetConfig> {
        &self.info
    }

    /// Expected gain of each of the 33 views ([`pc_nbv::view_directions`]) as a share of the surface. `state` is 1 for
    /// used views, else 0. All points are taken as they are: time and memory grow with the square of their number.
    pub fn predict(&self, points: &[Point3<f64>], state: &[f32; VIEWS]) -> Result<[f32; VIEWS], PcNbvError> {
        let n = points.len();
        if n < MIN_POINTS {
            return Err(PcNbvError::TooFewPoints { found: n });
        }
        if let Some(index) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(PcNbvError::NotFinite { index });
        }
        let values: Vec<f32> = pc_nbv::normalise(points).into_iter().flatten().collect();
        let points = Tensor::from_data(TensorData::new(values, [1, n, 3]), &self.device);
        let state = Tensor::from_data(TensorData::new(state.to_vec(), [1, VIEWS]), &self.device);
        let gains = self.net.forward(points, state).into_data().convert::<f32>(); // [1, 33]
        let mut out = [0.0; VIEWS];
        for (out, gain) in out.iter_mut().zip(gains.as_slice::<f32>().unwrap_or(&[])) {
            *out = *gain;
        }
        Ok(out)
    }
}
