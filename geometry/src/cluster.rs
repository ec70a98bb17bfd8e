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
mod tests {
    use super::*;
    use crate::golden::Golden;
    use crate::rng::stream;

    #[test]
    fn well_separated_groups_are_found() {
        let groups = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 5.0, 1.0)];
        let mut rng = stream(1, "cluster");
        let points: Vec<_> =
            (0..90).map(|i| groups[i % 3] + nalgebra::Vector3::from_fn(|_, _| rng.random_range(-0.01..0.01))).collect();
        let mut found = representatives(&points, 3, &mut rng).iter().map(|i| i % 3).collect::<Vec<_>>();
        found.sort_unstable();
        assert_eq!(found, [0, 1, 2]);
    }

    #[test]
    fn few_identical_and_no_points() {
        let mut rng = stream(2, "cluster");
        assert!(representatives(&[], 20, &mut rng).is_empty());
        assert_eq!(representatives(&vec![Point3::new(1.0, 1.0, 1.0); 600], 20, &mut rng).len(), 1);
        let five: Vec<_> = (0..5).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let mut all = representatives(&five, 20, &mut rng);
        all.sort_unstable();
        assert!(!all.is_empty() && all.len() <= 5);
        assert!(nearest_neighbor_order(&[]).is_empty());
    }

    #[test]
    fn the_same_stream_gives_the_same_clusters() {
        let mut rng = stream(3, "cluster");
        let points: Vec<_> = (0..500).map(|_| Point3::from([0; 3].map(|_| rng.random_range(-0.1..0.1)))).collect();
        let run = || representatives(&points, 20, &mut stream(4, "kmeans"));
        assert_eq!(run(), run());
        assert_eq!(run().len(), 20);
    }

    #[test]
    fn representatives_and_order_equal_the_definition() {
        let (clouds, golden) = (Golden::open("boundary.safetensors"), Golden::open("views.safetensors"));
        for name in ["sphere", "torus"] {
            let field = |f: &str| format!("{name}.{f}");
            let points = clouds.points(&field("points"));
            let index = golden.indices(&field("boundary_index"));
            let boundary: Vec<_> = index.iter().map(|&i| points[i]).collect();
            let chosen = representatives_of(&boundary, &golden.indices(&field("kmeans_label")));
            let ids: Vec<_> = chosen.iter().map(|&i| index[i]).collect();
            assert_eq!(ids, golden.indices(&field("representative_index")), "{name}");
            let chosen: Vec<_> = ids.iter().map(|&i| points[i]).collect();
            assert_eq!(nearest_neighbor_order(&chosen), golden.indices(&field("nearest_sort_order")), "{name}");
        }
    }

    #[test]
    fn groups_apart_are_divided_as_scipy_divides_them() {
        let golden = Golden::open("views.safetensors");
        let (points, expected) = (golden.points("groups.points"), golden.indices("groups.label"));
        let found = (0..20).filter(|&run| {
            let ours = kmeans_labels(&points, 12, &mut stream(run, "groups"));
            let pairs: std::collections::BTreeSet<_> = ours.iter().zip(&expected).collect();
            pairs.len() == 12 && ours.iter().max() == Some(&11)
        });
        // A draw of the seeds may put two into one group, as SciPy's may.
        let found = found.count();
        println!("{found} of 20");
        assert!(found >= 10, "{found} of 20");
    }

    #[test]
    fn clusters_are_as_tight_as_those_of_scipy() {
        let (clouds, golden) = (Golden::open("boundary.safetensors"), Golden::open("views.safetensors"));
        for name in ["sphere", "torus"] {
            let points = clouds.points(&format!("{name}.points"));
            let index = golden.indices(&format!("{name}.boundary_index"));
            let boundary: Vec<_> = index.iter().map(|&i| points[i]).collect();
            let spread = |run: u64| -> f64 {
                let labels = kmeans_labels(&boundary, 20, &mut stream(run, "tight"));
                let members =
                    |l: usize| (0..labels.len()).filter(|&i| labels[i] == l).map(|i| boundary[i].coords).collect();
                (0..20)
                    .map(members)
                    .map(|group: Vec<nalgebra::Vector3<f64>>| {
                        let mean = group.iter().sum::<nalgebra::Vector3<f64>>() / group.len() as f64;
                        group.iter().map(|p| (p - mean).norm_squared()).sum::<f64>()
                    })
                    .sum()
            };
            let ours = (0..100).map(spread).sum::<f64>() / 100.0;
            let expected = golden.f64(&format!("{name}.kmeans_inertia"))[0];
            println!("{name}: {ours:.4e} for SciPy's {expected:.4e}");
            // Means over 100 draws of the seeds; single ones vary by 6 %.
            assert!((ours / expected - 1.0).abs() < 0.03, "{name}: {ours} for {expected}");
        }
    }

    #[test]
    fn bonus_representatives_and_order_equal_the_published_ones() {
        let Some(golden) = Golden::bonus("c_views.safetensors") else { return };
        for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
            let field = |f: &str| format!("{name}.{f}");
            let boundary = golden.points(&field("boundary_points"));
            let chosen = representatives_of(&boundary, &golden.indices(&field("kmeans_label")));
            let chosen: Vec<_> = chosen.into_iter().map(|i| boundary[i]).collect();
            assert_eq!(chosen, golden.cloud(&field("representatives")).points, "{name}");
            assert_eq!(nearest_neighbor_order(&chosen), golden.indices(&field("nearest_sort_order")), "{name}");
        }
    }
}
