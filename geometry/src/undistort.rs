//! Depth images as a pinhole camera would have taken them.

use crate::lens::{Lens, WIDEST};
use crate::{DepthImage, PinholeCamera};
use nalgebra::Vector2;

/// Most pixels of an undistorted image, as many times those of its source.
const GROWTH: f64 = 4.0;
/// Neighbours in depth within this many pixels' widths at their distance are one surface: seen at up to 79 degrees.
const SAME_SURFACE: f64 = 5.0;

/// A depth image without its distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct Undistorted {
    /// Its pinhole camera: the same focal length, the image as large as its rays need.
    pub camera: PinholeCamera,
    /// Depths along +Z.
    pub image: DepthImage,
    /// Pixels with a return that look farther off the axis than a pinhole image shows, or where the model says nothing.
    pub left_out: usize,
}

/// Puts each pixel of a depth image of this camera and lens where a pinhole camera has it. Where the four pixels around a ray are of
/// one surface, depth is interpolated as planes have it (1 / z is linear in the image); across a jump, or beside a pixel without a
/// return, the nearest pixel is taken: none is ever made up between two surfaces.
pub fn undistort_depth(image: &DepthImage, camera: &PinholeCamera, lens: &Lens) -> Undistorted {
    if lens.is_pinhole() {
        return Undistorted { camera: *camera, image: image.clone(), left_out: 0 };
    }
    let ray_of = |column: f64, row: f64| {
        let at = Vector2::new((column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy);
        lens.undistort(at).filter(|ray| ray.norm() < WIDEST.tan())
    };
    let mut left_out = 0;
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut hold = |ray: Vector2<f64>| {
        for k in 0..2 {
            low[k] = low[k].min(ray[k]);
            high[k] = high[k].max(ray[k]);
        }
    };
    // The edge, whether it returned anything or not: a miss tells something too.
    let (last_column, last_row) = (camera.width - 1, camera.height - 1);
    for column in 0..camera.width {
        [0, last_row].into_iter().filter_map(|row| ray_of(f64::from(column), f64::from(row))).for_each(&mut hold);
    }
    for row in 0..camera.height {
        [0, last_column].into_iter().filter_map(|column| ray_of(f64::from(column), f64::from(row))).for_each(&mut hold);
    }
    let columns = image.size[0].max(1);
    for (i, _) in image.depth.iter().enumerate().filter(|(_, z)| **z > 0.0) {
        let (column, row) = (image.origin[0] + i as u32 % columns, image.origin[1] + i as u32 / columns);
        match ray_of(f64::from(column), f64::from(row)) {
            Some(ray) => hold(ray),
            None => left_out += 1,
        }
    }
    if !low[0].is_finite() {
        return Undistorted { camera: *camera, image: DepthImage::default(), left_out };
    }
    // A focal length that the image and the lens do not fit would make one side endless.
    let longest = GROWTH * f64::from(camera.width.max(camera.height));
    let focal = [camera.fx, camera.fy];
    let focal = [0, 1].map(|k| focal[k].min(longest / (high[k] - low[k]).max(f64::MIN_POSITIVE)));
    let extent = [0, 1].map(|k| (high[k] - low[k]) * focal[k] + 1.0);
    let most = GROWTH * f64::from(camera.width) * f64::from(camera.height);
    let shrink = (most / (extent[0].ceil() * extent[1].ceil())).sqrt().min(1.0);
    let focal = focal.map(|f| f * shrink);
    let first = [0, 1].map(|k| (low[k] * focal[k]).floor());
    let size = [0, 1].map(|k| ((high[k] * focal[k]).ceil() - first[k]) as u32 + 1);
    let pinhole =
        PinholeCamera { width: size[0], height: size[1], fx: focal[0], fy: focal[1], cx: -first[0], cy: -first[1] };
    let mut depth = Vec::with_capacity(size[0] as usize * size[1] as usize);
    for row in 0..size[1] {
        for column in 0..size[0] {
            let ray = pinhole.unproject(f64::from(column), f64::from(row), 1.0);
            let at = lens.distort(Vector2::new(ray.x, ray.y));
            // Beyond where the model turns back, other rays would show a second time.
            let own = lens.rises_to(ray.coords.xy());
            let (u, v) = (camera.fx * at.x + camera.cx, camera.fy * at.y + camera.cy);
            depth.push(if own { sample(image, camera, u, v) } else { f32::NAN });
        }
    }
    let image = DepthImage { origin: [0, 0], size, depth };
    Undistorted { camera: pinhole, image, left_out }
}

/// Depth at a place between pixels; not a number where the image does not reach.
fn sample(image: &DepthImage, camera: &PinholeCamera, u: f64, v: f64) -> f32 {
    // No farther than the middles of the outermost pixels: nothing is drawn out beyond what was measured.
    let inside = |x: f64, size: u32| x > -1e-6 && x < f64::from(size - 1) + 1e-6;
    if !(inside(u, camera.width) && inside(v, camera.height)) {
        return f32::NAN;
    }
    // At the last row and column between the last two.
    let first = |x: f64, size: u32| x.floor().min(f64::from(size) - 2.0).max(0.0);
    let (left, top) = (first(u, camera.width), first(v, camera.height));
    let at = |dx: u32, dy: u32| image.at(left as u32 + dx, top as u32 + dy).map(f64::from);
    let nearest = || raw(image, u.round().max(0.0) as u32, v.round().max(0.0) as u32);
    let (Some(a), Some(b), Some(c), Some(d)) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1)) else { return nearest() };
    let around = [a, b, c, d];
    let (near, far) =
        (around.iter().copied().fold(f64::INFINITY, f64::min), around.iter().copied().fold(0.0, f64::max));
    if far - near > SAME_SURFACE * camera.pixel_size(near) {
        return nearest();
    }
    let (x, y) = ((u - left).clamp(0.0, 1.0), (v - top).clamp(0.0, 1.0));
    let inverse = (1.0 - y) * ((1.0 - x) / a + x / b) + y * ((1.0 - x) / c + x / d);
    inverse.recip() as f32
}

/// As it stands: 0 is a miss, not a number where nothing is known.
fn raw(image: &DepthImage, column: u32, row: u32) -> f32 {
    let (Some(c), Some(r)) = (column.checked_sub(image.origin[0]), row.checked_sub(image.origin[1])) else {
        return 0.0;
    };
    if c >= image.size[0] || r >= image.size[1] { 0.0 } else { image.depth[(r * image.size[0] + c) as usize] }
}

#[cfg(test)]
mod tests;
