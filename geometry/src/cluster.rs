//! Representatives of a point set by k-means, and their order (docs/method.md, 'Boundary and candidate views', 3
//! and 4).

use nalgebra::Point3;
use rand::distr::{Distribution, weighted::WeightedIndex};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Rounds of the k-means at most.
const ITERATIONS: usize = 10;
/// The k-means ends when its means, taken as one vector, move by less, metres.
const TOLERANCE: f64 = 1e-9;

/// Indices of up to `k` points, one per k-means cluster: the member nearest to the mean of the members. Clusters
/// come in the order in which they first appear along the points; empty ones disappear. Points must be finite.
pub fn representatives(points: &[Point3<f64>], k: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    representatives_of(points, &kmeans_labels(points, k, rng))
}

/// Cluster of each point. Each call takes one seed from `rng`, whatever the points.
fn kmeans_labels(points: &[Point3<f64>], k: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut seeded = ChaCha8Rng::from_seed(rng.random());
    let k = k.min(points.len());
    if k == 0 {
        return Vec::new();
    }
    // Relative to one of the points, because coordinates are squared.
    let data = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis] - points[0][axis]).collect::<Vec<f64>>());
    kmeans(&data, k, &mut seeded)
}

/// Lloyd's algorithm from k-means++ seeds; a mean moves as if it were one more member of its cluster, so that an empty
/// one stays where it is. 0.1 ms at 400 points and k = 20.
fn kmeans(data: &[Vec<f64>; 3], k: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let n = data[0].len();
    let point = |i: usize| [0, 1, 2].map(|axis| data[axis][i]);
    let mut nearest = Nearest { label: vec![0; n], distance2: vec![f64::INFINITY; n] };
    let first = WeightedIndex::new(std::iter::repeat_n(1.0, n)).map_or(0, |index| index.sample(rng));
    let mut means = vec![point(first)];
    while means.len() < k {
        nearest.update(data, means.len() - 1, &means[means.len() - 1]);
        // Where every point is a mean already, any will do.
        let next = WeightedIndex::new(&nearest.distance2).map_or(0, |index| index.sample(rng));
        means.push(point(next));
    }
    for _ in 0..ITERATIONS {
        nearest.find(data, &means);
        let mut sums = vec![[0.0; 3]; k];
        let mut counts = vec![1.0; k];
        for (i, &label) in nearest.label.iter().enumerate() {
            for (sum, x) in sums[label as usize].iter_mut().zip(point(i)) {
                *sum += x;
            }
            counts[label as usize] += 1.0;
        }
        let mut moved2 = 0.0;
        for ((mean, sum), count) in means.iter_mut().zip(&sums).zip(&counts) {
            for (x, sum) in mean.iter_mut().zip(sum) {
                let new = (sum + *x) / count;
                moved2 += (*x - new) * (*x - new);
                *x = new;
            }
        }
        if moved2.sqrt() < TOLERANCE {
            break;
        }
    }
    if nearest.distance2.iter().sum::<f64>() < f64::INFINITY {
        nearest.find(data, &means);
    } else {
        nearest.label.fill(0); // beyond the range of numbers: one cluster
    }
    nearest.label.iter().map(|&label| label as usize).collect()
}

/// The nearest mean of each point.
struct Nearest {
    label: Vec<u64>,
    distance2: Vec<f64>,
}

impl Nearest {
    fn find(&mut self, data: &[Vec<f64>; 3], means: &[[f64; 3]]) {
        self.label.fill(0);
        self.distance2.fill(f64::INFINITY);
        for (label, mean) in means.iter().enumerate() {
            self.update(data, label, mean);
        }
    }

    /// Takes one more mean into account; ties go to the earlier one.
    fn update(&mut self, data: &[Vec<f64>; 3], label: usize, mean: &[f64; 3]) {
        let points = data[0].iter().zip(&data[1]).zip(&data[2]);
        for (((x, y), z), (nearest, least)) in points.zip(self.label.iter_mut().zip(&mut self.distance2)) {
            let (dx, dy, dz) = (mean[0] - x, mean[1] - y, mean[2] - z);
            let distance2 = dx * dx + dy * dy + dz * dz;
            let closer = distance2 < *least;
            *nearest = if closer { label as u64 } else { *nearest };
            *least = if closer { distance2 } else { *least };
        }
    }
}

fn representatives_of(points: &[Point3<f64>], labels: &[usize]) -> Vec<usize> {
    let num_labels = labels.iter().max().map_or(0, |l| l + 1);
    let (mut sums, mut counts) = (vec![nalgebra::Vector3::zeros(); num_labels], vec![0.0f64; num_labels]);
    let mut order = Vec::new();
    for (p, &label) in points.iter().zip(labels) {
        if counts[label] == 0.0 {
            order.push(label);
        }
        sums[label] += p.coords;
        counts[label] += 1.0;
    }
    let nearest = |&label: &usize| {
        let mean = sums[label] / counts[label];
        let members = (0..points.len()).filter(|&i| labels[i] == label);
        members
            .map(|i| ((points[i].coords - mean).norm_squared(), i))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, i)| i)
    };
    order.iter().filter_map(nearest).collect()
}

/// Order of a greedy traversal: the first point, then always the nearest one not yet visited (ties: the earlier).
pub fn nearest_neighbor_order(points: &[Point3<f64>]) -> Vec<usize> {
    let mut rest: Vec<usize> = (1..points.len()).collect();
    let mut order: Vec<usize> = (0..points.len().min(1)).collect();
    while let Some(&last) = order.last().filter(|_| !rest.is_empty()) {
        let distance = |&i: &usize| (points[i] - points[last]).norm_squared();
        let next = (0..rest.len()).min_by(|&a, &b| distance(&rest[a]).total_cmp(&distance(&rest[b])));
        order.extend(next.map(|i| rest.remove(i)));
    }
    order
}

#[cfg(test)]
mod tests;
