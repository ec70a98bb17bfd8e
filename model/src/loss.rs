//! The loss of BENBV-Net (docs/method.md, 'Network input and output').

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

/// Mean over real candidates of the squared error of scores after each decision's own mean is taken from both sides: what
/// decides the choice, and a small part of [`position_weighted_loss`], which a network can lower for long by telling
/// decisions apart rather than candidates. Not in the paper.
///
/// `prediction` and `target` are [B, K]; the first `counts[b]` candidates of sample b are real.
pub fn within_decision_loss(prediction: Tensor<2>, target: Tensor<2>, counts: &[usize]) -> Tensor<1> {
    let [b, k] = prediction.dims();
    assert_eq!(counts.len(), b, "one count of candidates per sample");
    let real: usize = counts.iter().map(|&count| count.min(k)).sum();
    let (mut mean, mut weights) = (vec![0.0f32; b * k], vec![0.0f32; b * k]);
    for (b, &count) in counts.iter().enumerate() {
        mean[b * k..][..count.min(k)].fill(1.0 / count.max(1) as f32);
        weights[b * k..][..count.min(k)].fill(1.0 / real.max(1) as f32);
    }
    let device = prediction.device().inner();
    let constant = |values| Tensor::<2>::from_data(TensorData::new(values, [b, k]), &device);
    let difference = prediction - target; // [B, K]
    let centred = difference.clone() - (difference * constant(mean)).sum_dim(1); // [B, K] - [B, 1]
    (centred.clone() * centred * constant(weights)).sum()
}

/// Weight of the candidate at position `i` of `count`.
pub fn position_weight(i: usize, count: usize) -> f64 {
    let position = if count > 1 { 19.0 * i as f64 / (count - 1) as f64 } else { 0.0 };
    ((position - 12.0) / 10.0).powi(2) + 0.3
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn only_differences_within_a_decision_count() {
        let device = Device::flex();
        let target = Tensor::<2>::from_floats([[0.1, 0.3, 0.5], [0.2, 0.4, 0.0]], &device);
        // The first sample is off by a constant; the second by +0.1 and -0.1, with padding that is wrong.
        let prediction = Tensor::<2>::from_floats([[0.6, 0.8, 1.0], [0.3, 0.3, 9.0]], &device);
        let loss: f32 = within_decision_loss(prediction, target, &[3, 2]).into_scalar();
        assert!((loss - 2.0 * 0.01 / 5.0).abs() < 1e-6, "{loss}");
    }

    #[test]
    fn weights_and_mean_are_those_of_the_method() {
        for i in 0..20 {
            assert!((position_weight(i, 20) - (((i as f64) - 12.0) / 10.0).powi(2) - 0.3).abs() < 1e-12);
        }
        assert!((position_weight(4, 5) - position_weight(19, 20)).abs() < 1e-12, "the position is scaled to 0..19");
        // Two samples, three and one real candidates, all off by 0.5: padding, however wrong, counts nothing.
        let device = Device::flex();
        let prediction = Tensor::<2>::from_floats([[0.5, 0.5, 0.5], [0.5, 9.0, 9.0]], &device);
        let loss = position_weighted_loss(prediction, Tensor::zeros([2, 3], &device), &[3, 1]);
        let weights: f64 = (0..3).map(|i| position_weight(i, 3)).sum::<f64>() + position_weight(0, 1);
        assert!((f64::from(loss.into_scalar::<f32>()) - 5.0 * 0.25 * weights / 4.0).abs() < 1e-6);
    }
}
