//! Voxels that past scans found free or on the surface, and the membrane that closes the surface in the unknown.

use crate::{Misses, PastScan, PointCloud, Seen};
use nalgebra::{Point3, Vector3};

/// Voxels along an axis are this many at most: 2 million voxels, 20 MB.
const MAX_SIDE: usize = 128;
/// Sweeps of the membrane per decision, and its over-relaxation.
const SWEEPS: usize = 40;
const OMEGA: f32 = 1.8;

/// What is known of a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Voxel {
    /// Never seen.
    Unknown,
    /// Seen through.
    Free,
    /// Holds measured points.
    Surface,
}

/// A cube of voxels.
#[derive(Clone, Debug)]
pub(super) struct VoxelGrid {
    /// Edge of a voxel, metres.
    pub(super) voxel: f64,
    /// Voxels along each axis.
    pub(super) side: usize,
    low: Point3<f64>,
    pub(super) state: Vec<Voxel>,
    /// Expected inside above 0.5, outside below.
    pub(super) chi: Vec<f32>,
    /// Sum of the cloud's normals per voxel.
    pub(super) normal: Vec<Vector3<f32>>,
    unknown: Vec<u32>,
}

impl VoxelGrid {
    pub(super) fn new(center: &Point3<f64>, half: f64, voxel: f64) -> Self {
        let voxel = voxel.max(2.0 * half / MAX_SIDE as f64);
        let side = ((2.0 * half / voxel).ceil() as usize).clamp(2, MAX_SIDE);
        let n = side.pow(3);
        let low = center - Vector3::repeat(side as f64 * voxel / 2.0);
        Self {
            voxel,
            side,
            low,
            state: vec![Voxel::Unknown; n],
            chi: vec![0.0; n],
            normal: vec![Vector3::zeros(); n],
            unknown: Vec::new(),
        }
    }

    /// The voxel that holds a point; `None` outside of the cube.
    pub(super) fn index(&self, p: &Point3<f64>) -> Option<usize> {
        let c = (p - self.low) / self.voxel;
        let side = self.side as f64;
        if !c.iter().all(|&x| x >= 0.0 && x < side) {
            return None;
        }
        Some((c.z as usize * self.side + c.y as usize) * self.side + c.x as usize)
    }

    /// Middle of a voxel.
    pub(super) fn center(&self, index: usize) -> Point3<f64> {
        let s = self.side;
        let cell = Vector3::new((index % s) as f64, (index / s % s) as f64, (index / (s * s)) as f64);
        self.low + (cell + Vector3::repeat(0.5)) * self.voxel
    }

    /// Takes in what a scan saw: free space along its rays, surface at their ends.
    pub(super) fn carve(&mut self, scan: &PastScan) {
        let margin = 0.75 * self.voxel;
        let points = match &scan.seen {
            Seen::Depth { camera, depth, misses } => {
                let camera_from_world = scan.world_from_camera.inverse();
                for i in 0..self.state.len() {
                    if self.state[i] != Voxel::Unknown {
                        continue;
                    }
                    let p = camera_from_world * self.center(i);
                    if p.z <= 0.0 {
                        continue;
                    }
                    let pixel = camera.project(&p);
                    let (u, v) = (pixel.x.round(), pixel.y.round());
                    if u < 0.0 || v < 0.0 || u >= f64::from(camera.width) || v >= f64::from(camera.height) {
                        continue;
                    }
                    let free = match depth.at(u as u32, v as u32) {
                        Some(z) => p.z < f64::from(z) - margin,
                        None => *misses == Misses::Free,
                    };
                    if free {
                        self.state[i] = Voxel::Free;
                    }
                }
                depth.to_points(camera, &scan.world_from_camera)
            }
            Seen::Points(points) => {
                let eye = Point3::from(scan.world_from_camera.translation.vector);
                for p in points {
                    let ray = p - eye;
                    let length = ray.norm();
                    if !(length > margin && length.is_finite()) {
                        continue;
                    }
                    // No farther back than the cube's diagonal.
                    let reach = length.min(2.0 * self.side as f64 * self.voxel);
                    let mut back = margin;
                    while back < reach {
                        if let Some(i) = self.index(&(p - ray * (back / length)))
                            && self.state[i] == Voxel::Unknown
                        {
                            self.state[i] = Voxel::Free;
                        }
                        back += 0.5 * self.voxel;
                    }
                }
                points.clone()
            }
        };
        for i in points.iter().filter_map(|p| self.index(p)).collect::<Vec<_>>() {
            self.state[i] = Voxel::Surface;
        }
    }

    /// Takes the accumulated cloud's normals, and prepares the membrane: inside right behind the cloud.
    pub(super) fn set_cloud(&mut self, cloud: &PointCloud) {
        self.normal.fill(Vector3::zeros());
        let mut inside = vec![false; self.state.len()];
        for (p, n) in cloud.points.iter().zip(&cloud.normals) {
            let Some(n) = n.try_normalize(0.0) else { continue };
            if let Some(i) = self.index(p) {
                self.state[i] = Voxel::Surface;
                self.normal[i] += n.cast::<f32>();
            }
            if let Some(i) = self.index(&(p - n * (1.5 * self.voxel))) {
                inside[i] = true;
            }
        }
        self.unknown.clear();
        for i in 0..self.state.len() {
            match self.state[i] {
                Voxel::Free => self.chi[i] = 0.0,
                Voxel::Surface => self.chi[i] = 0.5,
                Voxel::Unknown if inside[i] => self.chi[i] = 1.0,
                Voxel::Unknown => self.unknown.push(i as u32),
            }
        }
    }

    /// Relaxes the membrane from where it was; outside of the cube it is 0.
    pub(super) fn relax(&mut self) {
        let unknown = std::mem::take(&mut self.unknown);
        let s = self.side;
        let sweep = |chi: &mut [f32], i: usize| {
            let (x, y, z) = (i % s, i / s % s, i / (s * s));
            let mut sum = 0.0;
            for (at, step) in [(x, 1), (y, s), (z, s * s)] {
                sum += if at > 0 { chi[i - step] } else { 0.0 };
                sum += if at + 1 < s { chi[i + step] } else { 0.0 };
            }
            chi[i] += OMEGA * (sum / 6.0 - chi[i]);
        };
        for round in 0..SWEEPS {
            if round % 2 == 0 {
                unknown.iter().for_each(|&i| sweep(&mut self.chi, i as usize));
            } else {
                unknown.iter().rev().for_each(|&i| sweep(&mut self.chi, i as usize));
            }
        }
        self.unknown = unknown;
    }

    /// Number of unknown voxels in which the membrane passes.
    pub(super) fn expected_surface(&self) -> usize {
        let s = self.side;
        let passes = |&&i: &&u32| {
            let i = i as usize;
            let (x, y, z) = (i % s, i / s % s, i / (s * s));
            self.chi[i] > 0.5
                && [(x, 1), (y, s), (z, s * s)]
                    .iter()
                    .any(|&(at, step)| (at > 0 && self.chi[i - step] < 0.5) || (at + 1 < s && self.chi[i + step] < 0.5))
        };
        self.unknown.iter().filter(passes).count()
    }
}
