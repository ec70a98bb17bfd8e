//! The loss of BENBV-Net (method, 'Network input and output').

use burn::tensor::{Tensor, TensorData};

/// 5 times the mean over real candidates of w_i (pred - target)^2, with w_i = ((p - 12) / 10)^2 + 0.3 and p the
/// candidate's position in its order, scaled to 0..19: p = 19 i / (count - 1).
///
/// `prediction` and `target` are [B, K]; the first `counts[b]` candidates of sample b are real.
pub fn position_weighted_loss(prediction: Tensor<2>, target: Tensor<2>, counts: &[usize]) -> Tensor<1> {
    let [b, k] = prediction.dims();
    assert_eq!(counts.len(), b, "one count of candidates per sample");
    let real: usize = counts.iter().map(|&count| count.min(k)).sum();
    let mut weights = vec![0.0f32; b * k];
    for (row, &count) in weights.chunks_mut(k).zip(counts) {
        for (i, w) in row.iter_mut().take(count).enumerate() {
            *w = (5.0 * position_weight(i, count) / real.max(1) as f64) as f32;
        }
    }
    let weights = Tensor::<2>::from_data(TensorData::new(weights, [b, k]), &prediction.device().inner());
    let difference = prediction - target; // [B, K]
    (difference.clone() * difference * weights).sum()
}

/// Weight of the candidate at position `i` of `count`.
pub fn position_weight(i: usize, count: usize) -> f64 {
    let position = if count > 1 { 19.0 * i as f64 / (count - 1) as f64 } else { 0.0 };
    ((position - 12.0) / 10.0).powi(2) + 0.3
}
