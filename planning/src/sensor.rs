//! What a depth camera can measure: how near, how far, how flat; and the pixels that it makes up at edges.

use crate::config::ConfigError;
use geometry::{DepthImage, PinholeCamera};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Limits of the sensor, each off by default. Distances are from the camera to the surface, along the ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorConfig {
    /// Nearest surface that it measures, metres.
    pub min_range_m: Option<f64>,
    /// Farthest surface that it measures, metres.
    pub max_range_m: Option<f64>,
    /// Largest angle between a ray and the normal of the surface under which it still measures: 0 is head-on.
    pub max_incidence_deg: Option<f64>,
    /// Leave out pixels of depth images in the middle of a jump, between a nearer and a farther neighbour: made up of both.
    pub drop_mixed_pixels: bool,
}

/// A pixel that is deeper than one neighbour and less deep than the one opposite by this many pixels' widths at its distance is
/// mixed: a surface would be met at 83 degrees.
const JUMP: f64 = 8.0;

/// What was done with the pixels of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Dropped {
    pub range: usize,
    pub mixed: usize,
}

impl SensorConfig {
    /// Whether it limits where surface is measured from.
    pub fn is_limited(&self) -> bool {
        self.min_range_m.is_some() || self.max_range_m.is_some() || self.max_incidence_deg.is_some()
    }

    /// Nearest and farthest distance, metres.
    pub fn range(&self) -> [f64; 2] {
        [self.min_range_m.unwrap_or(0.0), self.max_range_m.unwrap_or(f64::INFINITY)]
    }

    /// Whether a surface at this distance is measured.
    pub fn reaches(&self, distance: f64) -> bool {
        let [near, far] = self.range();
        distance >= near && distance <= far
    }

    /// Least cosine between the ray and the normal of what is measured; 0 where there is no limit.
    pub fn least_cosine(&self) -> f64 {
        self.max_incidence_deg.map_or(0.0, |angle| angle.to_radians().cos())
    }

    /// Whether surface with this normal (any length; zero: unknown) at `p` is measured from `eye`.
    pub fn measures(&self, eye: &Point3<f64>, p: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let ray = eye - p;
        let (distance, length) = (ray.norm(), normal.norm());
        let flat = length > 0.0 && ray.dot(normal) < self.least_cosine() * distance * length;
        self.reaches(distance) && !(flat && self.max_incidence_deg.is_some())
    }

    /// Refuses values without a meaning.
    ///
    /// # Errors
    /// The first key out of range, with what it must be.
    pub fn check(&self, distances: &[f64]) -> Result<(), ConfigError> {
        let wrong = |key, found: String, expected| Err(ConfigError { key, found, expected });
        for (key, value) in [("sensor.min_range_m", self.min_range_m), ("sensor.max_range_m", self.max_range_m)] {
            if let Some(value) = value.filter(|x| !(x.is_finite() && *x > 0.0)) {
                return wrong(key, value.to_string(), "a positive number of metres");
            }
        }
        let [near, far] = self.range();
        if near >= far {
            return wrong("sensor.max_range_m", far.to_string(), "more than sensor.min_range_m");
        }
        if let Some(angle) = self.max_incidence_deg.filter(|a| !(*a > 0.0 && *a <= 90.0)) {
            return wrong("sensor.max_incidence_deg", angle.to_string(), "more than 0, 90 at most");
        }
        match distances.iter().find(|d| !self.reaches(**d)) {
            Some(distance) => wrong(
                "working_distance_m",
                format!("{distance} with a sensor that measures from {near} to {far} m"),
                "a distance that the sensor measures at (--distance, sensor.min_range_m, sensor.max_range_m)",
            ),
            None => Ok(()),
        }
    }

    /// Takes out of an image what the sensor cannot have measured, or made up: not a number stands there then, so that nobody
    /// takes it for a miss.
    pub(crate) fn clean(&self, image: &mut DepthImage, camera: &PinholeCamera) -> Dropped {
        let mut dropped = Dropped::default();
        let columns = image.size[0] as usize;
        if columns == 0 {
            return dropped;
        }
        if self.drop_mixed_pixels {
            let mixed = mixed_pixels(image, camera);
            dropped.mixed = mixed.len();
            mixed.into_iter().for_each(|i| image.depth[i] = f32::NAN);
        }
        if self.min_range_m.is_some() || self.max_range_m.is_some() {
            for (i, z) in image.depth.iter_mut().enumerate().filter(|(_, z)| **z > 0.0) {
                let (column, row) = (image.origin[0] as usize + i % columns, image.origin[1] as usize + i / columns);
                let ray = camera.unproject(column as f64, row as f64, f64::from(*z));
                if !self.reaches(ray.coords.norm()) {
                    *z = f32::NAN;
                    dropped.range += 1;
                }
            }
        }
        dropped
    }
}

/// Pixels in the middle of a jump, along a row or a column.
fn mixed_pixels(image: &DepthImage, camera: &PinholeCamera) -> Vec<usize> {
    let [columns, rows] = image.size.map(|n| n as usize);
    let depth = |i: usize| Some(f64::from(image.depth[i])).filter(|z| *z > 0.0);
    let mixed = |i: usize| {
        let Some(z) = depth(i) else { return false };
        let least = JUMP * camera.pixel_size(z);
        let between = |one: usize, other: usize| match (depth(one), depth(other)) {
            (Some(a), Some(b)) => a.min(b) < z - least && a.max(b) > z + least,
            _ => false,
        };
        let (column, row) = (i % columns, i / columns);
        (column > 0 && column + 1 < columns && between(i - 1, i + 1))
            || (row > 0 && row + 1 < rows && between(i - columns, i + columns))
    };
    (0..image.depth.len()).filter(|&i| mixed(i)).collect()
}

#[cfg(test)]
mod tests;
