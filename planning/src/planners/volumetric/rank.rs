//! BENBV's score of what views promise.

use super::{Forecasts, Surface, ViewForecast, VolumetricPlanner};
use crate::RankedView;
use crate::overlap::margin;
use geometry::coverage::overlap_response;

/// Weight of the gain in the score.
const GAIN: f64 = 1.3;
/// Weight of the expected surface in the coverage that the score goes by: gain and overlap change places early.
const FINISHED: f64 = 0.41;
/// Of a scan that shows so much measured surface less lies within the tolerance of its points, where they are far apart. To have a least overlap,
/// more of it has to be shown; but no more than this share unless the user asks for it, or a view with coarse pixels would show nothing else.
/// With 0.5, 7 of 210 views at 2 m have an overlap under 0.2 where 0.3 are asked for, with 0.6 and 0.7 none (docs/log.md).
const ENOUGH: f64 = 0.6;

impl VolumetricPlanner {
    /// The views by BENBV's score of their forecasts, best first.
    pub fn rank(&self, forecasts: &Forecasts) -> Vec<RankedView> {
        let Surface { known_m2, expected_m2 } = forecasts.surface;
        let finished = known_m2 / (known_m2 + FINISHED * expected_m2).max(f64::MIN_POSITIVE);
        let weight = match forecasts.elsewhere {
            true => 1.0,
            false => 1.0 / (1.0 + (-10.0 * (finished - self.config.weight_center)).exp()),
        };
        // What lies beyond may be more than the whole early: a share of the most then, so that no score exceeds 1.
        let most = forecasts.views.iter().map(|f| GAIN * f.gain).fold(1.0, f64::max);
        let score = |f: &ViewForecast| {
            let reward = f.overlap.map_or(0.0, overlap_response);
            let now = weight * GAIN * f.gain / most + (1.0 - weight) * reward;
            (now + self.config.novelty * f.novelty) / (1.0 + self.config.novelty)
        };
        let ranked = |f: &ViewForecast| {
            let score = if self.config.gain_only { f.gain } else { score(f) };
            RankedView {
                gain: Some(f.reported_gain),
                overlap: f.reported_overlap,
                cautious_overlap: f.cautious_overlap,
                given: f.given,
                ..RankedView::scored(f.view, score)
            }
        };
        let least = match self.config.min_overlap {
            none if none <= 0.0 => 0.0,
            asked => asked + margin(self.placed),
        };
        // What lacks of it: nothing where it is enough. Where no view has enough, the one with the most comes first.
        let lack = |f: &ViewForecast| {
            let enough = (least / f.dense).min(least.max(ENOUGH));
            (enough - f.cautious_overlap.unwrap_or(0.0)).max(0.0)
        };
        let mut ranked: Vec<(f64, RankedView)> = forecasts.views.iter().map(|f| (lack(f), ranked(f))).collect();
        ranked.sort_by(|(a, x), (b, y)| a.total_cmp(b).then(y.score.total_cmp(&x.score)));
        ranked.into_iter().map(|(_, view)| view).collect()
    }
}
