//! A mesh cut into patches of neighbouring triangles, as the rasteriser wants it.

use super::local_origin;
use geometry::Mesh;
use nalgebra::Point3;

/// Vertices are processed in groups of this many, so that the compiler can use vector registers.
pub(super) const LANES: usize = 8;
/// Triangles of a patch at most: few enough to be hidden as one, many enough to pay for the question.
pub(super) const MAX_TRIANGLES: usize = 128;
/// Vertices of a patch at most: corners are numbered in a byte.
pub(super) const MAX_VERTICES: usize = 256;

/// Triangles that lie together.
#[derive(Debug)]
pub(super) struct Patch {
    /// Sphere around it.
    pub(super) center: [f32; 3],
    pub(super) radius: f32,
    /// Where its vertices are, in whole groups of lanes.
    pub(super) vertices: std::ops::Range<usize>,
    /// Where its triangles are.
    pub(super) triangles: std::ops::Range<usize>,
}

/// The mesh in f32 about the middle of its bounding box. Vertices that patches share are there for each of them.
#[derive(Debug)]
pub(super) struct Patches {
    pub(super) origin: Point3<f64>,
    pub(super) patches: Vec<Patch>,
    pub(super) xyz: [Vec<f32>; 3],
    /// Corners of the triangles, numbered within their patch.
    pub(super) corners: Vec<[u8; 3]>,
}

/// A triangle on its way into a patch.
struct Item {
    center: [f32; 3],
    triangle: u32,
}

impl Patches {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let origin = local_origin(mesh);
        let local: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| (v - origin).map(|x| x as f32).into()).collect();
        let item = |(triangle, t): (usize, &[u32; 3])| {
            let [a, b, c] = t.map(|i| local[i as usize]);
            Item { center: [0, 1, 2].map(|k| a[k] + b[k] + c[k]), triangle: triangle as u32 }
        };
        let mut items: Vec<Item> = mesh.triangles.iter().enumerate().map(item).collect();
        let mut builder = Builder {
            mesh,
            local: &local,
            number: vec![u32::MAX; local.len()],
            out: Self { origin, patches: Vec::new(), xyz: Default::default(), corners: Vec::new() },
        };
        builder.out.corners.reserve(items.len());
        builder.split(&mut items);
        builder.out
    }
}

struct Builder<'a> {
    mesh: &'a Mesh,
    local: &'a [[f32; 3]],
    /// Per vertex of the mesh: its place among the patches' vertices, of the last patch that has it.
    number: Vec<u32>,
    out: Patches,
}

impl Builder<'_> {
    /// Halves the triangles across the longest side of their box until they are few.
    fn split(&mut self, items: &mut [Item]) {
        if items.len() <= MAX_TRIANGLES {
            return self.add(items);
        }
        let (low, high) = bounds(items.iter().map(|item| item.center));
        let extent = [0, 1, 2].map(|k| high[k] - low[k]);
        let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
        // All patches but the last are full.
        let middle = (items.len() / 2).next_multiple_of(MAX_TRIANGLES);
        let key = |item: &Item| (item.center[axis], item.triangle);
        items.select_nth_unstable_by(middle, |a, b| {
            let ((x, i), (y, j)) = (key(a), key(b));
            x.total_cmp(&y).then(i.cmp(&j))
        });
        let (left, right) = items.split_at_mut(middle);
        self.split(left);
        self.split(right);
    }

    /// Adds a patch, or several where the triangles share few vertices.
    fn add(&mut self, items: &[Item]) {
        let (mut vertices, mut triangles) = (self.out.xyz[0].len(), self.out.corners.len());
        for item in items {
            if self.out.xyz[0].len() - vertices > MAX_VERTICES - 3 {
                self.close(vertices, triangles);
                (vertices, triangles) = (self.out.xyz[0].len(), self.out.corners.len());
            }
            let corners = self.mesh.triangles[item.triangle as usize].map(|vertex| {
                let vertex = vertex as usize;
                let place = self.number[vertex];
                if place != u32::MAX && place as usize >= vertices {
                    return (place as usize - vertices) as u8;
                }
                let place = self.out.xyz[0].len();
                self.number[vertex] = place as u32;
                self.push(self.local[vertex]);
                (place - vertices) as u8
            });
            self.out.corners.push(corners);
        }
        self.close(vertices, triangles);
    }

    fn push(&mut self, p: [f32; 3]) {
        self.out.xyz.iter_mut().zip(p).for_each(|(axis, x)| axis.push(x));
    }

    /// Makes a patch of the vertices and triangles from these on.
    fn close(&mut self, vertices: usize, triangles: usize) {
        let end = self.out.xyz[0].len();
        if end == vertices {
            return;
        }
        let at = |i: usize| self.out.xyz.each_ref().map(|axis| axis[i]);
        let (low, high) = bounds((vertices..end).map(at));
        let center = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
        let distance2 = |p: [f32; 3]| p.iter().zip(center).map(|(x, c)| (x - c) * (x - c)).sum::<f32>();
        let radius = (vertices..end).map(|i| distance2(at(i))).fold(0.0, f32::max).sqrt() * 1.0001;
        let last = at(end - 1);
        while !self.out.xyz[0].len().is_multiple_of(LANES) {
            self.push(last);
        }
        self.out.patches.push(Patch {
            center,
            radius,
            vertices: vertices..self.out.xyz[0].len(),
            triangles: triangles..self.out.corners.len(),
        });
    }
}

fn bounds(points: impl Iterator<Item = [f32; 3]>) -> ([f32; 3], [f32; 3]) {
    points.fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
        ([0, 1, 2].map(|k| low[k].min(p[k])), [0, 1, 2].map(|k| high[k].max(p[k])))
    })
}
