//! Mean and variance of columns, merged over chunks (Chan, Golub and LeVeque 1983).

/// Count, mean and sum of squared deviations per column.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    pub count: f64,
    pub mean: Vec<f64>,
    pub squares: Vec<f64>,
}

impl Moments {
    /// Of one chunk of `count` rows, from sums of deviations from `centre` and of their squares.
    pub fn of_chunk(count: usize, centre: &[f32], first: &[f32], second: &[f32]) -> Self {
        let count = count as f64;
        let mean = centre.iter().zip(first).map(|(c, s)| f64::from(*c) + f64::from(*s) / count).collect();
        let squares = first
            .iter()
            .zip(second)
            .map(|(s, ss)| {
                let squares = f64::from(*ss) - f64::from(*s) * f64::from(*s) / count;
                if squares < 0.0 { 0.0 } else { squares } // Unlike `max`, keeps NaN.
            })
            .collect();
        Self { count, mean, squares }
    }

    /// Joins the rows of another.
    pub fn merge(&mut self, other: &Moments) {
        if self.count == 0.0 {
            *self = other.clone();
            return;
        }
        let total = self.count + other.count;
        for j in 0..self.mean.len() {
            let d = other.mean[j] - self.mean[j];
            self.mean[j] += d * other.count / total;
            self.squares[j] += other.squares[j] + d * d * self.count * other.count / total;
        }
        self.count = total;
    }

    /// The biased variance, as batch norm divides by it. NaN stays NaN.
    pub fn variance(&self) -> Vec<f64> {
        self.squares.iter().map(|s| s / self.count).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_merge_to_the_whole() {
        let values: Vec<f32> = (0..50).map(|i| 1000.0 + ((i * 37) % 11) as f32).collect();
        let mut merged = Moments::default();
        for chunk in values.chunks(13) {
            let centre = [chunk[0]];
            let first = [chunk.iter().map(|x| x - centre[0]).sum::<f32>()];
            let second = [chunk.iter().map(|x| (x - centre[0]).powi(2)).sum::<f32>()];
            merged.merge(&Moments::of_chunk(chunk.len(), &centre, &first, &second));
        }
        let mean = values.iter().map(|x| f64::from(*x)).sum::<f64>() / 50.0;
        let variance = values.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / 50.0;
        assert!((merged.mean[0] - mean).abs() < 1e-9);
        assert!((merged.variance()[0] - variance).abs() < 1e-6);
    }
}
