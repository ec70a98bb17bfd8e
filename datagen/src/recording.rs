//! A recorded sequence as the world of an episode: its scans are the only ones that can be taken, each from its own view,
//! and all of them together are the whole surface.

mod settle;

use crate::episode::EpisodeEvidence;
use formats::sequence::{Sequence, SequenceScan};
use geometry::{NeighborGrid, View};
use nalgebra::{Isometry3, Point3};
use planning::accumulate::{Accumulate, reference_surface};
use planning::config::CameraConfig;
use planning::{ConstraintsConfig, SessionConfig};
use rayon::prelude::*;
use settle::Settled;

/// Share of the returns of depth images that must lie outside of the object's box for the images to show its background.
const SHOWS_BACKGROUND: f64 = 0.1;

/// Recorded scans and what each covers of their union.
#[derive(Clone, Debug)]
pub struct Recording {
    sequence: Sequence,
    views: Vec<View>,
    tolerance_m: f64,
    spread_m: f64,
    reference: Vec<Point3<f64>>,
    covers: Vec<Vec<u32>>,
    region_m: [[f64; 3]; 2],
    background: bool,
}

impl Recording {
    /// Makes out the surface: the mean of all scans where they lie apart by their noise, averaged in voxels as wide as the
    /// tolerance, so that it weighs alike however often it was scanned. `tolerance_m` counts where the sequence names none.
    pub fn new(sequence: Sequence, tolerance_m: f64) -> Self {
        let tolerance_m = sequence.tolerance_m.unwrap_or(tolerance_m);
        let all: Vec<Point3<f64>> = sequence.scans.iter().flat_map(|s| s.points.iter().copied()).collect();
        let Settled { scans, spread_m } = Settled::new(&sequence.scans, tolerance_m);
        let reference = reference_surface(&scans.concat(), tolerance_m, Accumulate::Averaged);
        let covered_by = |points: &Vec<Point3<f64>>| {
            let grid = NeighborGrid::new(points, 2.0 * tolerance_m);
            (0..reference.len() as u32).filter(|&i| grid.any_within(&reference[i as usize], tolerance_m)).collect()
        };
        let covers = scans.par_iter().map(covered_by).collect();
        let ahead = Point3::new(0.0, 0.0, sequence.working_distance_m);
        let view = |s: &SequenceScan| View {
            target: s.world_from_camera * ahead,
            position: Point3::from(s.world_from_camera.translation.vector),
        };
        let views = sequence.scans.iter().map(view).collect();
        let region_m = sequence.region_m.unwrap_or_else(|| bounds(&all));
        let background = sequence.background.unwrap_or_else(|| shows_background(&sequence, &region_m));
        Self { sequence, views, tolerance_m, spread_m, reference, covers, region_m, background }
    }

    /// Number of scans.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is none; a sequence that was read has two at least.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Where each scan was taken from; it looks at what is the working distance ahead.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The poses of all scans, for [`planning::Session::set_given_views`].
    pub fn poses(&self) -> Vec<Isometry3<f64>> {
        self.sequence.scans.iter().map(|s| s.world_from_camera).collect()
    }

    /// What a scan measured.
    pub fn points(&self, scan: usize) -> &[Point3<f64>] {
        &self.sequence.scans[scan].points
    }

    /// The surface that coverage is a share of.
    pub fn reference(&self) -> &[Point3<f64>] {
        &self.reference
    }

    /// Distance under which a point of the surface is covered, metres.
    pub fn tolerance_m(&self) -> f64 {
        self.tolerance_m
    }

    /// Standard deviation of the scans from the surface that they have in common, along its normals, metres: noise, and
    /// what registration left.
    pub fn spread_m(&self) -> f64 {
        self.spread_m
    }

    /// Indices into the surface of what a scan covers, rising.
    pub fn covered_by(&self, scan: usize) -> &[u32] {
        &self.covers[scan]
    }

    /// Whether the recording has this evidence.
    pub fn has(&self, evidence: EpisodeEvidence) -> bool {
        let images = || self.sequence.scans.iter().all(|s| s.image.is_some());
        match evidence {
            EpisodeEvidence::DepthWithBackground => images() && self.background,
            EpisodeEvidence::Depth => images(),
            EpisodeEvidence::CameraPositions | EpisodeEvidence::Clouds | EpisodeEvidence::Merged => true,
        }
    }

    /// The settings of a robot's session on this sequence: its working distance, its camera, its up, and, of whole images,
    /// the box that the object is in. All else stays at its default.
    pub fn session_config(&self, evidence: EpisodeEvidence) -> SessionConfig {
        let images = matches!(evidence, EpisodeEvidence::DepthWithBackground | EpisodeEvidence::Depth);
        let camera = self.sequence.scans.iter().find_map(|s| s.image.as_ref()).map(|(camera, _)| CameraConfig {
            width: camera.width,
            height: camera.height,
            intrinsics: Some([camera.fx, camera.fy, camera.cx, camera.cy]),
            ..CameraConfig::default()
        });
        SessionConfig {
            working_distance_m: self.sequence.working_distance_m,
            region_m: (images && (self.background || self.sequence.region_m.is_some())).then_some(self.region_m),
            camera: camera.unwrap_or_default(),
            constraints: ConstraintsConfig { up: self.sequence.up.into(), ..ConstraintsConfig::default() },
            ..SessionConfig::default()
        }
    }

    /// A scan as it was recorded.
    pub(crate) fn scan(&self, index: usize) -> &SequenceScan {
        &self.sequence.scans[index]
    }
}

/// The box around points.
fn bounds(points: &[Point3<f64>]) -> [[f64; 3]; 2] {
    points.iter().fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], p| {
        [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
    })
}

/// Whether the images hold more than the object.
fn shows_background(sequence: &Sequence, [low, high]: &[[f64; 3]; 2]) -> bool {
    let (mut returns, mut outside) = (0usize, 0usize);
    for scan in &sequence.scans {
        let Some((camera, depth)) = &scan.image else { return false };
        let points = depth.to_points(camera, &scan.world_from_camera);
        returns += points.len();
        outside += points.iter().filter(|p| (0..3).any(|k| p[k] < low[k] || p[k] > high[k])).count();
    }
    outside as f64 > SHOWS_BACKGROUND * returns as f64
}

#[cfg(test)]
mod tests;
