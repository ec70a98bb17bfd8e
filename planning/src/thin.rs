//! Thinning and cleaning of clouds from any sensor, moved exactly by a rigid motion or a change of unit.
//!
//! Voxel averaging depends on how the axes lie; keeping a point only if no kept point is nearer than a radius
//! does not, so the answers for a moved cloud are the moved answers.

use geometry::{Neighborhoods, PointCloud, mean_spacing, rng};
use nalgebra::Point3;
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
        let home = at.map(|x| x.floor() as i64);
        let other = [0, 1, 2].map(|k| if at[k] - at[k].floor() < 0.5 { -1 } else { 1 });
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

/// No kept point.
const NONE: u32 = u32::MAX;

/// The radius that thins a cloud to about `target` points, within a tenth; 0 where there are no more, and for target 0.
/// `spacing` is that of all points ([`spacing_of_all`]), from which the search starts, on at most four times as many points
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
    let mut radius = 0.8 * (some.len() as f64 / target as f64 - 1.0).sqrt() * 2.0 * spacing;
    for _ in 0..SEARCHES {
        if !(radius > 0.0 && radius.is_finite()) {
            break;
        }
        let left = thin(&some, radius).len();
        if left.abs_diff(wanted) * 20 <= wanted {
            break;
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
    radius
}

/// Radii tried at most.
const SEARCHES: usize = 8;

/// Mean distance of neighbours in the whole cloud, from at most `most` of its points at random: spread evenly over a
/// surface, n of N points are sqrt(N / n) times farther apart.
pub fn spacing_of_all(points: &[Point3<f64>], most: usize, seed: u64) -> f64 {
    let some = sample(points, most, seed, "infer/spacing");
    mean_spacing(&some) * (some.len() as f64 / points.len().max(1) as f64).sqrt()
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

/// Indices of the points whose mean distance to their eight nearest neighbours is at most `factor` times the
/// median of that, rising. Factor 0, or fewer than nine points: all. `near` has nine points or more.
pub fn without_outliers(near: &Neighborhoods, factor: f64) -> Vec<usize> {
    const NEIGHBORS: usize = 8;
    let all = 0..near.len();
    if factor == 0.0 || near.k() <= NEIGHBORS {
        return all.collect();
    }
    let distance = |i: usize| near.distances2(i)[..=NEIGHBORS].iter().map(|&d2| f64::from(d2).sqrt()).sum();
    let distances: Vec<f64> = all.clone().map(distance).collect();
    let mut sorted = distances.clone();
    let (_, median, _) = sorted.select_nth_unstable_by(all.len() / 2, f64::total_cmp);
    let most = factor * *median;
    all.filter(|&i| distances[i] <= most).collect()
}

#[cfg(test)]
mod tests;
