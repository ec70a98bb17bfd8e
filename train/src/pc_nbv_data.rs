//! Targets for PC-NBV (Zeng et al., IROS 2020) from our simulator: every object is scanned once from each view of the
//! fixed set; episodes are then unions of what those scans cover.

use datagen::{RenderConfig, Scene};
use geometry::{NeighborGrid, Neighborhoods, PinholeCamera, View, mean_spacing};
use nalgebra::Point3;
use planning::Accumulate;
use planning::accumulate::reference_surface;
use rand::seq::IndexedRandom;
use rand::{Rng, RngExt};

/// What an object looks like from every view, and which surface points each scan covers.
#[derive(Clone, Debug)]
pub struct ObjectViews {
    scans: Vec<Vec<[f32; 3]>>,
    covered: Vec<BitSet>,
    surface: usize,
}

/// A state of an episode, with what each view of the set would add.
#[derive(Clone, Debug, PartialEq)]
pub struct GainSample {
    /// The object.
    pub object: usize,
    /// Scans in the cloud, as indices of its views (the set first, then the extra ones).
    pub scans: Vec<usize>,
    /// Views of the set that count as used.
    pub used: Vec<bool>,
    /// New coverage of each view of the set, in [0, 1].
    pub gains: Vec<f32>,
}

impl ObjectViews {
    /// Scans the object from `views`. `samples` are surface samples; coverage is taken on their voxel average at the
    /// spacing of the first scan that has points. `None` where no view sees the object.
    pub fn scan(
        scene: &Scene,
        samples: &[Point3<f64>],
        views: &[View],
        camera: &PinholeCamera,
        render: &RenderConfig,
        tolerance: f64,
    ) -> Option<ObjectViews> {
        let scans: Vec<Vec<Point3<f64>>> = views
            .iter()
            .map(|view| {
                let pose = view.world_from_camera();
                scene.depth_image(camera, &pose, render).to_points(camera, &pose)
            })
            .collect();
        let first = scans.iter().find(|s| s.len() > 1)?;
        let grid_size = mean_spacing(first, &Neighborhoods::of(first, 2));
        let surface = reference_surface(samples, grid_size, Accumulate::Averaged);
        let covered = scans.iter().map(|scan| {
            let grid = NeighborGrid::new(scan, 2.0 * tolerance);
            BitSet::from_fn(surface.len(), |i| grid.any_within(&surface[i], tolerance))
        });
        let covered = covered.collect();
        let scans = scans.iter().map(|s| s.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect()).collect();
        Some(ObjectViews { scans, covered, surface: surface.len() })
    }

    /// Points of a scan, metres.
    pub fn scan_points(&self, view: usize) -> &[[f32; 3]] {
        &self.scans[view]
    }

    /// Share of the surface that these scans cover together.
    pub fn coverage(&self, scans: &[usize]) -> f64 {
        self.union(scans).count() as f64 / self.surface.max(1) as f64
    }

    fn union(&self, scans: &[usize]) -> BitSet {
        let mut union = BitSet::from_fn(self.surface, |_| false);
        scans.iter().for_each(|&s| union.add(&self.covered[s]));
        union
    }

    /// New coverage that each of the first `set` views would bring: the exact marginal gain.
    pub fn gains(&self, scans: &[usize], set: usize) -> Vec<f32> {
        let known = self.union(scans);
        let share = |v: usize| self.covered[v].count_without(&known) as f32 / self.surface.max(1) as f32;
        (0..set).map(share).collect()
    }
}

/// The states of an episode of `steps` decisions from scan `start` (a view of the set, or an extra view, which marks
/// the view of the set `nearest` to it as used). A decision takes the view of the largest gain, or with probability
/// `explore` any unused one.
pub fn episode_states(
    object: usize,
    views: &ObjectViews,
    set: usize,
    start: usize,
    nearest: usize,
    steps: usize,
    explore: f64,
    rng: &mut impl Rng,
) -> Vec<GainSample> {
    let mut scans = vec![start];
    let mut used = vec![false; set];
    used[nearest] = true;
    let mut states = Vec::with_capacity(steps);
    for _ in 0..steps {
        let gains = views.gains(&scans, set);
        let unused: Vec<usize> = (0..set).filter(|&v| !used[v]).collect();
        let greedy = crate::metrics::argmax(&gains);
        let next = if rng.random::<f64>() < explore { unused.choose(rng).copied().unwrap_or(greedy) } else { greedy };
        states.push(GainSample { object, scans: scans.clone(), used: used.clone(), gains });
        used[next] = true;
        scans.push(next);
    }
    states
}

/// Set of surface points.
#[derive(Clone, Debug, PartialEq)]
struct BitSet(Vec<u64>);

impl BitSet {
    fn from_fn(n: usize, has: impl Fn(usize) -> bool) -> BitSet {
        let mut words = vec![0u64; n.div_ceil(64)];
        (0..n).filter(|&i| has(i)).for_each(|i| words[i / 64] |= 1 << (i % 64));
        BitSet(words)
    }

    fn add(&mut self, other: &BitSet) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a |= b);
    }

    fn count(&self) -> usize {
        self.0.iter().map(|w| w.count_ones() as usize).sum()
    }

    fn count_without(&self, other: &BitSet) -> usize {
        self.0.iter().zip(&other.0).map(|(a, b)| (a & !b).count_ones() as usize).sum()
    }
}

#[cfg(test)]
mod tests;
