//! Links as balls, against boxes, measured and expected surface, and each other.

use super::{Joints, Link, MOST_JOINTS, Reach, Unreached};
use crate::constraints::Box3;
use crate::constraints::{show, show_box};
use geometry::{Mesh, NeighborGrid, rng};
use nalgebra::{Isometry3, Point3};
use rand::RngExt;
use std::collections::BTreeMap;

/// Arms drawn to learn which links always touch.
const DRAWN: usize = 64;
/// Links that touch in such a share of them are built so.
const BUILT_SO: f64 = 0.6;

/// What stands in the way; by default nothing. Points are in the object's frame, boxes in the cell's.
#[derive(Default)]
pub struct Obstacles<'a> {
    /// Measured surface.
    pub measured: Option<(&'a [Point3<f64>], &'a NeighborGrid)>,
    /// Surface expected where nothing is known.
    pub expected: Option<(&'a [Point3<f64>], &'a NeighborGrid)>,
    /// Boxes that nothing may be in.
    pub boxes: &'a [Box3],
    /// Height along `up` that the links behind the second joint must be above.
    pub floor: Option<(nalgebra::Vector3<f64>, f64)>,
}

/// Why an arm does not come to a view.
#[derive(Clone, Debug, PartialEq)]
pub enum Hindrance {
    /// It cannot.
    Unreached(Unreached),
    /// This part of it would touch that.
    Collision(String, String),
}

impl From<Unreached> for Hindrance {
    fn from(unreached: Unreached) -> Self {
        Self::Unreached(unreached)
    }
}

impl Hindrance {
    /// For people.
    pub fn describe(&self) -> String {
        match self {
            Self::Unreached(Unreached::TooFar(away, longest)) => {
                format!(
                    "out of reach: {away:.3} m from the first joint, the arm with its camera is {longest:.3} m long"
                )
            }
            Self::Unreached(Unreached::Limit(joint)) => format!("only beyond the limits of joint {joint}"),
            Self::Unreached(Unreached::Nowhere([metres, radians])) => {
                format!("out of reach: the nearest found is {metres:.3} m and {:.0} degrees off", radians.to_degrees())
            }
            Self::Collision(part, with) => format!("{part} would touch {with}"),
        }
    }
}

/// The balls that move with one joint, each with the name of its link.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Balls {
    balls: Vec<(Point3<f64>, f64, u16)>,
    names: Vec<String>,
}

impl Balls {
    /// Of a link that is `frame` away from what moves.
    pub fn of(link: &Link, frame: &Isometry3<f64>) -> Self {
        let ball = |[x, y, z, r]: &[f64; 4]| (frame * Point3::new(*x, *y, *z), *r, 0);
        Self { balls: link.balls_m.iter().map(ball).collect(), names: vec![link.name.clone()] }
    }

    /// With those of a link that is fixed to it.
    pub fn join(&mut self, other: Self) {
        let first = self.names.len() as u16;
        self.balls.extend(other.balls.into_iter().map(|(p, r, name)| (p, r, first + name)));
        self.names.extend(other.names);
    }
}

/// Balls that hold a box: as small as its thinnest side.
pub fn balls_of_box(&[low, high]: &Box3) -> Vec<[f64; 4]> {
    const MOST: f64 = 12.0;
    let size = [0, 1, 2].map(|k| high[k] - low[k]);
    let longest = size.iter().copied().fold(0.0, f64::max);
    let step = size.iter().copied().fold(f64::INFINITY, f64::min).max(longest / MOST);
    let counts = size.map(|s| (s / step.max(1e-9)).ceil().max(1.0) as usize);
    let cells = [0, 1, 2].map(|k| size[k] / counts[k] as f64);
    let radius = 0.5 * cells.iter().map(|c| c * c).sum::<f64>().sqrt();
    let mut balls = Vec::new();
    for i in 0..counts[0] {
        for j in 0..counts[1] {
            for l in 0..counts[2] {
                let at = |k: usize, n: usize| low[k] + (n as f64 + 0.5) * cells[k];
                balls.push([at(0, i), at(1, j), at(2, l), radius]);
            }
        }
    }
    balls
}

/// Balls that hold a cylinder about z, from one end to the other.
pub fn balls_of_cylinder(radius: f64, length: f64) -> Vec<[f64; 4]> {
    let count = (length / radius.max(1e-9)).ceil().clamp(1.0, 40.0) as usize;
    let step = length / count as f64;
    let ball = (radius * radius + 0.25 * step * step).sqrt();
    (0..count).map(|i| [0.0, 0.0, (i as f64 + 0.5) * step - 0.5 * length, ball]).collect()
}

