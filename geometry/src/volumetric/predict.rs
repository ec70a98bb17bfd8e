//! What a view would see, by marching through the voxels.

use super::grid::{Voxel, VoxelGrid};
use crate::neighbors::NeighborGrid;
use crate::{PinholeCamera, PointCloud, View};
use nalgebra::{Point3, Vector3};

/// Every second pixel of every second row is followed.
const STRIDE: u32 = 2;

/// Share of the surface in each surface voxel that the cloud covers within the tolerance.
pub(super) struct SampledSurface(Vec<f32>);

impl SampledSurface {
    /// From eight samples in the tangent plane around each cloud point.
    pub(super) fn new(grid: &VoxelGrid, cloud: &PointCloud, tolerance: f64) -> Self {
        let neighbors = NeighborGrid::new(&cloud.points, 2.0 * tolerance);
        let mut counts = vec![[0u32; 2]; grid.state.len()];
        for (p, n) in cloud.points.iter().zip(&cloud.normals) {
            let Some(n) = n.try_normalize(0.0) else { continue };
            let any = if n.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
            let a = n.cross(&any).normalize();
            let b = n.cross(&a);
            for k in 0..8 {
                let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
                let sample = p + (a * cos + b * sin) * (1.1 * tolerance);
                if let Some(i) = grid.index(&sample).filter(|&i| grid.state[i] == Voxel::Surface) {
                    counts[i][0] += 1;
                    counts[i][1] += u32::from(neighbors.any_within(&sample, tolerance));
                }
            }
        }
        Self(counts.iter().map(|&[all, near]| if all == 0 { 1.0 } else { near as f32 / all as f32 }).collect())
    }
}

/// Pixels that a view expects, by what they show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forecast {
    pub(super) view: View,
    /// Rays that enter unknown space before they meet surface.
    pub(super) hidden: f64,
    /// Those of them that meet the membrane there.
    pub(super) expected: f64,
    known: f64,
    known_behind: f64,
    covered: f64,
}

impl Forecast {
    /// Expected overlap; `None` where nothing is expected to be seen.
    pub(super) fn overlap(&self) -> Option<f64> {
        let seen = self.known + self.known_behind + self.expected;
        (seen > 0.0).then(|| (1.07 * self.covered / seen).min(1.0))
    }
}

/// Follows the view's rays through the grid.
pub(super) fn forecast(grid: &VoxelGrid, surface: &SampledSurface, camera: &PinholeCamera, view: View) -> Forecast {
    let mut forecast = Forecast { view, hidden: 0.0, expected: 0.0, known: 0.0, known_behind: 0.0, covered: 0.0 };
    if !view.is_valid() {
        return forecast;
    }
    let pose = view.world_from_camera();
    let half = grid.side as f64 * grid.voxel / 2.0;
    let middle = grid.center(0) + Vector3::repeat(half - grid.voxel / 2.0);
    let local = pose.inverse() * middle;
    let radius = half * 3f64.sqrt();
    // The cube's ball on the screen, or the whole image where the camera is inside of it.
    let (columns, rows) = if local.z > 1.05 * radius {
        let at = camera.project(&local);
        let reach = camera.fx.max(camera.fy) * radius / (local.z - radius);
        let range = |center: f64, size: u32| {
            ((center - reach).max(0.0) as u32, (center + reach).clamp(0.0, f64::from(size)) as u32)
        };
        (range(at.x, camera.width), range(at.y, camera.height))
    } else {
        ((0, camera.width), (0, camera.height))
    };
    let rotation = pose.rotation.to_rotation_matrix();
    let pixels = f64::from(STRIDE * STRIDE);
    for row in (rows.0..rows.1).step_by(STRIDE as usize) {
        for column in (columns.0..columns.1).step_by(STRIDE as usize) {
            let ray = camera.unproject(f64::from(column), f64::from(row), 1.0).coords.normalize();
            follow(grid, surface, &view.position, &(rotation * ray), &middle, half, pixels, &mut forecast);
        }
    }
    forecast
}

fn follow(
    grid: &VoxelGrid,
    surface: &SampledSurface,
    eye: &Point3<f64>,
    ray: &Vector3<f64>,
    middle: &Point3<f64>,
    half: f64,
    pixels: f64,
    forecast: &mut Forecast,
) {
    let (mut enter, mut leave) = (0f64, f64::MAX);
    for k in 0..3 {
        let (a, b) = ((middle[k] - half - eye[k]) / ray[k], (middle[k] + half - eye[k]) / ray[k]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    let step = 0.75 * grid.voxel;
    let mut hidden = false;
    let mut t = enter + 0.5 * step;
    while t < leave {
        let Some(i) = grid.index(&(eye + ray * t)) else { return };
        t += step;
        match grid.state[i] {
            Voxel::Free => {}
            Voxel::Surface => {
                if grid.normal[i].dot(&ray.cast::<f32>()) < 0.0 {
                    let counter = if hidden { &mut forecast.known_behind } else { &mut forecast.known };
                    *counter += pixels;
                    forecast.covered += pixels * f64::from(surface.0[i]);
                }
                return;
            }
            Voxel::Unknown => {
                if !hidden {
                    hidden = true;
                    forecast.hidden += pixels;
                }
                if grid.chi[i] > 0.5 {
                    forecast.expected += pixels;
                    return;
                }
            }
        }
    }
}
