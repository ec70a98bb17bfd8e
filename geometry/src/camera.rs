//! The pinhole camera and its depth image (docs/method.md, 'Setting').

use nalgebra::{Isometry3, Point2, Point3};

/// Pinhole intrinsics in pixels; pixel (column, row) is sampled at its integer coordinate.
///
/// ```
/// use geometry::PinholeCamera;
/// use nalgebra::Point3;
///
/// let camera = PinholeCamera::from_fov_y(1280, 720, 70f64.to_radians());
/// let pixel = camera.project(&Point3::new(0.1, 0.0, 1.2));
/// let point = camera.unproject(pixel.x, pixel.y, 1.2);
/// assert!((point - Point3::new(0.1, 0.0, 1.2)).norm() < 1e-12);
/// println!("{:.2} mm per pixel at 1.2 m", 1e3 * camera.pixel_size(1.2));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PinholeCamera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Horizontal focal length in pixels.
    pub fx: f64,
    /// Vertical focal length in pixels.
    pub fy: f64,
    /// Column of the principal point.
    pub cx: f64,
    /// Row of the principal point.
    pub cy: f64,
}

impl Default for PinholeCamera {
    /// The paper's camera: 1280 x 720, vertical field of view 70 degrees.
    fn default() -> Self {
        Self::from_fov_y(1280, 720, 70f64.to_radians())
    }
}

impl PinholeCamera {
    /// Square pixels, principal point in the centre, vertical field of view in radians.
    pub fn from_fov_y(width: u32, height: u32, fov_y: f64) -> Self {
        let f = f64::from(height) / 2.0 / (fov_y / 2.0).tan();
        Self { width, height, fx: f, fy: f, cx: f64::from(width) / 2.0, cy: f64::from(height) / 2.0 }
    }

    /// Pixel coordinates (column, row) of a point in the camera frame with z > 0.
    pub fn project(&self, p: &Point3<f64>) -> Point2<f64> {
        Point2::new(self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy)
    }

    /// Point in the camera frame at pixel (column, row) and depth z.
    pub fn unproject(&self, column: f64, row: f64, z: f64) -> Point3<f64> {
        Point3::new((column - self.cx) * z / self.fx, (row - self.cy) * z / self.fy, z)
    }

    /// The camera and the four corners of the image at this depth, camera frame.
    pub fn frustum(&self, depth: f64) -> [Point3<f64>; 5] {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let at = |column: f64, row: f64| self.unproject(column, row, depth);
        [Point3::origin(), at(0.0, 0.0), at(width, 0.0), at(width, height), at(0.0, height)]
    }

    /// Size of a pixel on a surface that faces the camera at this depth, in metres.
    pub fn pixel_size(&self, depth: f64) -> f64 {
        depth / self.fx.min(self.fy)
    }
}

/// What [`check_intrinsics`] expects.
pub const INTRINSICS: &str = "fx, fy, cx, cy in pixels: finite, fx and fy positive";

/// Gives back fx, fy, cx, cy in pixels if a camera can have them. The principal point may lie outside of the image, as in one
/// that was cut out of a larger one.
///
/// # Errors
/// What is found instead of [`INTRINSICS`].
pub fn check_intrinsics(intrinsics: [f64; 4]) -> Result<[f64; 4], String> {
    let [fx, fy, ..] = intrinsics;
    match fx > 0.0 && fy > 0.0 && intrinsics.iter().all(|x| x.is_finite()) {
        true => Ok(intrinsics),
        false => Err(format!("fx, fy, cx, cy = {intrinsics:?}")),
    }
}

/// Depth along +Z in metres, 0 where the ray returned nothing, not a number where it is not known what it met (measured, and not
/// believed). Only a window of the image is stored; every
/// pixel outside it returned nothing (an object of 0.2 m spans 86 of 1280 pixels at 1.2 m).
///
/// ```
/// use geometry::{DepthImage, PinholeCamera};
/// use nalgebra::Isometry3;
///
/// let camera = PinholeCamera::from_fov_y(4, 2, 1.0);
/// let image = DepthImage { origin: [0, 0], size: [4, 2], depth: vec![0.5, 0.5, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5] };
/// assert_eq!((image.at(0, 0), image.at(2, 0)), (Some(0.5), None));
/// assert_eq!(image.to_points(&camera, &Isometry3::identity()).len(), 7);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthImage {
    /// First column and row of the window in the full image.
    pub origin: [u32; 2],
    /// Columns and rows of the window.
    pub size: [u32; 2],
    /// Row-major, `size[0] * size[1]` values.
    pub depth: Vec<f32>,
}

impl DepthImage {
    /// Depth at a pixel of the full image, `None` where nothing returned.
    pub fn at(&self, column: u32, row: u32) -> Option<f32> {
        let (c, r) = (column.checked_sub(self.origin[0])?, row.checked_sub(self.origin[1])?);
        if c >= self.size[0] || r >= self.size[1] {
            return None;
        }
        let z = self.depth[(r * self.size[0] + c) as usize];
        (z > 0.0).then_some(z)
    }

    /// Shrinks the window to the smallest that holds all pixels with a return; to nothing if there is none.
    pub fn crop(&mut self) {
        let [columns, rows] = self.size.map(|s| s as usize);
        let (mut first, mut last) = ([columns, rows], [0, 0]);
        for (i, _) in self.depth.iter().enumerate().filter(|&(_, &z)| z > 0.0) {
            let at = [i % columns, i / columns];
            first = [0, 1].map(|k| first[k].min(at[k]));
            last = [0, 1].map(|k| last[k].max(at[k] + 1));
        }
        if last == [0, 0] {
            *self = Self::default();
            return;
        }
        let kept = (first[1]..last[1]).flat_map(|row| row * columns + first[0]..row * columns + last[0]);
        self.depth = kept.map(|i| self.depth[i]).collect();
        self.origin = [0, 1].map(|k| self.origin[k] + first[k] as u32);
        self.size = [0, 1].map(|k| (last[k] - first[k]) as u32);
    }

    /// World points of all pixels with a return, in row-major order.
    pub fn to_points(&self, camera: &PinholeCamera, world_from_camera: &Isometry3<f64>) -> Vec<Point3<f64>> {
        let mut points = Vec::new();
        self.for_each_point(camera, world_from_camera, |p| points.push(p));
        points
    }

    /// Calls `visit` with each of the points of [`DepthImage::to_points`], in their order.
    pub fn for_each_point(
        &self,
        camera: &PinholeCamera,
        world_from_camera: &Isometry3<f64>,
        mut visit: impl FnMut(Point3<f64>),
    ) {
        let rotation = world_from_camera.rotation.to_rotation_matrix();
        let center = Point3::from(world_from_camera.translation.vector);
        let columns = self.size[0] as usize;
        for (row, depths) in self.depth.chunks_exact(columns.max(1)).enumerate() {
            let row = f64::from(self.origin[1]) + row as f64;
            for (column, &z) in depths.iter().enumerate().filter(|&(_, &z)| z > 0.0) {
                let column = f64::from(self.origin[0]) + column as f64;
                visit(center + rotation * camera.unproject(column, row, f64::from(z)).coords);
            }
        }
    }
}

#[cfg(test)]
mod tests;
