//! Point clouds: merging, thinning, moving.

use nalgebra::{Isometry3, Point3, Vector3};

/// Where the corner of a voxel lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VoxelOrigin {
    /// At the world's origin: a voxel stays where it is as the cloud grows.
    #[default]
    World,
    /// Half a voxel below the cloud's smallest corner, as published (Open3D): all voxels move with that corner.
    CloudMinimum,
}

/// Positions, and normals for all of them or none. Normals point towards the side from which the surface
/// was seen; after [`PointCloud::voxel_downsample`] they are averages and not of unit length.
///
/// ```
/// use geometry::{PointCloud, VoxelOrigin};
/// use nalgebra::Point3;
///
/// let line = (0..100).map(|i| Point3::new(0.001 * f64::from(i), 0.0, 0.0)).collect();
/// let cloud = PointCloud { points: line, normals: Vec::new() };
/// assert!(cloud.voxel_downsample(0.01, VoxelOrigin::default()).len() <= 11);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in metres.
    pub points: Vec<Point3<f64>>,
    /// One per point, or empty.
    pub normals: Vec<Vector3<f64>>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Whether every point has a normal.
    pub fn has_normals(&self) -> bool {
        self.normals.len() == self.points.len()
    }

    /// Appends another cloud. Normals survive only if both clouds have them.
    pub fn merge(&mut self, other: &PointCloud) {
        let keep = self.has_normals() && other.has_normals();
        self.points.extend_from_slice(&other.points);
        if keep {
            self.normals.extend_from_slice(&other.normals);
        } else {
            self.normals.clear();
        }
    }

    /// The cloud moved by a rigid motion.
    pub fn transformed(&self, motion: &Isometry3<f64>) -> PointCloud {
        PointCloud {
            points: self.points.iter().map(|p| motion * p).collect(),
            normals: self.normals.iter().map(|n| motion * n).collect(),
        }
    }

    /// Smallest and largest corner of the axis-aligned bounding box; both the origin for an empty cloud.
    pub fn bounding_box(&self) -> (Point3<f64>, Point3<f64>) {
        bounding_box(&self.points)
    }

    /// One point per occupied voxel of edge `voxel` metres: the mean of its points, and of their normals (not
    /// renormalised, as published). In the order in which the voxels first appear; non-finite points are dropped.
    /// A `voxel` that is not positive and finite leaves the cloud as it is.
    pub fn voxel_downsample(&self, voxel: f64, origin: VoxelOrigin) -> PointCloud {
        let voxels = Voxels::new(&self.points, voxel, origin);
        let points = voxels.means(self.points.iter().map(|p| p.coords));
        let normals = if self.has_normals() { voxels.means(self.normals.iter().copied()) } else { Vec::new() };
        PointCloud { points: points.into_iter().map(Point3::from).collect(), normals }
    }
}

/// Points sorted into voxels, which are numbered in the order in which they first appear.
pub struct Voxels {
    /// Per point the number of its voxel; `u32::MAX` for a non-finite point.
    pub number: Vec<u32>,
    /// How many points each voxel holds.
    counts: Vec<u32>,
}

impl Voxels {
    /// Voxels of this edge in metres; where it is not positive and finite, one for each point.
    pub fn new(points: &[Point3<f64>], voxel: f64, origin: VoxelOrigin) -> Self {
        if !(voxel > 0.0 && voxel.is_finite()) {
            return Self { number: (0..points.len() as u32).collect(), counts: vec![1; points.len()] };
        }
        let finite = |p: &Point3<f64>| p.x.is_finite() && p.y.is_finite() && p.z.is_finite();
        let corner = match origin {
            VoxelOrigin::World => Point3::origin(),
            VoxelOrigin::CloudMinimum => {
                let low = points.iter().copied().filter(finite).reduce(|low, p| low.inf(&p));
                low.unwrap_or_else(Point3::origin) - Vector3::repeat(0.5 * voxel)
            }
        };
        let mut numbers = Numbering::with_capacity(points.len());
        let mut counts = Vec::with_capacity(points.len());
        let number = |p: &Point3<f64>| {
            if !finite(p) {
                return u32::MAX;
            }
            let number = numbers.insert(voxel_of(p, &corner, voxel));
            if number == counts.len() {
                counts.push(0);
            }
            counts[number] += 1;
            number as u32
        };
        Self { number: points.iter().map(number).collect(), counts }
    }

    /// Mean of the values, one per point, in each voxel.
    pub fn means(&self, values: impl Iterator<Item = Vector3<f64>>) -> Vec<Vector3<f64>> {
        let mut means = vec![Vector3::zeros(); self.counts.len()];
        for (&number, value) in self.number.iter().zip(values) {
            if let Some(sum) = means.get_mut(number as usize) {
                *sum += value;
            }
        }
        means.iter_mut().zip(&self.counts).for_each(|(sum, &count)| *sum /= f64::from(count));
        means
    }
}

/// Indices of the voxel that holds a point.
fn voxel_of(p: &Point3<f64>, corner: &Point3<f64>, voxel: f64) -> [i64; 3] {
    let index = |axis: usize| {
        // The floor, without the call that it is where the target has no instruction for it.
        let exact = (p[axis] - corner[axis]) / voxel;
        let towards_zero = exact as i64;
        towards_zero.saturating_sub(i64::from(towards_zero as f64 > exact))
    };
    [index(0), index(1), index(2)]
}

/// Numbers keys in the order of their first appearance: a table with open addressing. (The standard map's keyed hash
/// costs three times as much.)
pub(crate) struct Numbering {
    keys: Vec<[i64; 3]>,
    slots: Vec<u32>,
}

impl Numbering {
    pub(crate) fn with_capacity(keys: usize) -> Self {
        Self { keys: Vec::with_capacity(keys), slots: vec![u32::MAX; (2 * keys.max(8)).next_power_of_two()] }
    }

    /// The number of the key; equals the number of keys before the call if it is new. At most the capacity may be
    /// inserted.
    #[inline]
    pub(crate) fn insert(&mut self, key: [i64; 3]) -> usize {
        let mask = self.slots.len() - 1;
        let mixed = key.iter().fold(0u64, |h, &k| (h ^ k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
        let mut at = mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15) as usize >> 20 & mask;
        loop {
            match self.slots[at] {
                u32::MAX => {
                    self.slots[at] = self.keys.len() as u32;
                    self.keys.push(key);
                    return self.keys.len() - 1;
                }
                slot if self.keys[slot as usize] == key => return slot as usize,
                _ => at = (at + 1) & mask,
            }
        }
    }
}

/// Smallest and largest corner of the points' bounding box; both the origin if there is no point.
pub(crate) fn bounding_box(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let Some(first) = points.first() else {
        return (Point3::origin(), Point3::origin());
    };
    points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)))
}

#[cfg(test)]
mod tests;
