//! Representatives of a point set by k-means, and their order (method, 'Boundary and candidate views', 3 and 4).

use linfa::DatasetBase;
use linfa::traits::{Fit, Predict};
use linfa_clustering::{KMeans, KMeansInit};
use nalgebra::Point3;
use ndarray::Array2;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const ITERATIONS: u64 = 10;

/// Indices of up to `k` points, one per k-means cluster: the member nearest to the mean of the members. Clusters
/// come in the order in which they first appear along the points; empty ones disappear. Points must be finite.
pub fn representatives(points: &[Point3<f64>], k: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    representatives_of(points, &kmeans_labels(points, k, rng))
}

/// Cluster of each point. Each call takes one seed from `rng`, whatever the points.
fn kmeans_labels(points: &[Point3<f64>], k: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let seeded = ChaCha8Rng::from_seed(rng.r#gen());
    let k = k.min(points.len());
    if k == 0 {
        return Vec::new(); // linfa panics
    }
    // Relative to one of the points: linfa squares coordinates.
    let data = Array2::from_shape_fn((points.len(), 3), |(i, axis)| points[i][axis] - points[0][axis]);
    let dataset = DatasetBase::from(data);
    let fitted = KMeans::params_with_rng(k, seeded)
        .n_runs(1)
        .max_n_iterations(ITERATIONS)
        .tolerance(1e-9)
        .init_method(KMeansInit::KMeansPlusPlus)
        .fit(&dataset);
    match fitted {
        Ok(model) => model.predict(&dataset).to_vec(),
        Err(_) => vec![0; points.len()], // non-finite inertia: one cluster
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
            (0..90).map(|i| groups[i % 3] + nalgebra::Vector3::from_fn(|_, _| rng.gen_range(-0.01..0.01))).collect();
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
        let points: Vec<_> = (0..500).map(|_| Point3::from([0; 3].map(|_| rng.gen_range(-0.1..0.1)))).collect();
        let run = || representatives(&points, 20, &mut stream(4, "kmeans"));
        assert_eq!(run(), run());
        assert_eq!(run().len(), 20);
    }

    #[test]
    fn representatives_and_order_equal_the_published_ones() {
        let Some(golden) = Golden::open("c_views.safetensors") else { return };
        for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
            let field = |f: &str| format!("{name}.{f}");
            let boundary = golden.points_f32(&field("boundary_points"));
            let labels: Vec<usize> = golden.i32(&field("kmeans_label")).iter().map(|&l| l as usize).collect();
            let chosen: Vec<_> = representatives_of(&boundary, &labels).into_iter().map(|i| boundary[i]).collect();
            let rows = golden.f32(&field("representatives"));
            let expected: Vec<Point3<f64>> =
                rows.chunks_exact(6).map(|r| Point3::new(r[0], r[1], r[2]).cast()).collect();
            assert_eq!(chosen, expected, "{name}");
            let order: Vec<i32> = nearest_neighbor_order(&chosen).into_iter().map(|i| i as i32).collect();
            assert_eq!(order, golden.i32(&field("nearest_sort_order")), "{name}");
        }
    }
}
