//! What the object stands on: a plane, found in the first scan that shows it or given, that is taken away from all scans and that no camera goes under.

use crate::config::ConfigError;
use crate::thin;
use geometry::{DepthImage, PinholeCamera, rng};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::RngExt;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Share of the points on one plane from which on the object seems to stand there.
pub(crate) const STANDING: f64 = 0.08;
/// Of the heights of what stands on it, summed, the depths of what shows beneath it may come to so much, each no more than the
/// object is high: less at the edge of a table, more at the body under a lid.
const BENEATH: f64 = 0.4;
/// The points on it are a layer: as many as within this many times its thickness above and beneath. A cut through a slope is none.
const AROUND: f64 = 3.0;
/// What lies at least this many times its thickness under it, and farther than the object is high, is something else.
const GAP: f64 = 10.0;
/// Largest angle to `constraints.up`, as a cosine (30 degrees).
const UPRIGHT: f64 = 0.866;
/// Planes drawn, and points that each is held against.
const DRAWN: usize = 500;
const ASKED: usize = 4_000;
/// As obstacles its points need be no denser than this, metres, which is less than any part of an arm is wide, nor more than so many.
const OBSTACLE_M: f64 = 0.01;
const MOST_OBSTACLES: usize = 10_000;

/// What is done about it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Support {
    /// Nothing: all points are the object.
    #[default]
    None,
    /// It is looked for in each scan until one shows it.
    Auto,
    /// It is this one.
    Plane(Plane),
}

/// The plane of points p with normal . p = offset; the object is on the side of the normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// Of unit length.
    pub normal: [f64; 3],
    /// Metres from the origin along the normal.
    pub offset_m: f64,
}

impl Plane {
    /// Height above it, metres.
    pub fn height(&self, p: &Point3<f64>) -> f64 {
        p.coords.dot(&Vector3::from(self.normal)) - self.offset_m
    }
}

impl Support {
    /// Refuses a plane without a normal.
    ///
    /// # Errors
    /// What it is.
    pub fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Plane(plane)
                if !(plane.offset_m.is_finite() && (Vector3::from(plane.normal).norm() - 1.0).abs() < 1e-6) =>
            {
                let found = format!("{:?}, {}", plane.normal, plane.offset_m);
                Err(ConfigError {
                    key: "support",
                    found,
                    expected: "auto, none, or [nx, ny, nz, d] with a normal that is not zero",
                })
            }
            _ => Ok(()),
        }
    }

    /// From nx, ny, nz, d with n . p = d; the normal need not be of unit length.
    pub fn plane([x, y, z, d]: [f64; 4]) -> Self {
        let length = Vector3::new(x, y, z).norm();
        Self::Plane(Plane { normal: [x / length, y / length, z / length], offset_m: d / length })
    }
}

impl Serialize for Support {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::None => serializer.serialize_str("none"),
            Self::Auto => serializer.serialize_str("auto"),
            Self::Plane(Plane { normal: [x, y, z], offset_m }) => [*x, *y, *z, *offset_m].serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Support {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Word(String),
            Plane([f64; 4]),
        }
        let expected = "support: expected \"auto\", \"none\" or [nx, ny, nz, d]";
        match Written::deserialize(deserializer).map_err(|_| serde::de::Error::custom(expected))? {
            Written::Word(word) if word == "none" => Ok(Self::None),
            Written::Word(word) if word == "auto" => Ok(Self::Auto),
            Written::Word(_) => Err(serde::de::Error::custom(expected)),
            Written::Plane(plane) => Ok(Self::plane(plane)),
        }
    }
}

/// The plane that the points stand on: the one that most of them lie on within `tolerance`, of those that lie about level, hold enough of
/// them, show little beneath them, and reach to all sides beyond what is above them. The same points give the same plane.
pub fn find(points: &[Point3<f64>], up: &Vector3<f64>, tolerance: f64, seed: u64) -> Option<Plane> {
    let step = points.len().div_ceil(ASKED).max(1);
    let asked: Vec<Point3<f64>> =
        points.iter().step_by(step).filter(|p| p.iter().all(|x| x.is_finite())).copied().collect();
    if asked.len() < 30 {
        return None;
    }
    let mut rng = rng::stream(seed, "support");
    let mut best: Option<(usize, Plane)> = None;
    for _ in 0..DRAWN {
        let [a, b, c] = std::array::from_fn(|_| asked[rng.random_range(0..asked.len())]);
        let Some(plane) = through(&a, &(b - a).cross(&(c - a)), up) else { continue };
        let on = asked.iter().filter(|p| plane.height(p).abs() < tolerance).count();
        if best.is_none_or(|(most, _)| on > most) && stands(&asked, &plane, tolerance) {
            best = Some((on, plane));
        }
    }
    let (_, rough) = best?;
    let plane = fitted(points, &rough, up, tolerance).unwrap_or(rough);
    stands(&asked, &plane, tolerance).then_some(plane)
}

