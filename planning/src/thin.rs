//! Thinning and cleaning of clouds from any sensor, moved exactly by a rigid motion or a change of unit.
//!
//! Voxel averaging depends on how the axes lie; keeping a point only if no kept point is nearer than a radius
//! does not, so the answers for a moved cloud are the moved answers.

use geometry::{Neighborhoods, PointCloud, mean_spacing, rng};
use nalgebra::{Matrix3, Point3, Vector3};
use rand::seq::index;
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};

/// Indices of the points that no earlier kept point is nearer to than `radius`, rising. Radius 0 keeps all but
/// exact duplicates.
pub fn thin(points: &[Point3<f64>], radius: f64) -> Vec<usize> {
    let Some(origin) = points.first() else { return Vec::new() };
    if radius == 0.0 {
        let mut seen = FxHashSet::with_capacity_and_hasher(points.len(), FxBuildHasher);
        // Both zeros are one.
        let bits = |p: &Point3<f64>| [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
        return (0..points.len()).filter(|&i| seen.insert(bits(&points[i]))).collect();
    }
    // What is nearer than the radius lies in one of two cells along each axis.
    let cell = (2.0 * radius).max(f64::MIN_POSITIVE);
    let mut last_kept: FxHashMap<(i64, i64, i64), u32> = FxHashMap::default();
    // The kept point before it in its cell.
    let mut before: Vec<u32> = Vec::new();
    let mut kept: Vec<usize> = Vec::new();
    let radius2 = radius * radius;
    for (i, p) in points.iter().enumerate() {
        let at = [0, 1, 2].map(|k| (p[k] - origin[k]) / cell);
        let home = at.map(floor);
        let other = [0, 1, 2].map(|k| if at[k] - (home[k] as f64) < 0.5 { -1 } else { 1 });
        let taken = (0..8).any(|corner| {
            let near = [0, 1, 2].map(|k| home[k].saturating_add(if corner >> k & 1 == 1 { other[k] } else { 0 }));
            let mut next = last_kept.get(&near.into()).copied().unwrap_or(NONE);
            while next != NONE && (points[kept[next as usize]] - p).norm_squared() >= radius2 {
                next = before[next as usize];
            }
            next != NONE
        });
        if !taken {
            before.push(last_kept.insert(home.into(), kept.len() as u32).unwrap_or(NONE));
            kept.push(i);
        }
    }
    kept
}

/// [`f64::floor`] as an integer: that is a call into the C library where the build may not count on SSE 4.1.
fn floor(x: f64) -> i64 {
    let toward_zero = x as i64;
    toward_zero - i64::from(x < toward_zero as f64)
}

/// No kept point.
const NONE: u32 = u32::MAX;

/// What thinning leaves.
pub struct Thinned {
    /// Of the points kept, rising.
    pub indices: Vec<usize>,
    /// Points left out as equal to one kept, where that was all.
    pub duplicates: usize,
}

/// Thins a cloud by a radius ([`radius_for`]) to about `target` points, or all for 0: where too many are as far apart as each
/// other (a lattice), chance takes the rest.
pub fn thin_to(points: &[Point3<f64>], radius: f64, target: usize, seed: u64) -> Thinned {
    let mut indices = thin(points, radius);
    let duplicates = if radius == 0.0 { points.len() - indices.len() } else { 0 };
    let most = target + target / 10;
    if target > 0 && indices.len() > most && radius > 0.0 {
        let fewer = thin(points, radius * (indices.len() as f64 / target as f64).sqrt());
        if fewer.len() * 5 >= target * 4 {
            indices = fewer;
        }
    }
    if target > 0 && indices.len() > most {
        let mut chosen = index::sample(&mut rng::stream(seed, "infer/thin/rest"), indices.len(), target).into_vec();
        chosen.sort_unstable();
        indices = chosen.into_iter().map(|i| indices[i]).collect();
    }
    Thinned { indices, duplicates }
}

/// The radius that thins a cloud to about `target` points, within a tenth, or the largest found that leaves more; 0 where
/// there are no more, and for target 0. `spacing` is that of all points ([`spacing_of_all`]), from which the search starts, on at most four times as many points
/// as shall stay, taken at random.
pub fn radius_for(points: &[Point3<f64>], target: usize, spacing: f64, seed: u64) -> f64 {
    if target == 0 || points.len() <= target {
        return 0.0;
    }
    let some = sample(points, 4 * target, seed, "infer/thin");
    let spacing = spacing * (points.len() as f64 / some.len() as f64).sqrt();
    // More points leave a few more room to fit.
    let more = 1.0 + 0.25 * (1.0 - some.len() as f64 / points.len() as f64);
    let wanted = (target as f64 / more) as usize;
    let (mut low, mut high) = (0.0, f64::INFINITY);
    let mut closest = (f64::INFINITY, 0.0);
    let mut radius = 0.8 * (some.len() as f64 / target as f64 - 1.0).sqrt() * 2.0 * spacing;
    for _ in 0..SEARCHES {
        if !(radius > 0.0 && radius.is_finite()) {
            break;
        }
        let left = thin(&some, radius).len();
        let off = (left as f64 / wanted.max(1) as f64).ln().abs();
        if off <= CLOSE {
            return radius;
        }
        if off < closest.0 {
            closest = (off, radius);
        }
        if left > wanted {
            low = radius
        } else {
            high = radius
        }
        // Of N points taken at random, N / (1 + (r / r0)^2) are left.
        let odds = |n: usize| (some.len() as f64 / n.max(1) as f64 - 1.0).max(1e-9);
        let next = radius * (odds(wanted) / odds(left)).sqrt();
        radius = if next > low && next < high { next } else { 0.5 * (low + high.min(2.0 * radius)) };
    }
    if closest.0 <= NEAR { closest.1 } else { low }
}

/// How far the number that a radius leaves may be off what is wanted (a logarithm): so that no other is tried, and so that it
/// serves at all.
const CLOSE: f64 = 0.05;
const NEAR: f64 = 0.2;
/// Radii tried at most.
const SEARCHES: usize = 8;

/// Mean distance of neighbours in the whole cloud, from at most `most` of its points at random: spread evenly over a
/// surface, n of N points are sqrt(N / n) times farther apart.
pub fn spacing_of_all(points: &[Point3<f64>], most: usize, seed: u64) -> f64 {
    let some = sample(points, most, seed, "infer/spacing");
    mean_spacing(&some, &Neighborhoods::of(&some, 2)) * (some.len() as f64 / points.len().max(1) as f64).sqrt()
}

/// At most this many of the points at random, in their order.
pub fn sample(points: &[Point3<f64>], most: usize, seed: u64, stream: &str) -> Vec<Point3<f64>> {
    if points.len() <= most {
        return points.to_vec();
    }
    let mut chosen = index::sample(&mut rng::stream(seed, stream), points.len(), most).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|i| points[i]).collect()
}

