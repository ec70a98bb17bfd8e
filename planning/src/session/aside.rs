//! Scans that could not be registered yet: kept aside, and tried again after each that is merged.

use super::Session;
use crate::registration::{AfterAlarm, Register};
use crate::scan::PreparedScan;
use nalgebra::Point3;

/// Scans merged after one that waits, after which no view is spent on it any more; it is still tried again.
const MOST_BRIDGES: usize = 2;

impl Session {
    /// The scan that came last, merged or not.
    pub(super) fn latest(&self) -> Option<&PreparedScan> {
        self.scans.iter().chain(&self.aside).max_by_key(|scan| scan.number)
    }

    /// Whether a scan that cannot be registered waits for others.
    pub(super) fn keeps_aside(&self) -> bool {
        self.config.registration.after_alarm == AfterAlarm::Bridge
    }

    /// Whether scans are moved onto the cloud: else none that waits can be merged.
    fn refines(&self) -> bool {
        self.config.registration.register == Register::Refine
    }

    /// Scans that wait, and for which a view is worth spending.
    pub(super) fn alarms(&self) -> impl Iterator<Item = &PreparedScan> {
        self.aside.iter().filter(|scan| self.refines() && self.tries(scan) < MOST_BRIDGES)
    }

    /// Scans merged since this one came.
    fn tries(&self, aside: &PreparedScan) -> usize {
        self.scans.iter().filter(|scan| scan.number > aside.number).count()
    }

    /// Cameras whose scans could not be registered onto the cloud as it is.
    pub fn unregistered(&self) -> Vec<Point3<f64>> {
        let waiting = self.alarms().filter_map(PreparedScan::camera_position);
        self.unregistered.iter().copied().chain(waiting).collect()
    }

    /// How the scan with this number, from 1, was moved when it was merged; `None` where it waits, or was not registered.
    pub fn correction(&self, number: usize) -> Option<nalgebra::Isometry3<f64>> {
        let scan = self.scans.iter().find(|scan| scan.number == number && scan.moved)?;
        Some(scan.report.registration.as_ref()?.correction)
    }

    /// Tries those that wait, after scan `with` was merged; each that fits may hold the next.
    pub(super) fn try_again(&mut self, with: usize) {
        let mut i = 0;
        while self.refines() && i < self.aside.len() {
            let mut scan = self.aside[i].clone();
            self.hold_against_cloud(&mut scan);
            if scan.moved {
                scan.merged_with = with;
                self.aside.remove(i);
                self.scans.push(scan);
                self.take_in(self.scans.len() - 1);
                i = 0;
            } else {
                self.aside[i] = scan;
                i += 1;
            }
        }
    }

    /// Leaves the first `count` scans that came. Those that were merged with one that goes wait again.
    pub(super) fn keep_first(&mut self, count: usize) {
        let (stay, go): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.scans).into_iter().partition(|scan| scan.merged_with <= count);
        self.scans = stay;
        self.scans.iter_mut().for_each(|scan| scan.unadjust(count));
        self.aside.extend(go.into_iter().map(PreparedScan::unmoved));
        self.aside.retain(|scan| scan.number <= count);
        self.aside.sort_by_key(|scan| scan.number);
        self.offsets.clear();
        self.unregistered.clear();
        self.support = self.known_support(&self.config);
    }

    /// A sentence for each scan that waits.
    pub(super) fn waiting(&self) -> Vec<String> {
        let tell = |scan: &PreparedScan| {
            let why = scan.report.registration.as_ref().and_then(|found| found.refused.as_ref());
            let why = why.map_or_else(String::new, |why| format!(": {why}"));
            let until = if self.refines() {
                "is kept aside and tried again after each scan that is merged"
            } else {
                "is kept aside and waits for registration.register = \"refine\" (--register refine)"
            };
            format!("scan {} {until}{why}", scan.number)
        };
        self.aside.iter().map(tell).collect()
    }
}
