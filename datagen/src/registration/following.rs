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
            let left = (squared / scan.given.len().max(1) as f64).sqrt();
            (view.adjusted_m, view.adjusted_failed) = (Some(left), Some(left > tolerance));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration::ViewRegistration;
    use nalgebra::{Translation3, Vector3};

    const GRID: f64 = 0.01;
    const TOLERANCE: f64 = 0.003;

    /// The first scan, and a second beside it that was merged uncorrected, `off` from its true place; points 50 mm apart.
    fn two_scans(off: &Isometry3<f64>) -> Placed {
        let sheet = |from: f64| -> Vec<_> {
            (0..25).map(|i| Point3::new(from + 0.05 * f64::from(i % 5), 0.05 * f64::from(i / 5), 0.004)).collect()
        };
        let (first, truth) = (sheet(0.0), sheet(0.5));
        let scan = |number, view, truth: &[Point3<f64>], off: &Isometry3<f64>| Merged {
            number,
            view,
            given: truth.iter().map(|p| off * p).collect(),
            truth: truth.to_vec(),
            correction: Isometry3::identity(),
        };
        let view = ViewRegistration {
            given_m: 0.0,
            left_m: Some(0.0),
            failed: false,
            adjusted_m: None,
            adjusted_failed: None,
            refused: None,
            placed_from_true: *off,
            like_overlap: 0.0,
            lambda: 0.0,
            expected_lambda: 0.0,
            expected_failure: 0.0,
            waited: 0,
            bridge: false,
        };
        let scans = vec![scan(1, None, &first, &Isometry3::identity()), scan(4, Some(0), &truth, off)];
        Placed { scans, views: vec![view], ..Placed::default() }
    }

    #[test]
    fn what_was_moved_is_measured_anew() {
        let off = Translation3::new(0.004, 0.0, 0.0).into();
        let mut placed = two_scans(&off);
        placed.follow([(4, Translation3::new(-0.003, 0.0, 0.0).into())].into_iter(), GRID, TOLERANCE);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        assert!(near(placed.views[0].adjusted_m.expect("moved"), 0.001), "{:?}", placed.views[0]);
        assert!(near(placed.squared, 25.0 * 1e-6) && placed.off == 0);
        assert_eq!(placed.views[0].failed_in_the_end(), Some(false));
        assert_eq!(placed.sound.len(), 50, "both scans");
        placed.follow([(4, Translation3::new(0.002, 0.0, 0.0).into())].into_iter(), GRID, TOLERANCE);
        assert!(near(placed.views[0].adjusted_m.expect("moved"), 0.006), "6 mm off now: {:?}", placed.views[0]);
        assert_eq!(placed.views[0].failed_in_the_end(), Some(true));
        assert_eq!((placed.off, placed.sound.len()), (25, 25), "the first alone is in its place");
    }

    #[test]
    fn the_motion_from_the_true_place_follows_corrections_one_after_another() {
        let turned = |x: f64| Isometry3::new(Vector3::new(x, -0.002, 0.001), Vector3::new(0.01, x, 0.02));
        let mut placed = two_scans(&turned(0.004));
        for x in [0.001, -0.006] {
            placed.follow([(4, turned(x))].into_iter(), GRID, TOLERANCE);
            let scan = &placed.scans[1];
            for (given, truth) in scan.given.iter().zip(&scan.truth) {
                assert!((turned(x) * given - placed.views[0].placed_from_true * truth).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn what_was_not_moved_stays() {
        let turn = Isometry3::rotation(0.01 * Vector3::z());
        let mut placed = two_scans(&turn);
        let before = placed.views.clone();
        placed.follow([(1, Isometry3::identity()), (4, Isometry3::identity()), (9, turn)].into_iter(), GRID, TOLERANCE);
        assert_eq!(placed.views, before);
        assert!(placed.sound.is_empty(), "nothing is averaged again");
    }
}
