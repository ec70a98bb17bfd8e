//! Nearest neighbours in feature space, for PC-NBV's dynamic graphs.

use burn::tensor::{Int, Tensor, TensorData};
use rayon::prelude::*;
use std::collections::HashSet;

/// For every point the `k` nearest others in the features [B*N, C] of the same cloud, as rows of the same table,
/// [B*N*k]. The nearest of k + 1 is dropped as the point itself. Exact duplicates are pushed away, all but their first
/// copy, by the cloud's largest distance, as PC-NBV's PyTorch re-implementation does. Ties go to the lower
/// index. Needs N > k.
///
/// On the CPU whatever the device: indices carry no gradient, and the choice must not depend on it.
pub(crate) fn nearest_in_feature_space(features: &Tensor<2>, b: usize, n: usize, k: usize) -> Tensor<1, Int> {
    let device = features.device().inner();
    let [_, c] = features.dims();
    let data = features.clone().without_autodiff().into_data().convert::<f32>();
    let values = data.as_slice::<f32>().unwrap_or(&[]);
    assert_eq!(values.len(), b * n * c, "features of {b} clouds of {n} points");
    assert!(n > k, "{n} points have no {k} neighbours each");
    let indices: Vec<i32> = (0..b)
        .into_par_iter()
        .flat_map_iter(|cloud| nearest_in_cloud(&values[cloud * n * c..(cloud + 1) * n * c], c, k, cloud * n))
        .collect();
    Tensor::from_ints(TensorData::new(indices, [b * n * k]), &device)
}

fn nearest_in_cloud(values: &[f32], c: usize, k: usize, offset: usize) -> Vec<i32> {
    let points: Vec<&[f32]> = values.chunks_exact(c).collect();
    // Channel by channel, so that the distances of a point to all others are sums of whole rows.
    let channels: Vec<Vec<f32>> = (0..c).map(|i| points.iter().map(|p| p[i]).collect()).collect();
    let squares = |a: &[f32], out: &mut [f32]| {
        out.fill(0.0);
        for (&x, channel) in a.iter().zip(&channels) {
            out.iter_mut().zip(channel).for_each(|(sum, y)| *sum += (x - y) * (x - y));
        }
    };
    let mut seen = HashSet::new();
    let repeated: Vec<bool> =
        points.iter().map(|p| !seen.insert(p.iter().map(|x| (x + 0.0).to_bits()).collect::<Vec<_>>())).collect();
    let mut distances = vec![0.0f32; points.len()];
    let mut away = 0.0f32;
    if repeated.contains(&true) {
        for a in &points {
            squares(a, &mut distances);
            away = distances.iter().copied().fold(away, f32::max);
        }
    }
    let mut out = Vec::with_capacity(points.len() * k);
    let mut order: Vec<(f32, i32)> = Vec::with_capacity(points.len());
    for a in &points {
        squares(a, &mut distances);
        let pushed = distances.iter().zip(&repeated).map(|(d, repeated)| d + if *repeated { away } else { 0.0 });
        order.clear();
        order.extend(pushed.zip(0..));
        let by_distance = |x: &(f32, i32), y: &(f32, i32)| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1));
        order.select_nth_unstable_by(k, by_distance);
        order[..=k].sort_unstable_by(by_distance);
        out.extend(order[1..=k].iter().map(|(_, j)| offset as i32 + j));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_on_a_line() {
        let values = [0.0, 1.0, 2.5, 4.5, 7.0f32];
        assert_eq!(nearest_in_cloud(&values, 1, 2, 10), [11, 12, 10, 12, 11, 13, 12, 14, 13, 12]);
    }

    #[test]
    fn duplicates_do_not_crowd_out_others() {
        // Three copies of 0: the two later ones are pushed away by 100, the squared extent.
        let values = [0.0, 0.0, 0.0, 1.0, 10.0f32];
        let nearest = nearest_in_cloud(&values, 1, 2, 0);
        assert_eq!(nearest[..2], [3, 1], "10 away stands behind a copy at 0 + 100 by its index");
        assert_eq!(nearest[2..4], [3, 1], "a later copy drops the first as itself");
    }
}