fn through(p: &Point3<f64>, normal: &Vector3<f64>, up: &Vector3<f64>) -> Option<Plane> {
    let normal = normal.try_normalize(1e-12)?;
    let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
    (normal.dot(up) > UPRIGHT).then(|| Plane { normal: normal.into(), offset_m: normal.dot(&p.coords) })
}

/// By least squares to what lies on it.
fn fitted(points: &[Point3<f64>], rough: &Plane, up: &Vector3<f64>, tolerance: f64) -> Option<Plane> {
    let on: Vec<&Point3<f64>> = points.iter().filter(|p| rough.height(p).abs() < tolerance).collect();
    let mean = on.iter().map(|p| p.coords).sum::<Vector3<f64>>() / on.len().max(1) as f64;
    let spread = on.iter().fold(nalgebra::Matrix3::zeros(), |sum, p| {
        let d = p.coords - mean;
        sum + d * d.transpose()
    });
    let eigen = spread.symmetric_eigen();
    through(&Point3::from(mean), &eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned(), up)
}

/// Whether the points stand on this plane.
fn stands(points: &[Point3<f64>], plane: &Plane, tolerance: f64) -> bool {
    let normal = Vector3::from(plane.normal);
    let across = normal.cross(&if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() }).normalize();
    let axes = [across, normal.cross(&across)];
    let heights: Vec<f64> = points.iter().map(|p| plane.height(p)).collect();
    let (mut on, mut above, mut around) = (0usize, 0usize, 0usize);
    let (mut high, mut highest, mut depths) = (0.0, 0.0f64, Vec::new());
    let empty = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    let (mut table, mut object) = (empty, empty);
    for (p, height) in points.iter().zip(heights) {
        around += usize::from(height.abs() > tolerance && height.abs() <= AROUND * tolerance);
        let extent = if height.abs() <= tolerance {
            on += 1;
            &mut table
        } else if height > 0.0 {
            above += 1;
            high += height;
            highest = highest.max(height);
            &mut object
        } else {
            depths.push(-height);
            continue;
        };
        for (axis, [low, high]) in axes.iter().zip(extent) {
            let x = p.coords.dot(axis);
            (*low, *high) = (low.min(x), high.max(x));
        }
    }
    let enough = on as f64 > STANDING * points.len() as f64 && above >= 10 && on >= around;
    let deep: f64 =
        attached(&mut depths, highest.max(GAP * tolerance), points.len() / 100).iter().map(|d| d.min(highest)).sum();
    let under = deep <= BENEATH * high;
    let beyond = table.iter().zip(&object).all(|(t, o)| t[0] < o[0] && t[1] > o[1]);
    enough && under && beyond
}

/// Of depths under a plane those that belong to it: not what lies, but for `few` points, more than `gap` under the rest, as the floor beside a
/// table does.
fn attached(depths: &mut [f64], gap: f64, few: usize) -> &[f64] {
    depths.sort_by(f64::total_cmp);
    let before = |i: usize| if i == 0 { 0.0 } else { depths[i - 1] };
    let end = (0..depths.len().saturating_sub(few)).find(|&i| depths[i + few] - before(i) > gap);
    &depths[..end.unwrap_or(depths.len())]
}

/// Takes what the object stands on out of an image: its pixels show nothing of the object, as those do that show the background. Its points.
pub(crate) fn clear(
    image: &mut DepthImage,
    camera: &PinholeCamera,
    world_from_camera: &Isometry3<f64>,
    plane: Option<&Plane>,
    margin: f64,
) -> Vec<Point3<f64>> {
    let mut taken = Vec::new();
    let Some(plane) = plane else { return taken };
    let (columns, [x0, y0]) = (image.size[0].max(1) as usize, image.origin.map(|x| x as usize));
    for (i, z) in image.depth.iter_mut().enumerate().filter(|(_, z)| **z > 0.0) {
        let (column, row) = ((x0 + i % columns) as f64, (y0 + i / columns) as f64);
        let point = world_from_camera * camera.unproject(column, row, f64::from(*z));
        if plane.height(&point) <= margin {
            *z = 0.0;
            taken.push(point);
        }
    }
    taken
}

/// Of points of what the object stands on, and under it, those that tell an arm where it may not go. Not the whole plane: the base of an
/// arm may stand lower, beside the table.
pub(crate) fn obstacles(points: &[Point3<f64>], seed: u64) -> Vec<Point3<f64>> {
    let kept = thin::thin_to(points, OBSTACLE_M, MOST_OBSTACLES, seed).indices;
    kept.into_iter().map(|i| points[i]).collect()
}

#[cfg(test)]
mod tests;
