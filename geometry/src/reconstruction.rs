//! A triangle mesh of a cloud with normals: the zero level of the implicit moving-least-squares function (Kolluri, 'Provably good
//! moving least squares', SODA 2005), taken by marching tetrahedra on the lattice points near the cloud.
//!
//! Surface is made where it was measured and nowhere else: closed where the cloud is, with a rim where it ends. Marching
//! tetrahedra need no table of cases and leave no cracks: every edge is in two triangles, or in one on the rim. Own code, as it is
//! on the points near a sparse cloud alone: the crates for it want a dense box of values. Where the surface is curved it lies
//! outside of the points by a sixth of the support squared over twice the radius: 0.03 mm at 2 mm spacing and 0.1 m radius.

use crate::{Mesh, NeighborGrid, PointCloud};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Edge of the lattice, in spacings.
const EDGE: f64 = 1.25;
/// Radius within which points shape the surface, in spacings: holes smaller than this are closed.
const SUPPORT: f64 = 3.0;
/// Lattice points up to this many lattice edges from a point are looked at.
const BAND: f64 = 2.0;
/// How far the middle of the points around may lie to the side of a lattice point, as a share of the support: at the straight
/// end of a sheet it is a third.
const AT_THE_END: f64 = 0.33;
/// Points whose normal is this far from that of the nearest one are of the other side of a thin sheet (cosine).
const OTHER_SIDE: f64 = -0.5;
/// Corners of triangles keep this share of an edge away from its ends, so that no triangle has no area.
const OFF_THE_ENDS: f64 = 0.02;
/// The lattice has at most this many edges along a side: indices fit in 64 bits.
const MAX_SIDE: f64 = 1e6;

type Cell = [i32; 3];

/// A surface with what is known of its vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reconstruction {
    /// Triangles counter-clockwise seen from outside, where the normals of the cloud point.
    pub mesh: Mesh,
    /// Unit normal of each vertex.
    pub normals: Vec<Vector3<f64>>,
    /// Whether each vertex is where the surface ends.
    pub rim: Vec<bool>,
}

/// The surface that the cloud was measured on, in its unit and frame. `spacing` is the distance of neighbouring points; the
/// triangles are about as large. Empty where the cloud has no normals, no two points, or no spacing.
///
/// ```
/// use geometry::{Neighborhoods, PointCloud, mean_spacing, reconstruct};
/// use nalgebra::{Point3, Vector3};
///
/// let points: Vec<_> = (0..900).map(|i| Point3::new(0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30), 0.0)).collect();
/// let cloud = PointCloud { normals: vec![Vector3::z(); points.len()], points };
/// let surface = reconstruct(&cloud, mean_spacing(&cloud.points, &Neighborhoods::of(&cloud.points, 2)));
/// assert!((surface.mesh.area() / (0.116 * 0.116) - 1.0).abs() < 0.15);
/// assert!(surface.rim.contains(&true), "a sheet ends");
/// ```
pub fn reconstruct(cloud: &PointCloud, spacing: f64) -> Reconstruction {
    reconstruct_while(cloud, spacing, || true).unwrap_or_default()
}

/// The same, given up as soon as `go_on`, which is asked often, says no: `None` then.
pub fn reconstruct_while(cloud: &PointCloud, spacing: f64, go_on: impl Fn() -> bool + Sync) -> Option<Reconstruction> {
    let (low, high) = cloud.bounding_box();
    let sides = (high - low).max() / spacing;
    if cloud.normals.len() != cloud.points.len() || cloud.points.len() < 2 || !(sides.is_finite() && sides < MAX_SIDE) {
        return Some(Reconstruction::default());
    }
    let field =
        Field { cloud, grid: NeighborGrid::new(&cloud.points, 2.0 * spacing), origin: low, edge: EDGE * spacing };
    let lattice = field.near();
    let value = |at: &Cell| go_on().then(|| Some((*at, field.value(at)?)));
    let values: Vec<Option<(Cell, Value)>> = lattice.par_iter().map(value).collect::<Option<_>>()?;
    let values: FxHashMap<Cell, Value> = values.into_iter().flatten().collect();
    let mut surface =
        Surface { field: &field, values: &values, corners: FxHashMap::default(), out: Reconstruction::default() };
    for cells in lattice.chunks(1024) {
        if !go_on() {
            return None;
        }
        cells.iter().for_each(|at| surface.cell(at));
    }
    let mut out = surface.out;
    out.rim = rim(&out.mesh);
    Some(out)
}

/// The signed distance to the cloud's surface, on a lattice.
struct Field<'a> {
    cloud: &'a PointCloud,
    grid: NeighborGrid,
    origin: Point3<f64>,
    edge: f64,
}

#[derive(Clone, Copy)]
struct Value {
    /// Metres, positive outside; never zero.
    distance: f64,
    normal: Vector3<f64>,
}