/// The points (and normals) at these indices.
pub fn select(cloud: &PointCloud, indices: &[usize]) -> PointCloud {
    let normals = if cloud.has_normals() { indices.iter().map(|&i| cloud.normals[i]).collect() } else { Vec::new() };
    PointCloud { points: indices.iter().map(|&i| cloud.points[i]).collect(), normals }
}

/// Neighbours that say how far a point is from others.
const NEIGHBORS: usize = 8;
/// A point's surroundings are a surface where they spread so much less in one direction than in a second (variances).
const FLAT: f64 = 0.1;

/// Indices of the points that are not far from all others, rising: those whose mean distance to their eight nearest
/// neighbours is at most `factor` times the median of that, and those of a surface that was sampled more sparsely than most
/// of the cloud. Factor 0, or fewer than nine points: all. `near` has nine points or more.
pub fn without_outliers(points: &[Point3<f64>], near: &Neighborhoods, factor: f64) -> Vec<usize> {
    let all = 0..near.len();
    if factor == 0.0 || near.k() <= NEIGHBORS {
        return all.collect();
    }
    let distance = |i: usize| near.distances2(i)[..=NEIGHBORS].iter().map(|&d2| f64::from(d2).sqrt()).sum();
    let distances: Vec<f64> = all.clone().map(distance).collect();
    let mut sorted = distances.clone();
    let (_, median, _) = sorted.select_nth_unstable_by(all.len() / 2, f64::total_cmp);
    let most = factor * *median;
    let far = |&i: &usize| distances[i] > most;
    if !all.clone().any(|i| far(&i)) {
        return all.collect();
    }
    let mut nearest_to = vec![Vec::new(); near.len()];
    for i in all.clone() {
        for &j in near.ids(i)[..=NEIGHBORS].iter().filter(|&&j| j != u32::MAX && j as usize != i) {
            nearest_to[j as usize].push(i);
        }
    }
    all.filter(|i| !far(i) || on_surface(points, &nearest_to, &distances, *i)).collect()
}

/// Whether a point is one of at least nine that lie about flat and have each other among their nearest: `nearest_to` lists
/// who has a point among those, at which distances. What flies about is near to nobody, who all have nearer ones, or to
/// others scattered in all directions.
fn on_surface(points: &[Point3<f64>], nearest_to: &[Vec<usize>], distances: &[f64], i: usize) -> bool {
    let mut patch = vec![i];
    let mut next = 0;
    while next < patch.len() && patch.len() <= 2 * NEIGHBORS {
        let others = nearest_to[patch[next]].iter().filter(|&&j| distances[j] <= 4.0 * distances[i]);
        for &j in others {
            if !patch.contains(&j) {
                patch.push(j);
            }
        }
        next += 1;
    }
    if patch.len() <= NEIGHBORS {
        return false;
    }
    let middle = patch.iter().map(|&j| points[j] - points[i]).sum::<Vector3<f64>>() / patch.len() as f64;
    let spread: Matrix3<f64> = patch
        .iter()
        .map(|&j| {
            let d = points[j] - points[i] - middle;
            d * d.transpose()
        })
        .sum();
    let mut spread: [f64; 3] = spread.symmetric_eigenvalues().into();
    spread.sort_by(f64::total_cmp);
    spread[0] <= FLAT * spread[1]
}

#[cfg(test)]
mod tests;
