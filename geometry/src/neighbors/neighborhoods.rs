//! The nearest neighbours of every point of a cloud, found anew or kept while the cloud grows.

use super::{NeighborGrid, neighbor};
use crate::cloud::Numbering;
use nalgebra::Point3;
use rayon::prelude::*;

/// The `k` nearest neighbours of every point of a cloud, the point itself included, nearest first.
#[derive(Clone, Debug, Default)]
pub struct Neighborhoods {
    k: usize,
    pub(super) ids: Vec<u32>,
    pub(super) distances2: Vec<f32>,
    /// Per point the sum of the distances.
    sums: Vec<f64>,
}

impl Neighborhoods {
    /// The `k` nearest neighbours of each of these points, itself included.
    pub fn of(points: &[Point3<f64>], k: usize) -> Self {
        NeighborGrid::new(points, 0.0).neighborhoods(points.len(), k)
    }

    /// Rows of points that the grid leaves out, yet to be filled.
    fn unknown(num_points: usize, k: usize) -> Self {
        let (ids, distances2) = (vec![u32::MAX; num_points * k], vec![f32::INFINITY; num_points * k]);
        Self { k, ids, distances2, sums: vec![f64::INFINITY; num_points] }
    }

    /// Neighbours per point: the k asked for, or the number of points if that is smaller.
    pub fn k(&self) -> usize {
        self.k
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.ids.len() / self.k.max(1)
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Indices of the neighbours of point `i`, sorted by (distance, index). `u32::MAX` fills the row of a
    /// non-finite point, whose distances are infinite.
    pub fn ids(&self, i: usize) -> &[u32] {
        &self.ids[i * self.k..(i + 1) * self.k]
    }

    /// Squared distances to the neighbours of point `i`, rising.
    pub fn distances2(&self, i: usize) -> &[f32] {
        &self.distances2[i * self.k..(i + 1) * self.k]
    }

    /// Sum of the distances to the neighbours of point `i` (to itself: 0), metres; infinite for a non-finite point.
    pub fn distance_sum(&self, i: usize) -> f64 {
        self.sums[i]
    }

    /// Mean over all points of the mean distance to the other k - 1 neighbours, metres; 0 under two points.
    /// With k = 30 this is the radius of the boundary criterion (docs/method.md, 'Boundary and candidate views', 1).
    pub fn mean_distance(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0usize);
        for i in 0..self.len() {
            let distance = self.distance_sum(i);
            if distance.is_finite() {
                sum += distance;
                count += 1;
            }
        }
        if self.k < 2 || count == 0 { 0.0 } else { sum / (count * (self.k - 1)) as f64 }
    }

    /// Sets the row of point `i` from sorted keys.
    fn set(&mut self, i: usize, keys: &[u64]) {
        let row = i * self.k..(i + 1) * self.k;
        for ((id, d2), &key) in self.ids[row.clone()].iter_mut().zip(&mut self.distances2[row]).zip(keys) {
            (*id, *d2) = (key as u32, f32::from_bits((key >> 32) as u32));
        }
        self.sums[i] = self.distances2(i).iter().map(|&d2| f64::from(d2).sqrt()).sum();
    }

    /// Takes the row of point `old` of another cloud over as that of point `i`.
    fn copy(&mut self, i: usize, from: &Self, old: usize, new_indices: &[u32]) {
        let row = i * self.k..(i + 1) * self.k;
        self.distances2[row.clone()].copy_from_slice(from.distances2(old));
        self.ids[row].iter_mut().zip(from.ids(old)).for_each(|(new, &old)| *new = new_indices[old as usize]);
        self.sums[i] = from.sums[old];
    }
}

impl NeighborGrid {
    /// The `k` nearest neighbours of every point of the grid, itself included. `num_points` is the length of the
    /// slice that the grid was built from (rows of left-out points stay empty, see [`Neighborhoods::ids`]).
    pub fn neighborhoods(&self, num_points: usize, k: usize) -> Neighborhoods {
        let mut rows = Neighborhoods::unknown(num_points, k.min(self.len()));
        let mut finder = RowFinder::new(self);
        for (slot, &id) in self.ids.iter().enumerate() {
            rows.set(id as usize, finder.find(slot, rows.k, f32::INFINITY));
        }
        rows
    }

    /// [`Self::neighborhoods`] on all cores: the same answers.
    pub fn neighborhoods_in_parallel(&self, num_points: usize, k: usize) -> Neighborhoods {
        const SLOTS: usize = 512;
        let k = k.min(self.len());
        let find = |first: usize| {
            let mut finder = RowFinder::new(self);
            let slots = first..(first + SLOTS).min(self.len());
            let mut keys = Vec::with_capacity(slots.len() * k);
            slots.for_each(|slot| keys.extend_from_slice(finder.find(slot, k, f32::INFINITY)));
            keys
        };
        let keys: Vec<Vec<u64>> = (0..self.len()).into_par_iter().step_by(SLOTS).map(find).collect();
        let mut rows = Neighborhoods::unknown(num_points, k);
        for (&id, keys) in self.ids.iter().zip(keys.iter().flat_map(|keys| keys.chunks_exact(k.max(1)))) {
            rows.set(id as usize, keys);
        }
        rows
    }
}

