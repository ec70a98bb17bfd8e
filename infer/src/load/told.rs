//! What a command line tells of a scan beside its file.

use super::Loaded;
use nalgebra::Isometry3;
use planning::Scan;
use serde::{Deserialize, Serialize};

/// What a command line tells of a scan beside its file, in place of what the file alone tells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// What there is to say of how it was read.
    pub notes: Vec<String>,
    /// The pose of the camera of a depth image or an organised cloud, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<Isometry3<f64>>,
}

impl Told {
    /// Lays it over the scan as it was read from its file alone.
    pub fn lay_over(&self, loaded: &mut Loaded) {
        loaded.reading.notes.clone_from(&self.notes);
        if let (Scan::Depth { world_from_camera, .. }, Some(told)) = (&mut loaded.scan, self.world_from_camera) {
            *world_from_camera = told;
        }
    }
}
