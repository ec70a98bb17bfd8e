//! Registered scans, adjusted together after each that is merged.

use super::Session;
use crate::registration::adjust::{Piece, adjust};
use crate::registration::{Icp, Register, displacement};
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
            if displacement(&scan.cloud, motion) >= least {
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
        if let Some(found) = &mut self.report.registration {
            found.correction = motion * found.correction;
            found.shift_m = displacement(&self.cloud, &found.correction.inverse());
            found.turn_deg = found.correction.rotation.angle().to_degrees();
        }
    }
}

#[cfg(test)]
mod tests;
