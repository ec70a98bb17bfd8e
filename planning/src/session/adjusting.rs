//! Registered scans, adjusted together after each that is merged.

use super::Session;
use crate::registration::adjust::{Piece, adjust};
use crate::registration::{Icp, Register};
use crate::scan::PreparedScan;
use nalgebra::Isometry3;

/// Tolerances by which a scan is to move at least: less changes no plan.
const WORTH_MOVING: f64 = 0.1;
/// Scans from which on they may hold each other better than one after another.
const FEWEST: usize = 3;

impl Session {
    /// Moves registered scans so that all fit together, after scan `with` was merged. Not those of plain ICP: it pairs points beyond the
    /// rim, and with pairs between all scans that pulls one onto another (docs/registration.md, 'Scans adjusted together').
    pub(super) fn adjust(&mut self, with: usize) {
        let config = &self.config.registration;
        let merged = self.scans.iter().filter(|scan| !scan.cloud.is_empty()).count();
        let asked = config.adjust && config.register == Register::Refine && config.kind == Icp::Good;
        if !asked || merged < FEWEST {
            return;
        }
        let piece = |scan: &'_ PreparedScan| {
            let found = scan.report.registration.as_ref().filter(|_| scan.moved);
            found.map(|found| (found.correction, config.error(scan.camera_position())))
        };
        let pieces =
            self.scans.iter().map(|scan| Piece { cloud: &scan.cloud, spacing: scan.spacing, given: piece(scan) });
        let motions = adjust(&pieces.collect::<Vec<_>>(), self.config.tolerance_m, config);
        let least = WORTH_MOVING * self.config.tolerance_m;
        let mut any = false;
        for (scan, motion) in self.scans.iter_mut().zip(&motions) {
            if scan.displacement(motion) >= least {
                scan.adjust(motion);
                scan.adjusted.push((with, *motion));
                any = true;
            }
        }
        if any {
            self.offsets.clear();
            self.rebuild();
        }
    }

    /// The corrections of the scans that were moved, with the scans' numbers from 1.
    pub fn corrections(&self) -> impl Iterator<Item = (usize, Isometry3<f64>)> + '_ {
        let moved = self.scans.iter().filter(|scan| scan.moved);
        moved.filter_map(|scan| Some((scan.number, scan.report.registration.as_ref()?.correction)))
    }
}

impl PreparedScan {
    /// Takes back the adjustments that came with scans after number `last`.
    pub(super) fn unadjust(&mut self, last: usize) {
        while let Some((_, motion)) = self.adjusted.pop_if(|(with, _)| *with > last) {
            self.adjust(&motion.inverse());
        }
    }

    fn adjust(&mut self, motion: &Isometry3<f64>) {
        self.move_by(motion);
        let shift = |correction: &Isometry3<f64>| self.displacement_from(correction);
        if let Some(correction) = self.report.registration.as_ref().map(|found| motion * found.correction) {
            let shift_m = shift(&correction);
            if let Some(found) = &mut self.report.registration {
                (found.correction, found.shift_m) = (correction, shift_m);
                found.turn_deg = correction.rotation.angle().to_degrees();
            }
        }
    }

    /// Root mean square of how far a motion moves its points, metres.
    fn displacement(&self, motion: &Isometry3<f64>) -> f64 {
        let squared: f64 = self.cloud.points.iter().map(|p| (motion * p - p).norm_squared()).sum();
        (squared / self.cloud.len().max(1) as f64).sqrt()
    }

    /// The same of the motion that brought them to where they are.
    fn displacement_from(&self, motion: &Isometry3<f64>) -> f64 {
        self.displacement(&motion.inverse())
    }
}

#[cfg(test)]
mod tests;
