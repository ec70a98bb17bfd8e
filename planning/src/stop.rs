//! 'Is it worth another view?': the share of the whole surface that the next view is expected to add.

/// Mean gain of the view after 1, 2, 3 ... scans, over simulated episodes of planner `farthest` on procedural
/// objects (`infer --object procedural:N --seed N --views 10 --json`, N from 101 on, 1.2 m; the spread between objects
/// is about half of each value). Made not to rise.
const USUAL_GAIN: [f64; 10] = [0.23, 0.20, 0.12, 0.048, 0.029, 0.010, 0.008, 0.008, 0.0033, 0.0031];

/// Expected gain of the best view and where the number comes from. `predicted`: the planner's own prediction, where it
/// makes one; else what a view usually adds after so many scans, whatever the object.
pub fn expected_gain(predicted: Option<f64>, scans: usize) -> (f64, &'static str) {
    match predicted {
        Some(gain) => (gain, "predicted by the planner"),
        None => (USUAL_GAIN[scans.clamp(1, USUAL_GAIN.len()) - 1], "usual after so many scans, for any object"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_prediction_counts_and_else_later_views_add_less() {
        assert_eq!(expected_gain(Some(0.3), 7).0, 0.3, "the planner knows better");
        let gains: Vec<f64> = (0..20).map(|scans| expected_gain(None, scans).0).collect();
        assert!(gains.windows(2).all(|w| w[0] >= w[1]), "never rising: {gains:?}");
        assert!(gains[1] > 0.1 && gains[19] < 0.01, "from much to little");
    }
}
