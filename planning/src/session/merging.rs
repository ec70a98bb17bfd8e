//! The state of a session from its scans.

use super::Session;
use crate::accumulate::{self, reference_surface};
use crate::{Accumulate, Budget, ScanState};
use geometry::{Neighborhoods, mean_spacing};
use std::sync::{Arc, OnceLock};

/// Of the spacing that thinning adds, so much more does a point stand for: the widest holes between points that are thinned
/// to a radius reach about as far.
const THINNED: f64 = 0.9;

impl Session {
    /// The state from all scans anew.
    pub(super) fn rebuild(&mut self) {
        self.state = ScanState {
            given_views: Arc::clone(&self.given_views),
            working_distance: self.config.working_distance_m,
            ..ScanState::default()
        };
        self.ranking = None;
        match self.config.accumulate {
            Accumulate::Thinned if self.scans.is_empty() => {}
            Accumulate::Thinned => self.take_in(self.scans.len() - 1),
            _ => (0..self.scans.len()).for_each(|i| self.take_in(i)),
        }
    }

    /// The state with scan `index`, after those before it.
    pub(super) fn take_in(&mut self, index: usize) {
        self.ranking = None;
        let config = &self.config;
        let scans = &self.scans[..=index];
        let first_spacing = scans[0].spacing;
        let (old, new) = (std::mem::take(&mut self.state.cloud), &scans[index].cloud);
        let cloud = match config.accumulate {
            Accumulate::Thinned => accumulate::all_thinned(scans, first_spacing, config),
            Accumulate::Averaged if new.is_empty() => old,
            Accumulate::Averaged => accumulate::averaged(&old, new, first_spacing, config.accumulate.voxel_origin()),
            Accumulate::Matched => match &mut self.truth {
                Some(truth) => {
                    if index == 0 {
                        truth.reference = reference_surface(&truth.samples, first_spacing, config.accumulate);
                    }
                    match new.is_empty() {
                        true => old,
                        false => accumulate::matched(&old, new, &truth.reference, first_spacing, config.tolerance_m),
                    }
                }
                None => old,
            },
        };
        let (grid_size, measured) = match config.accumulate {
            Accumulate::Thinned if scans.len() > 1 => {
                let measured = scans.iter().map(|s| s.measured_spacing).fold(f64::INFINITY, f64::min);
                (mean_spacing(&cloud.points, &Neighborhoods::of(&cloud.points, 2)), measured)
            }
            Accumulate::Thinned => (first_spacing, scans[0].measured_spacing),
            _ => (first_spacing, first_spacing),
        };
        let reach = config.tolerance_m + THINNED * (grid_size - measured).max(0.0);
        self.state = ScanState {
            reach,
            cloud,
            scans: scans.iter().flat_map(|scan| scan.past.iter().cloned()).collect(),
            of_scan: scans.iter().flat_map(|scan| scan.past.iter().map(|_| scan.number)).collect(),
            num_scans: scans.len(),
            grid_size,
            working_distance: config.working_distance_m,
            tolerance: config.tolerance_m,
            camera: config.camera.camera(),
            sensor: config.sensor,
            support: self.support,
            given_views: Arc::clone(&self.given_views),
            roll: self.roll(),
            near: OnceLock::new(),
            budget: Budget::default(),
        };
    }
}
