//! Organised clouds are depth images where their pixels prove a pinhole camera.

use formats::cloud::{CloudFile, Grid};
use geometry::{DepthImage, PinholeCamera};
use nalgebra::{Isometry3, Point3, Vector2};
use planning::{NoReturn, Scan};

/// An organised cloud as the depth image that it is.
pub(super) struct Organised {
    camera: PinholeCamera,
    depth: DepthImage,
    /// The camera's pose in the frame of the points: that of the file, or the identity.
    pub pose: Isometry3<f64>,
}

impl Organised {
    /// `None` where the pixels prove no camera.
    pub fn of(file: &CloudFile) -> Option<Self> {
        let grid = file.grid.as_ref()?;
        let mut poses = file.viewpoint.into_iter().chain([Isometry3::identity()]);
        poses.find_map(|pose| {
            let (camera, depth) = depth_of_organised(&file.cloud.points, grid, &pose)?;
            Some(Self { camera, depth, pose })
        })
    }

    /// Whether the points are in their sensor's own frame.
    pub fn in_sensor_frame(&self) -> bool {
        self.pose == Isometry3::identity()
    }

    /// The scan of this pose. Sensors that write organised clouds leave out what they failed on, too.
    pub fn scan(self, world_from_camera: Isometry3<f64>) -> Scan {
        Scan::Depth { camera: self.camera, depth: self.depth, world_from_camera, misses: NoReturn::Unknown }
    }
}

/// The pinhole camera that maps every point of an organised cloud onto its pixel, seen from `world_from_camera`, and
/// the depth image; `None` where no such camera does within a pixel (a scanner with another geometry, or another
/// frame).
fn depth_of_organised(
    points: &[Point3<f64>],
    grid: &Grid,
    world_from_camera: &Isometry3<f64>,
) -> Option<(PinholeCamera, DepthImage)> {
    if points.len() < 100 || grid.width < 2 || grid.height < 2 {
        return None;
    }
    let camera_from_world = world_from_camera.inverse();
    let local: Vec<Point3<f64>> = points.iter().map(|p| camera_from_world * p).collect();
    if local.iter().any(|p| p.z <= 0.0) {
        return None;
    }
    let pixel = |i: usize| (grid.pixels[i] as usize % grid.width, grid.pixels[i] as usize / grid.width);
    let columns = (0..local.len()).map(|i| Vector2::new(local[i].x / local[i].z, pixel(i).0 as f64));
    let rows = (0..local.len()).map(|i| Vector2::new(local[i].y / local[i].z, pixel(i).1 as f64));
    let (fx, cx) = line_through(columns)?;
    let (fy, cy) = line_through(rows)?;
    let camera = PinholeCamera { width: grid.width as u32, height: grid.height as u32, fx, fy, cx, cy };
    let mut depth = vec![0.0; grid.width * grid.height];
    for (i, p) in local.iter().enumerate() {
        let (column, row) = pixel(i);
        let projected = camera.project(p);
        if (projected.x - column as f64).abs() > 1.0 || (projected.y - row as f64).abs() > 1.0 {
            return None;
        }
        depth[grid.pixels[i] as usize] = p.z as f32;
    }
    Some((camera, DepthImage { origin: [0, 0], size: [camera.width, camera.height], depth }))
}

/// Slope and intercept of y over x by least squares; `None` unless the slope is a positive number.
fn line_through(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<(f64, f64)> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<Vector2<f64>>() / count;
    let (xx, xy) = points.fold((0.0, 0.0), |(xx, xy), p| {
        let d = p - mean;
        (xx + d.x * d.x, xy + d.x * d.y)
    });
    let slope = xy / xx;
    (slope.is_finite() && slope > 0.0).then(|| (slope, mean.y - slope * mean.x))
}
