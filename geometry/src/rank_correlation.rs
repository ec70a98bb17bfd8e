//! Spearman's rank correlation.

/// Spearman's rank correlation with mean ranks for ties, as scipy's `spearmanr`. None where either side is
/// constant, not finite, shorter than 2 or not as long as the other.
pub fn rank_correlation<T: Copy + Into<f64>>(a: &[T], b: &[T]) -> Option<f64> {
    let [a, b] = [a, b].map(|values| values.iter().map(|&x| x.into()).collect::<Vec<f64>>());
    if a.len() < 2 || a.len() != b.len() || a.iter().chain(&b).any(|x| !x.is_finite()) {
        return None;
    }
    let (ra, rb) = (ranks(&a), ranks(&b));
    let mean = (a.len() + 1) as f64 / 2.0;
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in ra.iter().zip(&rb) {
        ab += (x - mean) * (y - mean);
        aa += (x - mean).powi(2);
        bb += (y - mean).powi(2);
    }
    (aa > 0.0 && bb > 0.0).then(|| ab / (aa * bb).sqrt())
}

/// Ranks from 1, equal values sharing the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut ranks = vec![0.0; values.len()];
    let mut start = 0;
    while start < order.len() {
        let mut end = start + 1;
        while end < order.len() && values[order[end]] == values[order[start]] {
            end += 1;
        }
        for &i in &order[start..end] {
            ranks[i] = (start + 1 + end) as f64 / 2.0;
        }
        start = end;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_correlation_of_known_cases() {
        let close = |a: &[f32], b: &[f32], rho: f64| {
            let found = rank_correlation(a, b).expect("defined");
            assert!((found - rho).abs() < 1e-12, "{a:?} {b:?}: {found} instead of {rho}");
        };
        close(&[1.0, 2.0, 3.0], &[10.0, 20.0, 900.0], 1.0);
        close(&[1.0, 2.0, 3.0], &[3.0, 2.0, 1.0], -1.0);
        // Without ties 1 - 6 sum(d^2) / (n (n^2 - 1)): d = (1, 1, 1, 1), n = 4 -> 0.6.
        close(&[1.0, 2.0, 3.0, 4.0], &[2.0, 1.0, 4.0, 3.0], 0.6);
        // scipy.stats.spearmanr([1, 2, 2, 3], [1, 2, 3, 4]) = 0.9486832980505138.
        close(&[1.0, 2.0, 2.0, 3.0], &[1.0, 2.0, 3.0, 4.0], 0.948_683_298_050_513_8);
        assert_eq!(rank_correlation(&[1.0, 1.0], &[1.0, 2.0]), None, "a constant has no order");
        assert_eq!(rank_correlation(&[1.0, f32::NAN], &[1.0, 2.0]), None);
        assert_eq!(rank_correlation(&[1.0], &[1.0]), None);
    }
}
