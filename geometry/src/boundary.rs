//! Boundary points of a cloud by the angle criterion (Bendels et al. 2006; docs/method.md, 'Boundary and candidate
//! views', 2).

use crate::PointCloud;
use crate::neighbors::Neighborhoods;
use nalgebra::{Point3, Vector3};

/// Settings of the boundary detection.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoundaryConfig {
    /// Neighbours considered at most, the point itself among them (30).
    pub neighbors: usize,
    /// A point is on the boundary if the largest gap between the directions to its neighbours exceeds this (120).
    pub max_gap_deg: f64,
    /// Use the normals unnormalised and in the published frame, which is undefined (never a boundary) for normals of
    /// exactly (0, 0, +-1) and distorts angles for others that are not of unit length. Off by default.
    pub published_frame: bool,
}

impl Default for BoundaryConfig {
    fn default() -> Self {
        Self { neighbors: 30, max_gap_deg: 120.0, published_frame: false }
    }
}

/// Indices of the boundary points, rising, by the neighbourhoods of `config.neighbors` points of the cloud; their radius is
/// the mean distance to the other `neighbors - 1` nearest points. The cloud needs normals: without them nothing is a boundary.
///
/// ```
/// use geometry::{BoundaryConfig, Neighborhoods, PointCloud, boundary_points};
/// use nalgebra::{Point3, Vector3};
///
/// let points: Vec<_> = (0..900).map(|i| Point3::new(0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30), 0.0)).collect();
/// let cloud = PointCloud { normals: vec![Vector3::z(); points.len()], points };
/// let near = Neighborhoods::of(&cloud.points, 30);
/// let boundary = boundary_points(&cloud, &near, &BoundaryConfig::default());
/// assert!(boundary.contains(&0) && !boundary.contains(&465), "the corner, not the middle");
/// ```
pub fn boundary_points(cloud: &PointCloud, neighborhoods: &Neighborhoods, config: &BoundaryConfig) -> Vec<usize> {
    if !cloud.has_normals() {
        return Vec::new();
    }
    let criterion = AngleCriterion::new(neighborhoods.mean_distance(), config);
    let mut directions = Vec::new();
    (0..cloud.len()).filter(|&i| criterion.is_boundary(cloud, neighborhoods, i, &mut directions)).collect()
}

/// The criterion, ready to be asked of many points.
pub(crate) struct AngleCriterion {
    radius2: f32,
    cos_gap: f32,
    reflex: bool,
    sectors_suffice: bool,
    published_frame: bool,
}

impl AngleCriterion {
    pub(crate) fn new(radius: f64, config: &BoundaryConfig) -> Self {
        Self {
            radius2: (radius as f32).powi(2),
            cos_gap: config.max_gap_deg.to_radians().cos() as f32,
            reflex: config.max_gap_deg >= 180.0,
            sectors_suffice: config.max_gap_deg >= 120.0,
            published_frame: config.published_frame,
        }
    }

    /// `directions` is scratch.
    pub(crate) fn is_boundary(
        &self,
        cloud: &PointCloud,
        neighborhoods: &Neighborhoods,
        i: usize,
        directions: &mut Vec<[f32; 3]>,
    ) -> bool {
        let normal = cloud.normals[i];
        let frame = if self.published_frame { published_frame(&normal) } else { tangent_frame(&normal) };
        let Some((u_axis, v_axis)) = frame else { return false };
        let point = cloud.points[i];
        directions.clear();
        let mut sectors = 0u8;
        for (&id, &d2) in neighborhoods.ids(i).iter().zip(neighborhoods.distances2(i)) {
            if d2 >= self.radius2 {
                break;
            }
            if id as usize == i {
                continue;
            }
            let d = to_f32(&Point3::from(cloud.points[id as usize] - point));
            let (u, v) = (dot(&u_axis, &d), dot(&v_axis, &d));
            if u == 0.0 && v == 0.0 {
                continue; // straight above or the same spot: no direction
            }
            sectors |= sector(u, v);
            if sectors == 0b11_1111 && self.sectors_suffice {
                return false;
            }
            directions.push([0.0, u, v]);
        }
        if directions.is_empty() {
            return false;
        }
        directions.iter_mut().for_each(|[angle, u, v]| *angle = pseudo_angle(*u, *v));
        directions.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        let [last_angle, last_u, last_v] = directions[directions.len() - 1];
        let mut previous = [last_angle - 4.0, last_u, last_v];
        directions.iter().any(|&direction| {
            let exceeds = self.exceeds(&previous, &direction);
            previous = direction;
            exceeds
        })
    }

    /// Whether the gap from one direction to the next exceeds the limit.
    fn exceeds(&self, a: &[f32; 3], b: &[f32; 3]) -> bool {
        let over_half_turn = b[0] - a[0] >= 2.0;
        if over_half_turn != self.reflex {
            return over_half_turn;
        }
        let cos = (a[1] * b[1] + a[2] * b[2]) / ((a[1] * a[1] + a[2] * a[2]) * (b[1] * b[1] + b[2] * b[2])).sqrt();
        if self.reflex { cos > self.cos_gap } else { cos < self.cos_gap }
    }
}

/// Rises with the angle of (u, v) from -u counter-clockwise through a full turn: 0..4, half a turn being 2.
fn pseudo_angle(u: f32, v: f32) -> f32 {
    let t = u / (u.abs() + v.abs());
    if v < 0.0 { 1.0 + t } else { 3.0 - t }
}

/// One bit for the 60-degree sector that holds the direction.
fn sector(u: f32, v: f32) -> u8 {
    // Without a branch: directions are as good as random.
    let steep = v.abs() > 1.732_050_8 * u.abs();
    let apart = (u > 0.0) != (v > 0.0);
    let third = u8::from(steep) | (u8::from(apart & !steep) << 1);
    let below = !((v > 0.0) | ((v == 0.0) & (u > 0.0)));
    1 << (third + 3 * u8::from(below))
}

fn tangent_frame(normal: &Vector3<f64>) -> Option<([f32; 3], [f32; 3])> {
    let n = normal.try_normalize(1e-12)?;
    let mut axis = Vector3::zeros();
    axis[n.iamin()] = 1.0;
    let u = n.cross(&axis).try_normalize(1e-12)?;
    Some((to_f32(&u.into()), to_f32(&n.cross(&u).into())))
}

/// Frame of the published code (Open3D), in f32: u = n x v is as short as the normal.
fn published_frame(normal: &Vector3<f64>) -> Option<([f32; 3], [f32; 3])> {
    let [x, y, z] = to_f32(&Point3::from(*normal));
    let v = if (x - z).abs() >= 1e-6 || (y - z).abs() >= 1e-6 {
        let length = (x * x + y * y).sqrt();
        [-y / length, x / length, 0.0]
    } else {
        let length = (y * y + z * z).sqrt();
        [0.0, -z / length, y / length]
    };
    let u = [y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]];
    v.iter().all(|c| c.is_finite()).then_some((u, v))
}

fn to_f32(p: &Point3<f64>) -> [f32; 3] {
    [p.x as f32, p.y as f32, p.z as f32]
}

fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests;