/// Finds rows one after the other.
struct RowFinder<'a> {
    grid: &'a NeighborGrid,
    keys: Vec<u64>,
    /// A radius that has held the neighbours of most points so far.
    radius: f32,
}

impl<'a> RowFinder<'a> {
    fn new(grid: &'a NeighborGrid) -> Self {
        Self { grid, keys: Vec::new(), radius: 0.0 }
    }

    /// Keys of the `k` nearest of the point in a slot of the grid, sorted. `guess`: a radius that may hold them.
    fn find(&mut self, slot: usize, k: usize, guess: f32) -> &[u64] {
        let grid = self.grid;
        let guess = if self.radius > 0.0 { guess.min(self.radius) } else { guess };
        let guess = if guess.is_finite() { guess } else { 0.0 };
        let keys = grid.nearest_keys([grid.x[slot], grid.y[slot], grid.z[slot]], k, guess, &mut self.keys);
        let furthest = keys.last().map_or(0.0, |&key| neighbor(key).distance2.sqrt());
        self.radius = 0.9 * self.radius + 0.1 * 1.3 * furthest;
        if self.radius < furthest {
            self.radius = 1.15 * furthest;
        }
        keys
    }
}

/// The neighbourhoods of a cloud that grows from scan to scan: rows near which nothing changed are kept, and the
/// others are looked for where they were.
#[derive(Clone, Debug, Default)]
pub struct GrowingNeighborhoods {
    origin: [f64; 3],
    points: Vec<Point3<f64>>,
    rows: Neighborhoods,
}

impl GrowingNeighborhoods {
    /// The neighbourhoods of these points, of which `grid` is the grid: the same as [`NeighborGrid::neighborhoods`].
    pub fn update(&mut self, grid: &NeighborGrid, points: &[Point3<f64>], k: usize) -> &Neighborhoods {
        let before = std::mem::take(self);
        let mut rows = Neighborhoods::unknown(points.len(), k.min(grid.len()));
        let comparable = before.origin == grid.origin && before.rows.k == rows.k && rows.k > 0;
        let kept = Kept::between(if comparable { &before.points } else { &[] }, points);
        let added = points.iter().zip(&kept.old).filter(|&(_, &old)| old == NONE).map(|(p, _)| *p).collect::<Vec<_>>();
        let added = NeighborGrid::build(&added, f64::from(1.0 / grid.inv_cell), Some(grid.origin));
        let mut finder = RowFinder::new(grid);
        for slot in 0..grid.len() {
            let i = grid.ids[slot] as usize;
            let stayed = kept.old[i] != NONE;
            // A point that moved has most often kept its place in the order.
            let old = if stayed { kept.old[i] as usize } else { i };
            if old >= kept.new.len() {
                rows.set(i, finder.find(slot, rows.k, f32::INFINITY));
                continue;
            }
            let furthest = before.rows.distances2(old)[rows.k - 1].sqrt();
            let neighbors_stayed = || before.rows.ids(old).iter().all(|&id| kept.new[id as usize] != NONE);
            let stayed = stayed && neighbors_stayed();
            // Slightly further, for rounding.
            let reach = 1.0001 * furthest;
            if stayed && furthest > 0.0 && !added.any_within(&points[i], f64::from(reach)) {
                rows.copy(i, &before.rows, old, &kept.new);
                continue;
            }
            // Where points were only added, the neighbours are no further than they were.
            let moved = (points[i] - before.points[old]).norm() as f32;
            let guess = if stayed { reach } else { 1.04 * furthest + moved };
            rows.set(i, finder.find(slot, rows.k, guess));
        }
        *self = Self { origin: grid.origin, points: points.to_vec(), rows };
        &self.rows
    }
}

/// No index.
const NONE: u32 = u32::MAX;

/// Which points of two clouds are the same, to the last bit.
struct Kept {
    /// Per old point the index of the new one, or [`NONE`].
    new: Vec<u32>,
    /// Per new point the index of the old one, or [`NONE`].
    old: Vec<u32>,
}

impl Kept {
    /// None at all if old points occur twice or stand in another order: ties between neighbours depend on it.
    fn between(old: &[Point3<f64>], new: &[Point3<f64>]) -> Self {
        let key = |p: &Point3<f64>| [p.x, p.y, p.z].map(|x| x.to_bits() as i64);
        let none = || Self { new: vec![NONE; old.len()], old: vec![NONE; new.len()] };
        let mut numbers = Numbering::with_capacity(old.len() + new.len());
        if !old.iter().enumerate().all(|(i, p)| numbers.insert(key(p)) == i) {
            return none();
        }
        let (mut kept, mut next) = (none(), 0);
        for (i, p) in new.iter().enumerate() {
            let number = numbers.insert(key(p));
            if number >= old.len() {
                continue;
            }
            if number < next {
                return none();
            }
            next = number + 1;
            (kept.new[number], kept.old[i]) = (i as u32, number as u32);
        }
        kept
    }
}
