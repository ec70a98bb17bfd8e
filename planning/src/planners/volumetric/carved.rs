//! The scans taken in: the space that each shows to be free, and what is no longer believed of it once other scans see
//! surface there.

use super::VolumetricPlanner;
use super::grid::VoxelGrid;
use super::silhouette::Silhouette;
use crate::{NoReturn, PastScan, ScanState, Seen};
use nalgebra::Point3;
use std::sync::Arc;

/// Share of the cloud in a scan's background from which on it is none.
const CONTRADICTED: f64 = 0.02;

/// Tolerances by which an adjusted scan may lie elsewhere than when it was carved: voxels are two or more wide.
const STAYS: f64 = 0.5;

/// A scan taken in.
#[derive(Clone, Debug)]
pub(super) struct Carved {
    pub(super) scan: Arc<PastScan>,
    /// What its misses are taken to mean: what was told, as long as no other scan sees surface there.
    misses: NoReturn,
    /// Where they do not tell what is background.
    pub(super) silhouette: Option<Arc<Silhouette>>,
    /// Whether no other scan sees surface outside of that outline.
    trusted: bool,
}

impl Carved {
    pub(super) fn background(&self) -> Option<&Silhouette> {
        self.silhouette.as_deref().filter(|_| self.trusted)
    }

    /// Whether space behind misses is distinguished from unknown space.
    pub(super) fn carves(&self) -> bool {
        self.misses == NoReturn::Free || self.background().is_some()
    }

    /// Whether its misses were declared free space and are not.
    fn is_distrusted(&self) -> bool {
        self.misses != told_misses(&self.scan)
    }
}

fn told_misses(scan: &PastScan) -> NoReturn {
    match &scan.seen {
        Seen::Depth { misses, .. } => *misses,
        Seen::Points(_) => NoReturn::Unknown,
    }
}

impl VolumetricPlanner {
    /// The grid with all scans in it, or as many as there was time for.
    pub(super) fn carved_grid(&mut self, state: &ScanState) -> VoxelGrid {
        let bounded = self.bounded;
        let (low, high) = state.cloud.bounding_box();
        let stays = |old: &PastScan, new: &PastScan| {
            let motion = new.world_from_camera * old.world_from_camera.inverse();
            let near = |p: &Point3<f64>| (motion * p - p).norm() < STAYS * state.tolerance;
            near(&low) && near(&high) && old.seen.is_as_large_as(&new.seen)
        };
        let same = |(old, new): (&Carved, &Arc<PastScan>)| Arc::ptr_eq(&old.scan, new) || stays(&old.scan, new);
        let goes_on = self.carved.len() <= state.scans.len() && self.carved.iter().zip(&state.scans).all(same);
        let kept = self.grid.take().filter(|grid| goes_on && (bounded || grid.holds(&state.cloud.points)));
        let mut grid = kept.unwrap_or_else(|| {
            self.carved.clear();
            self.new_grid(state)
        });
        for scan in &state.scans[self.carved.len()..] {
            if state.budget.is_spent() {
                return grid;
            }
            let misses = told_misses(scan);
            grid.carve(scan, misses);
            let silhouette = self.silhouette(scan, misses, grid.voxel);
            if let Some(silhouette) = &silhouette {
                grid.carve_background(silhouette, scan);
            }
            self.carved.push(Carved { scan: Arc::clone(scan), misses, silhouette, trusted: true });
        }
        if self.distrust(&state.cloud.points, grid.voxel) {
            grid = self.new_grid(state);
            for carved in &self.carved {
                grid.carve(&carved.scan, carved.misses);
                if let Some(silhouette) = carved.background() {
                    grid.carve_background(silhouette, &carved.scan);
                }
            }
        }
        if let Some(plane) = &state.support {
            grid.carve_below(plane);
        }
        grid
    }

    /// The outline of a scan whose misses do not tell background.
    fn silhouette(&self, scan: &PastScan, misses: NoReturn, voxel: f64) -> Option<Arc<Silhouette>> {
        let presumed = self.config.presume_background && misses != NoReturn::Free;
        presumed.then(|| Silhouette::of(scan, voxel)).flatten().map(Arc::new)
    }

    /// No longer trusts the misses, and then the outline, of scans in whose background there is surface; whether there was
    /// such a scan.
    fn distrust(&mut self, points: &[Point3<f64>], voxel: f64) -> bool {
        let most = (CONTRADICTED * points.len() as f64).max(3.0) as usize;
        let mut any = false;
        for i in 0..self.carved.len() {
            let carved = &self.carved[i];
            if carved.misses == NoReturn::Free && num_missed(&carved.scan, points) > most {
                let scan = Arc::clone(&carved.scan);
                let silhouette = self.silhouette(&scan, NoReturn::Unknown, voxel);
                self.carved[i] = Carved { scan, misses: NoReturn::Unknown, silhouette, trusted: true };
                any = true;
            }
            let carved = &self.carved[i];
            let Some(silhouette) = carved.background() else { continue };
            if points.iter().filter(|p| silhouette.is_deep_background(&carved.scan, p)).count() > most {
                self.carved[i].trusted = false;
                any = true;
            }
        }
        any
    }

    /// Which of the past scans, from 0, were declared to have free space where others saw surface.
    pub fn scans_with_distrusted_misses(&self) -> Vec<usize> {
        (0..self.carved.len()).filter(|&i| self.carved[i].is_distrusted()).collect()
    }
}

/// Points that a depth image shows as nothing, in their pixel and in those two around it: nearer to an edge, a pixel may
/// have missed them.
fn num_missed(scan: &PastScan, points: &[Point3<f64>]) -> usize {
    const AROUND: i64 = 2;
    let Seen::Depth { camera, depth, .. } = &scan.seen else { return 0 };
    let camera_from_world = scan.world_from_camera.inverse();
    let [x0, y0] = depth.origin.map(i64::from);
    let [columns, rows] = depth.size.map(i64::from);
    let empty = |u: i64, v: i64| {
        let (x, y) = (u - x0, v - y0);
        !(0..columns).contains(&x) || !(0..rows).contains(&y) || depth.depth[(y * columns + x) as usize] <= 0.0
    };
    let missed = |p: &&Point3<f64>| {
        let local = camera_from_world * *p;
        if local.z <= 0.0 {
            return false;
        }
        let pixel = camera.project(&local);
        let (u, v) = (pixel.x.round() as i64, pixel.y.round() as i64);
        let inside = (0..i64::from(camera.width)).contains(&u) && (0..i64::from(camera.height)).contains(&v);
        inside && (-AROUND..=AROUND).all(|b| (-AROUND..=AROUND).all(|a| empty(u + a, v + b)))
    };
    points.iter().filter(missed).count()
}
