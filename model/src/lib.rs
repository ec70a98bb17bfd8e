//! The networks of next-best-view planning: BENBV-Net and its rival PC-NBV, as burn modules.
//!
//! The way from a cloud to a score: [`encode`] makes [`NetInput`] from observations (the only way to tensors),
//! [`BenbvNet`] scores it, [`NetPlanner`] puts both behind [`planning::Planner`]. [`checkpoint`] keeps weights
//! with all that is needed to use them; [`published`] speaks the names and layouts of PyTorch.
//!
//! In shapes: `B` batch, `N` cloud points, `K` candidates, `C` channels.

pub mod adamw;
pub mod benbv;
pub mod blocks;
pub mod checkpoint;
pub mod config;
pub mod device;
pub mod encode;
pub mod loss;
mod nearest;
pub mod net_planner;
pub mod pc_nbv;
pub mod pc_nbv_model;
pub mod precision;
pub mod published;
mod shared_mlp;
pub mod sums;

pub use adamw::AdamW;
pub use benbv::{BenbvNet, NetInput};
pub use config::{BenbvNetConfig, SizeError};
pub use encode::{EncodeConfig, Encoded, Normalisation};
pub use loss::{position_weighted_loss, within_decision_loss};
pub use net_planner::{NetPlanner, NetPlannerConfig, NetPlannerError};
pub use pc_nbv::{PcNbvNet, PcNbvNetConfig};
pub use pc_nbv_model::{PcNbvError, PcNbvModel};
pub use precision::Precision;
pub use shared_mlp::free_buffers;
