//! What was merged moves as the session adjusts its scans together.

use super::Placed;
use geometry::PointCloud;
use nalgebra::{Isometry3, Point3};
use planning::Accumulate;
use planning::accumulate::averaged;

/// A scan that was merged.
pub(super) struct Merged {
    /// Its number in the session, and its next view from 0; the first scan has none.
    pub number: usize,
    pub view: Option<usize>,
    /// Its points as given, and in their true places.
    pub given: Vec<Point3<f64>>,
    pub truth: Vec<Point3<f64>>,
    pub correction: Isometry3<f64>,
}

impl Merged {
    /// Its points where they are put, each with the square of how far off that is. The first scan is in its true place.
    fn squared_errors(&self) -> impl Iterator<Item = (Point3<f64>, f64)> + '_ {
        let placed = self.given.iter().map(|p| self.correction * p);
        placed.zip(&self.truth).map(|(p, truth)| (p, (p - truth).norm_squared()))
    }
}

impl Placed {
    /// Moves what was merged to where the session adjusted it to: the corrections of its scans, by number.
    pub fn follow(
        &mut self,
        corrections: impl Iterator<Item = (usize, Isometry3<f64>)>,
        grid_size: f64,
        tolerance: f64,
    ) {
        let mut any = false;
        for (number, correction) in corrections {
            let Some(scan) = self.scans.iter_mut().find(|scan| scan.number == number) else { continue };
            let motion = correction * scan.correction.inverse();
            if correction == scan.correction {
                continue;
            }
            scan.correction = correction;
            any = true;
            let Some(view) = scan.view.map(|view| &mut self.views[view]) else { continue };
            let squared = scan.squared_errors().map(|(_, squared)| squared).sum::<f64>();
            view.adjusted_m = Some((squared / scan.given.len().max(1) as f64).sqrt());
            view.placed_from_true = motion * view.placed_from_true;
        }
        if !any {
            return;
        }
        (self.sound, self.squared, self.off) = Default::default();
        for scan in &self.scans {
            let mut sound = PointCloud::default();
            for (p, squared) in scan.squared_errors() {
                self.squared += squared;
                match squared < tolerance * tolerance {
                    true => sound.points.push(p),
                    false => self.off += 1,
                }
            }
            self.sound = averaged(&self.sound, &sound, grid_size, Accumulate::Averaged.voxel_origin());
        }
    }
}
