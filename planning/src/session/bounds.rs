//! What a session holds, and how it is made whole again after a fault.

use super::Session;
use crate::scan::PreparedScan;
use crate::{PastScan, Planner, Seen};
use std::sync::Arc;

impl Session {
    /// Memory that the scans, the cloud, the neighbours of its points and the planners hold, roughly, in bytes.
    pub fn memory(&self) -> usize {
        let seen = |past: &Arc<PastScan>| match &past.seen {
            Seen::Depth { depth, .. } => 4 * depth.depth.len(),
            Seen::Points(points) => 24 * points.len() + past.veil.as_ref().map_or(0, |veil| veil.memory()),
        };
        let points = |s: &PreparedScan| 48 * s.cloud.len() + 24 * s.stood_on.len();
        let scans = self.scans.iter().chain(&self.aside).map(|s| points(s) + s.past.iter().map(seen).sum::<usize>());
        let near = self.state.near.get().map_or(0, |near| 8 * near.k() * near.len());
        scans.sum::<usize>() + 48 * self.state.cloud.len() + near + self.planners.memory()
    }

    /// The first `scans` scans alone, everything else found anew: after a fault in the middle of a request the session
    /// is as it was before.
    pub fn restore(&mut self, scans: usize) {
        self.keep_first(scans);
        self.planners.reset();
        self.rebuild();
    }
}
