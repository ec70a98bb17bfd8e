//! Noise of a depth sensor, off by default: axial noise that grows with depth squared, lateral jitter, and
//! drop-outs at grazing angles and at depth edges (the model of structured-light and stereo sensors, e.g.
//! Nguyen, Izadi and Lovell 2012; Barron and Malik 2013 for the jitter).

use geometry::{DepthImage, PinholeCamera, rng};
use nalgebra::{Isometry3, Vector3};
use rand::RngExt;
use rand_distr::StandardNormal;

/// Settings of the sensor noise. Zero switches a part off.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NoiseConfig {
    /// Standard deviation of the depth at `axial_distance_m`, metres; grows with depth squared.
    pub axial_sigma_m: f64,
    /// Depth at which `axial_sigma_m` holds, metres.
    pub axial_distance_m: f64,
    /// Standard deviation of the offset, in pixels and per axis, at which a pixel reads the depth.
    pub lateral_sigma_px: f64,
    /// Surface seen at an angle from its normal above this starts to drop out, degrees; at 90 all of it does.
    pub grazing_from_deg: f64,
    /// Probability that a pixel beside a depth edge returns nothing.
    pub edge_dropout: f64,
    /// Smallest step in depth to a neighbouring pixel that is an edge, metres. The silhouette is one too.
    pub edge_step_m: f64,
    /// Seed of the noise; one realisation per seed and camera pose.
    pub seed: u64,
}

impl Default for NoiseConfig {
    /// A consumer sensor: 1 mm at 1.2 m.
    fn default() -> Self {
        Self {
            axial_sigma_m: 0.001,
            axial_distance_m: 1.2,
            lateral_sigma_px: 0.5,
            grazing_from_deg: 75.0,
            edge_dropout: 0.2,
            edge_step_m: 0.02,
            seed: 0,
        }
    }
}

impl NoiseConfig {
    /// Only axial noise, of this standard deviation in metres at 1.2 m.
    pub fn axial(sigma_m: f64) -> Self {
        Self {
            axial_sigma_m: sigma_m,
            lateral_sigma_px: 0.0,
            grazing_from_deg: 90.0,
            edge_dropout: 0.0,
            ..Self::default()
        }
    }

    /// Replaces an ideal image by a measured one.
    pub(crate) fn disturb(&self, image: &mut DepthImage, camera: &PinholeCamera, world_from_camera: &Isometry3<f64>) {
        if image.depth.is_empty() {
            return;
        }
        let pose = world_from_camera.to_homogeneous();
        let name = pose.iter().fold(String::from("noise"), |name, x| format!("{name}/{:x}", x.to_bits()));
        let mut rng = rng::stream(self.seed, &name);
        let ideal = if self.lateral_sigma_px > 0.0 { with_margin(image, camera, 2) } else { image.clone() };
        *image = ideal.clone();
        let per_depth_squared = self.axial_sigma_m / (self.axial_distance_m * self.axial_distance_m);
        let grazing_from = self.grazing_from_deg.to_radians();
        for row in 0..image.size[1] {
            for column in 0..image.size[0] {
                // Every pixel draws the same numbers, so that switching a part off leaves the others as they are.
                let [jitter_u, jitter_v, axial] = std::array::from_fn::<f64, 3, _>(|_| rng.sample(StandardNormal));
                let [chance_grazing, chance_edge]: [f64; 2] = [rng.random(), rng.random()];
                let [c, r] = [(column, jitter_u), (row, jitter_v)]
                    .map(|(at, jitter)| i64::from(at) + (jitter * self.lateral_sigma_px).round() as i64);
                let Some(z) = depth(&ideal, c, r) else {
                    image.depth[(row * image.size[0] + column) as usize] = 0.0;
                    continue;
                };
                let neighbours = [(-1, 0), (1, 0), (0, -1), (0, 1)].map(|(du, dv)| depth(&ideal, c + du, r + dv));
                let on_edge = neighbours.iter().any(|n| n.is_none_or(|n| (n - z).abs() > self.edge_step_m));
                let grazing = (grazing_angle(&ideal, camera, c, r, z, self.edge_step_m) - grazing_from)
                    / (std::f64::consts::FRAC_PI_2 - grazing_from).max(1e-9);
                let dropped = (on_edge && chance_edge < self.edge_dropout) || chance_grazing < grazing;
                let noisy = z + axial * per_depth_squared * z * z;
                image.depth[(row * image.size[0] + column) as usize] =
                    if dropped { 0.0 } else { noisy.max(0.0) as f32 };
            }
        }
    }
}

/// Depth at a pixel of the window, if there is one.
fn depth(image: &DepthImage, column: i64, row: i64) -> Option<f64> {
    let (c, r) = (u32::try_from(column).ok()?, u32::try_from(row).ok()?);
    image.at(c + image.origin[0], r + image.origin[1]).map(f64::from)
}

/// Angle between the surface's normal and the ray, from the depths beside a pixel; 0 where there are none.
fn grazing_angle(image: &DepthImage, camera: &PinholeCamera, c: i64, r: i64, z: f64, edge_step: f64) -> f64 {
    let at = |dc: i64, dr: i64| {
        let z2 = depth(image, c + dc, r + dr).filter(|n| (n - z).abs() <= edge_step)?;
        let [column, row] = [c + dc + i64::from(image.origin[0]), r + dr + i64::from(image.origin[1])];
        Some(camera.unproject(column as f64, row as f64, z2).coords)
    };
    let Some(middle) = at(0, 0) else { return 0.0 };
    let slope = |back: Option<Vector3<f64>>, ahead: Option<Vector3<f64>>| match (back, ahead) {
        (None, None) => None,
        (back, ahead) => Some(ahead.unwrap_or(middle) - back.unwrap_or(middle)),
    };
    match (slope(at(-1, 0), at(1, 0)), slope(at(0, -1), at(0, 1))) {
        (Some(across), Some(down)) => {
            across.cross(&down).try_normalize(0.0).map_or(0.0, |n| n.dot(&middle.normalize()).abs().min(1.0).acos())
        }
        _ => 0.0,
    }
}

/// The image with a margin of empty pixels around its window, as far as the camera's image reaches.
fn with_margin(image: &DepthImage, camera: &PinholeCamera, margin: u32) -> DepthImage {
    let origin = image.origin.map(|o| o.saturating_sub(margin));
    let end = [0, 1].map(|k| (image.origin[k] + image.size[k] + margin).min([camera.width, camera.height][k]));
    let size = [end[0] - origin[0], end[1] - origin[1]];
    let mut wider = DepthImage { origin, size, depth: vec![0.0; (size[0] * size[1]) as usize] };
    let [shift_c, shift_r] = [image.origin[0] - origin[0], image.origin[1] - origin[1]];
    for row in 0..image.size[1] {
        let from = (row * image.size[0]) as usize;
        let to = ((row + shift_r) * size[0] + shift_c) as usize;
        let columns = image.size[0] as usize;
        wider.depth[to..to + columns].copy_from_slice(&image.depth[from..from + columns]);
    }
    wider
}

#[cfg(test)]
mod tests;