/// Balls that hold the surface of a mesh: one for each cell of a lattice that it passes, a twelfth of its extent wide.
pub fn balls_of_mesh(mesh: &Mesh) -> Vec<[f64; 4]> {
    const ALONG: f64 = 12.0;
    const LEAST_M: f64 = 0.01;
    // A triangle that is larger than this many cells is no part of a link.
    const MOST_STEPS: f64 = 64.0;
    let (low, high) = mesh.bounding_box();
    let cell = ((high - low).max() / ALONG).max(LEAST_M);
    let mut parts: BTreeMap<[i32; 3], [Point3<f64>; 2]> = BTreeMap::new();
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle);
        let longest = [b - a, c - a, c - b].iter().map(|edge| edge.norm()).fold(0.0, f64::max);
        // Two steps to a cell: nothing of the surface is farther than 0.3 cells from a point.
        let steps = (2.0 * longest / cell).ceil().clamp(1.0, MOST_STEPS) as usize;
        for (i, j) in (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| (i, j))) {
            let [u, v] = [i, j].map(|n| n as f64 / steps as f64);
            let point = a + (b - a) * u + (c - a) * v;
            let at = [0, 1, 2].map(|k| ((point[k] - low[k]) / cell).floor() as i32);
            let [low, high] = parts.entry(at).or_insert([point; 2]);
            (*low, *high) = (low.inf(&point), high.sup(&point));
        }
    }
    let ball = |[low, high]: [Point3<f64>; 2]| {
        let middle = nalgebra::center(&low, &high);
        [middle.x, middle.y, middle.z, 0.5 * (high - low).norm() + 0.3 * cell]
    };
    parts.into_values().map(ball).collect()
}

impl Reach {
    /// All balls in the cell.
    fn placed(&self, joints: &Joints) -> Vec<Vec<(Point3<f64>, f64, u16)>> {
        let frames = self.frames(joints);
        // The base stands still, and the camera moves with the last joint.
        let frame = |k: usize| match k {
            0 => self.cell_from_base,
            k => frames.get(k - 1).or(frames.last()).copied().unwrap_or(self.cell_from_base),
        };
        let balls = self.balls.iter().enumerate();
        balls.map(|(k, b)| b.balls.iter().map(|(p, r, name)| (frame(k) * p, *r, *name)).collect()).collect()
    }

    /// What the arm would touch; the object's frame is `object_from_cell` away.
    pub fn collides(
        &self,
        joints: &Joints,
        obstacles: &Obstacles,
        object_from_cell: &Isometry3<f64>,
    ) -> Option<Hindrance> {
        let placed = self.placed(joints);
        let clearance = self.config.clearance_m;
        let touches = |k: usize, name: u16, with: String| {
            Some(Hindrance::Collision(self.balls[k].names[usize::from(name)].clone(), with))
        };
        for (k, balls) in placed.iter().enumerate().skip(1) {
            for (center, radius, name) in balls {
                let reach = radius + clearance;
                if let Some(b) = obstacles.boxes.iter().find(|b| box_distance(b, center) < reach) {
                    let with = format!("the box {}", show_box(b));
                    return touches(k, *name, with);
                }
                if let Some((up, floor)) = obstacles.floor
                    && k > 2
                    && center.coords.dot(&up) - radius < floor
                {
                    return touches(k, *name, "the floor".to_owned());
                }
                let in_object = object_from_cell * center;
                for (points, what) in [
                    (&obstacles.measured, "measured surface"),
                    (&obstacles.expected, "surface expected in unknown space"),
                ] {
                    let Some((points, grid)) = points else { continue };
                    let mut hit = None;
                    grid.for_each_within(&in_object, reach, |i| hit = hit.or(Some(i)));
                    if let Some(i) = hit {
                        return touches(k, *name, format!("{what} at {}", show(&points[i])));
                    }
                }
            }
        }
        self.pairs.iter().find_map(|&(a, b)| {
            let (one, other) = touching(&placed[a], &placed[b])?;
            touches(a, one, self.balls[b].names[usize::from(other)].clone())
        })
    }
}

fn touching(a: &[(Point3<f64>, f64, u16)], b: &[(Point3<f64>, f64, u16)]) -> Option<(u16, u16)> {
    a.iter().find_map(|(p, r, one)| {
        let hit = b.iter().find(|(q, s, _)| (p - q).norm_squared() < (r + s) * (r + s));
        hit.map(|(_, _, other)| (*one, *other))
    })
}

fn box_distance(b: &Box3, p: &Point3<f64>) -> f64 {
    (0..3).map(|k| (b[0][k] - p[k]).max(p[k] - b[1][k]).max(0.0).powi(2)).sum::<f64>().sqrt()
}

/// Pairs of parts that may collide: not neighbours, and not built so that they touch.
pub(super) fn near_pairs(reach: &Reach) -> Vec<(usize, usize)> {
    let count = reach.balls.len();
    let mut hits = vec![0usize; count * count];
    let mut rng = rng::stream(0, "reach/pairs");
    for _ in 0..DRAWN {
        let mut joints = [0.0; MOST_JOINTS];
        for (value, [low, high]) in joints.iter_mut().zip(&reach.limits) {
            *value = low + (high - low) * rng.random_range(0.0..1.0);
        }
        let placed = reach.placed(&joints);
        for a in 0..count {
            for b in a + 2..count {
                hits[a * count + b] += usize::from(touching(&placed[a], &placed[b]).is_some());
            }
        }
    }
    let all = (0..count).flat_map(|a| (a + 2..count).map(move |b| (a, b)));
    all.filter(|(a, b)| (hits[a * count + b] as f64) < BUILT_SO * DRAWN as f64).collect()
}
