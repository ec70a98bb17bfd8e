//! Directions in which a scan met something that was left out of it: they show no background.

use super::SMALLEST_M;
use crate::{PastScan, Seen};
use nalgebra::{Isometry3, Point3};

/// Cells along an axis at most, and the smallest, in x / z.
const MAX_CELLS: usize = 512;
const FINEST: f64 = 1e-5;
/// Points this far off the axis, in x / z or y / z (75 degrees), would make all cells coarse.
const WIDEST: f64 = 3.7;

/// A point that was measured and is not used.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LeftOut {
    pub point: Point3<f64>,
    /// Whether there is something, so that the ray is free up to it.
    pub believed: bool,
}

/// How far the rays of a cloud's camera are known to be free where the points that they met were left out. In its own frame, so that it
/// moves with the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Veil {
    /// Coordinates of the first cell's corner in x / z and y / z, and cells per unit of them.
    corner: [f64; 2],
    scale: f64,
    size: [usize; 2],
    /// Along the axis, metres; infinite where nothing was left out.
    free_to: Vec<f32>,
}

impl Veil {
    /// Of a cloud with these points, in cells as wide as all points are apart, and over the cells around each; `None` where nothing was left
    /// out before the camera.
    pub(crate) fn of(world_from_camera: &Isometry3<f64>, used: &[Point3<f64>], left_out: &[LeftOut]) -> Option<Self> {
        let camera_from_world = world_from_camera.inverse();
        let look = |p: &Point3<f64>| {
            let p = camera_from_world * p;
            let direction = [p.x / p.z, p.y / p.z];
            (p.z > SMALLEST_M && direction.iter().all(|x| x.abs() < WIDEST)).then_some((direction, p.z))
        };
        let ends = left_out.iter().filter_map(|one| {
            let (direction, z) = look(&one.point)?;
            Some((direction, if one.believed { z as f32 } else { 0.0 }))
        });
        let veiled: Vec<([f64; 2], f32)> = ends.collect();
        let [from, to] = extent(veiled.iter().map(|(direction, _)| direction))?;
        let beside = used.iter().filter_map(|p| Some(look(p)?.0));
        let all: Vec<[f64; 2]> = beside.chain(veiled.iter().map(|(direction, _)| *direction)).collect();
        let [first, last] = extent(all.iter())?;
        let widest = (to[0] - from[0]).max(to[1] - from[1]);
        let cell = pitch(&all, first, last).max(widest / MAX_CELLS as f64).max(FINEST);
        let (scale, corner) = (1.0 / cell, [0, 1].map(|k| from[k] - 2.0 * cell));
        let size = [0, 1].map(|k| ((to[k] - from[k]) * scale + 5.0).ceil() as usize);
        let mut veil = Self { corner, scale, size, free_to: vec![f32::INFINITY; size[0] * size[1]] };
        for (direction, z) in veiled {
            for i in cells(veil.cell(direction), size, 1) {
                veil.free_to[i] = veil.free_to[i].min(z);
            }
        }
        Some(veil)
    }

    /// Bytes held.
    pub(crate) fn memory(&self) -> usize {
        size_of::<f32>() * self.free_to.len()
    }

    fn cell(&self, direction: [f64; 2]) -> [i64; 2] {
        [0, 1].map(|k| whole((direction[k] - self.corner[k]) * self.scale))
    }
}

impl PastScan {
    /// Whether this direction (x / z, y / z), or one within so many pixels or cells, met something that was left out, before `z` metres
    /// along the axis: it is not known what is there.
    pub(crate) fn hides(&self, direction: [f64; 2], z: f64, around: i64) -> bool {
        match (&self.seen, &self.veil) {
            (Seen::Depth { camera, depth, .. }, _) => {
                let [u, v] = [camera.fx * direction[0] + camera.cx, camera.fy * direction[1] + camera.cy];
                let [x0, y0] = depth.origin.map(i64::from);
                let pixel = [whole(u + 0.5) - x0, whole(v + 0.5) - y0];
                cells(pixel, depth.size.map(|n| n as usize), around).any(|i| depth.depth[i].is_nan())
            }
            (Seen::Points(_), Some(veil)) => {
                cells(veil.cell(direction), veil.size, around).any(|i| f64::from(veil.free_to[i]) <= z)
            }
            (Seen::Points(_), None) => false,
        }
    }

    /// Whether there is such a direction.
    pub(crate) fn hides_any(&self) -> bool {
        match &self.seen {
            Seen::Depth { depth, .. } => depth.depth.iter().any(|z| z.is_nan()),
            Seen::Points(_) => self.veil.is_some(),
        }
    }
}

/// How far apart the directions would be if they were spread evenly over the cells that they fill.
pub(crate) fn pitch(directions: &[[f64; 2]], from: [f64; 2], to: [f64; 2]) -> f64 {
    const COARSE: usize = 24;
    let step = ((to[0] - from[0]).max(to[1] - from[1]) / COARSE as f64).max(f64::MIN_POSITIVE);
    let cell = |d: &[f64; 2]| [0, 1].map(|k| (((d[k] - from[k]) / step) as usize).min(COARSE - 1));
    let mut filled = vec![false; COARSE * COARSE];
    directions.iter().map(cell).for_each(|[x, y]| filled[y * COARSE + x] = true);
    let area = filled.iter().filter(|f| **f).count() as f64 * step * step;
    (area / directions.len().max(1) as f64).sqrt()
}

/// Smallest and largest coordinates; `None` of none.
fn extent<'a>(directions: impl Iterator<Item = &'a [f64; 2]>) -> Option<[[f64; 2]; 2]> {
    directions
        .map(|d| [*d, *d])
        .reduce(|[low, high], [d, _]| [[0, 1].map(|k| low[k].min(d[k])), [0, 1].map(|k| high[k].max(d[k]))])
}

/// Rounded down; far from any image alike.
fn whole(x: f64) -> i64 {
    x.floor().clamp(-1e9, 1e9) as i64
}

/// Places, row after row, of the cells within `around` of one along both axes.
fn cells([x, y]: [i64; 2], [columns, rows]: [usize; 2], around: i64) -> impl Iterator<Item = usize> {
    let within = |at: i64, count: usize| {
        let count = count as i64;
        (at - around).clamp(0, count) as usize..(at + around + 1).clamp(0, count) as usize
    };
    let (across, down) = (within(x, columns), within(y, rows));
    down.flat_map(move |y| across.clone().map(move |x| y * columns + x))
}

#[cfg(test)]
mod tests;