impl Field<'_> {
    fn position(&self, at: &Cell) -> Point3<f64> {
        self.origin + Vector3::from(at.map(f64::from)) * self.edge
    }

    /// The lattice points near the cloud, sorted.
    fn near(&self) -> Vec<Cell> {
        let around = |p: &Point3<f64>| {
            let at = (p - self.origin) / self.edge;
            let [x, y, z] = [0, 1, 2].map(|k| (at[k] - BAND).ceil() as i32..=(at[k] + BAND).floor() as i32);
            x.flat_map(move |x| {
                let z = z.clone();
                y.clone().flat_map(move |y| z.clone().map(move |z| [x, y, z]))
            })
        };
        let mut lattice: Vec<Cell> = Vec::new();
        // In parts, so that neighbours' lattice points are not held many times over.
        for part in self.cloud.points.chunks(4096) {
            lattice.extend(part.iter().filter(|p| p.iter().all(|x| x.is_finite())).flat_map(around));
            lattice.par_sort_unstable();
            lattice.dedup();
        }
        lattice
    }

    /// `None` where no surface was measured.
    fn value(&self, at: &Cell) -> Option<Value> {
        let x = self.position(at);
        let support = SUPPORT / EDGE * self.edge;
        let near = self.grid.within(&x, support);
        let facing = self.cloud.normals[near.first()?.index];
        let (mut weights, mut distance) = (0.0, 0.0);
        let (mut normal, mut middle) = (Vector3::zeros(), Vector3::zeros());
        for neighbor in &near {
            let (p, n) = (&self.cloud.points[neighbor.index], &self.cloud.normals[neighbor.index]);
            if n.dot(&facing) < OTHER_SIDE {
                continue;
            }
            let off = x - p;
            // Smooth, and zero at the end of the support.
            let weight = (1.0 - off.norm_squared() / support.powi(2)).max(0.0).powi(4);
            weights += weight;
            distance += weight * n.dot(&off);
            normal += weight * n;
            middle += weight * off;
        }
        let normal = normal.try_normalize(1e-9)?;
        let middle = middle / weights;
        let aside = middle - normal * normal.dot(&middle);
        let distance = distance / weights;
        let on_it = distance.is_finite() && aside.norm() <= AT_THE_END * support;
        on_it.then_some(Value { distance: if distance == 0.0 { f64::MIN_POSITIVE } else { distance }, normal })
    }
}

/// The surface as it grows.
struct Surface<'a> {
    field: &'a Field<'a>,
    values: &'a FxHashMap<Cell, Value>,
    /// The vertex on each lattice edge.
    corners: FxHashMap<[Cell; 2], u32>,
    out: Reconstruction,
}

impl Surface<'_> {
    /// The triangles in the cell above a lattice point: its cube as six tetrahedra around the diagonal (Freudenthal), so that
    /// those of neighbouring cells fit together.
    fn cell(&mut self, at: &Cell) {
        /// Along which axes the corners follow each other, and whether that is a right-handed order.
        const PATHS: [([usize; 3], bool); 6] = [
            ([0, 1, 2], true),
            ([1, 2, 0], true),
            ([2, 0, 1], true),
            ([0, 2, 1], false),
            ([2, 1, 0], false),
            ([1, 0, 2], false),
        ];
        let known = |corner: usize| self.values.get(&[0, 1, 2].map(|k| at[k] + i32::from(corner >> k & 1 == 1)));
        let signs: Option<Vec<bool>> = (0..8).map(|corner| known(corner).map(|v| v.distance < 0.0)).collect();
        // Where one corner is unknown, so is the surface; most cells are on one side of it.
        if signs.is_none_or(|signs| signs.iter().all(|s| *s == signs[0])) {
            return;
        }
        for (path, right_handed) in PATHS {
            let mut corners = [*at; 4];
            for (step, axis) in path.into_iter().enumerate() {
                corners[step + 1..].iter_mut().for_each(|c| c[axis] += 1);
            }
            self.tetrahedron(corners, right_handed);
        }
    }

    fn tetrahedron(&mut self, corners: [Cell; 4], right_handed: bool) {
        let inside = corners.map(|c| self.values[&c].distance < 0.0);
        // Those inside first; an order that is an odd number of swaps away turns the tetrahedron over.
        let mut order = [0, 1, 2, 3];
        order.sort_by_key(|&i| !inside[i]);
        let swaps = (0..4).flat_map(|i| (i + 1..4).map(move |j| (i, j))).filter(|&(i, j)| order[i] > order[j]).count();
        let right_handed = right_handed == (swaps % 2 == 0);
        let [a, b, c, d] = order.map(|i| corners[i]);
        let polygon: Vec<[Cell; 2]> = match inside.iter().filter(|i| **i).count() {
            1 => vec![[a, b], [a, c], [a, d]],
            2 => vec![[a, c], [a, d], [b, d], [b, c]],
            // The one outside is last: seen from it, the others turn the other way round.
            3 => vec![[a, d], [b, d], [c, d]],
            _ => return,
        };
        let polygon: Vec<u32> = polygon.into_iter().map(|edge| self.corner(edge)).collect();
        for i in 1..polygon.len() - 1 {
            let [p, q] = if right_handed { [i, i + 1] } else { [i + 1, i] };
            self.out.mesh.triangles.push([polygon[0], polygon[p], polygon[q]]);
        }
    }

    /// The vertex where the surface crosses this lattice edge.
    fn corner(&mut self, mut edge: [Cell; 2]) -> u32 {
        edge.sort_unstable();
        let [a, b] = edge.map(|at| self.values[&at]);
        *self.corners.entry(edge).or_insert_with(|| {
            let t = (a.distance / (a.distance - b.distance)).clamp(OFF_THE_ENDS, 1.0 - OFF_THE_ENDS);
            let [from, to] = edge.map(|at| self.field.position(&at));
            self.out.mesh.vertices.push(from + t * (to - from));
            self.out.normals.push((a.normal * (1.0 - t) + b.normal * t).try_normalize(1e-9).unwrap_or(a.normal));
            (self.out.mesh.vertices.len() - 1) as u32
        })
    }
}

/// Whether each vertex is on an edge of one triangle alone.
fn rim(mesh: &Mesh) -> Vec<bool> {
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.iter_mut().for_each(|edge| edge.sort_unstable());
    edges.sort_unstable();
    let mut rim = vec![false; mesh.vertices.len()];
    for same in edges.chunk_by(|a, b| a == b).filter(|same| same.len() == 1) {
        same[0].iter().for_each(|&vertex| rim[vertex as usize] = true);
    }
    rim
}

#[cfg(test)]
mod tests;
