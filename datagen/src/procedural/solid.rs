//! Implicit solids: negative inside, about the distance to the surface near it (Hart 1996).

use fidget::context::Tree;
use nalgebra::{Rotation3, Vector3};

/// A solid as an expression in x, y and z.
#[derive(Clone)]
pub(super) struct Solid(Tree);

/// Squared length of a vector of expressions.
fn norm2(v: [Tree; 3]) -> Tree {
    let [x, y, z] = v.map(|t| t.square());
    x + y + z
}

/// Coordinates relative to a center.
fn from_center(center: [f64; 3]) -> [Tree; 3] {
    let [x, y, z] = center.map(|c| c as f32);
    [Tree::x() - x, Tree::y() - y, Tree::z() - z]
}

impl Solid {
    pub(super) fn sphere(center: [f64; 3], radius: f64) -> Self {
        Self(norm2(from_center(center)).sqrt() - radius as f32)
    }

    pub(super) fn ellipsoid(center: [f64; 3], radii: [f64; 3]) -> Self {
        let [x, y, z] = from_center(center);
        let [a, b, c] = radii.map(|r| (1.0 / r) as f32);
        let smallest = radii.into_iter().fold(f64::MAX, f64::min) as f32;
        Self((norm2([x * a, y * b, z * c]).sqrt() - 1.0) * smallest)
    }

    /// A box with edges rounded by `rounding`.
    pub(super) fn cuboid(center: [f64; 3], half: [f64; 3], rounding: f64) -> Self {
        let rounding = rounding.min(half.into_iter().fold(f64::MAX, f64::min) * 0.9);
        let p = from_center(center);
        let [x, y, z] = [0, 1, 2].map(|k| p[k].abs() - (half[k] - rounding) as f32);
        let inside = x.max(y.clone()).max(z.clone()).min(0.0);
        Self(norm2([x.max(0.0), y.max(0.0), z.max(0.0)]).sqrt() + inside - rounding as f32)
    }

    /// A cylinder along `axis` (0, 1 or 2).
    pub(super) fn cylinder(center: [f64; 3], axis: usize, radius: f64, half_length: f64) -> Self {
        Self::cone(center, axis, radius, radius, half_length)
    }

    /// A cone's frustum along `axis`, of radius `low` at its lower end and `high` at its upper one.
    pub(super) fn cone(center: [f64; 3], axis: usize, low: f64, high: f64, half_length: f64) -> Self {
        let p = from_center(center);
        let along = p[axis].clone();
        let across = p[(axis + 1) % 3].square() + p[(axis + 2) % 3].square();
        let slope = (high - low) / (2.0 * half_length);
        let radius = along.clone() * slope as f32 + ((low + high) / 2.0) as f32;
        let side = (across.sqrt() - radius) * (1.0 / (1.0 + slope * slope).sqrt()) as f32;
        Self(side.max(along.abs() - half_length as f32))
    }

    /// A ball swept from `a` to `b` while its radius goes from `ra` to `rb`.
    pub(super) fn limb(a: [f64; 3], b: [f64; 3], ra: f64, rb: f64) -> Self {
        let axis = Vector3::from(b) - Vector3::from(a);
        let [ax, ay, az] = <[f64; 3]>::from(axis / axis.norm_squared().max(1e-9)).map(|c| c as f32);
        let [x, y, z] = from_center(a);
        let along = (x.clone() * ax + y.clone() * ay + z.clone() * az).max(0.0).min(1.0);
        let [dx, dy, dz] = [axis.x as f32, axis.y as f32, axis.z as f32];
        let foot = [x - along.clone() * dx, y - along.clone() * dy, z - along.clone() * dz];
        Self(norm2(foot).sqrt() - (along * (rb - ra) as f32 + ra as f32))
    }

    /// A ring around `axis`.
    pub(super) fn torus(center: [f64; 3], axis: usize, major: f64, minor: f64) -> Self {
        let p = from_center(center);
        let around = (p[(axis + 1) % 3].square() + p[(axis + 2) % 3].square()).sqrt() - major as f32;
        Self((around.square() + p[axis].square()).sqrt() - minor as f32)
    }

    /// What lies below `level` on `axis`.
    pub(super) fn below(axis: usize, level: f64) -> Self {
        let [x, y, z] = from_center([level; 3]);
        Self([x, y, z][axis].clone())
    }

    /// Everything that the solid is not.
    pub(super) fn complement(self) -> Self {
        Self(-self.0)
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    /// Union with a fillet of about `radius` (polynomial smooth minimum).
    pub(super) fn blend(self, other: Self, radius: f64) -> Self {
        if radius <= 0.0 {
            return self.union(other);
        }
        let gap = (self.0.clone() - other.0.clone()).abs();
        let h = (Tree::from(radius as f32) - gap).max(0.0);
        Self(self.0.min(other.0) - h.square() * (0.25 / radius) as f32)
    }

    pub(super) fn intersect(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    pub(super) fn subtract(self, other: Self) -> Self {
        Self(self.0.max(-other.0))
    }

    /// The solid grown by `distance` on all sides; negative: shrunk.
    pub(super) fn grown(self, distance: f64) -> Self {
        Self(self.0 - distance as f32)
    }

    /// The solid turned about the origin, then moved.
    pub(super) fn moved(self, rotation: &Rotation3<f64>, by: [f64; 3]) -> Self {
        let p = from_center(by);
        let inverse = rotation.inverse();
        let row = |i: usize| {
            let [a, b, c] = [0, 1, 2].map(|j| inverse[(i, j)] as f32);
            p[0].clone() * a + p[1].clone() * b + p[2].clone() * c
        };
        Self(self.0.remap_xyz(row(0), row(1), row(2)))
    }

    /// The expression, cut off shortly before the faces of the cube that is meshed, so that no surface ends there.
    pub(super) fn within_unit_cube(self) -> Tree {
        self.intersect(Self::cuboid([0.0; 3], [0.96; 3], 0.0)).0
    }
}

/// The union of several solids; `None` of none.
pub(super) fn union_of(solids: impl IntoIterator<Item = Solid>) -> Option<Solid> {
    solids.into_iter().reduce(Solid::union)
}
