//! 'Is it worth another view?': what one view can add, and what is missing at all.

use crate::answer::Candidate;
use crate::estimate::interpolated;
use crate::planners::volumetric::{Hole, Surface};
use serde::{Deserialize, Serialize};

/// Whether another view is worth it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stop {
    /// Share of the whole surface that one view can be expected to add: the most of all that may be taken. Absent where
    /// too little is known to say.
    pub expected_gain: Option<f64>,
    /// Where that number comes from.
    pub basis: String,
    /// Share of the whole surface that the last scan added, by the surface that the planner makes out; absent of a single scan, and where it
    /// makes out none. The next may add as much.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_added: Option<f64>,
    /// Likewise what the last two scans added together: one scan may add little by accident.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_two_added: Option<f64>,
    /// Whether the next view, the last scan and the mean of the last two are under `stop_below` and no tenth of the surface is sure to be
    /// missing within reach, or no view is left.
    pub stop: bool,
}

/// Surface that is expected where nothing is known yet, as shares of the whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Missing {
    /// What a view sees that may be taken.
    pub share: f64,
    /// Between which that is in nine of ten cases.
    pub between: [f64; 2],
    /// What no view that may be taken is expected to measure: the underside of what stands on a table, and part of what is in sight only at
    /// a grazing angle or was looked at in vain.
    pub out_of_reach_share: f64,
    /// Its pieces, largest first; those under a thousandth of the whole are left out.
    pub holes: Vec<Hole>,
}

/// Share of the whole surface that, if it is missing in nine of ten cases within reach, keeps a run from its end.
const MUCH: f64 = 0.1;

impl Stop {
    /// What `stop_below` is compared with.
    pub fn compared(&self) -> Option<f64> {
        let added = self.last_added.unwrap_or(0.0).max(0.5 * self.last_two_added.unwrap_or(0.0));
        self.expected_gain.map(|gain| gain.max(added))
    }

    /// From the most that any candidate which may be taken is predicted to add, whatever its rank.
    /// `raised` is whether what the last scan added had part in it; `added` is what the last scan and the last two added. While `missing` is
    /// sure to be much, it is not over however little the candidates add: the other side of a sheet is seen by none of those around
    /// its rim, but by those of a later answer.
    pub fn judge(
        candidates: &[Candidate],
        stop_below: f64,
        raised: bool,
        added: [Option<f64>; 2],
        missing: Option<&Missing>,
    ) -> Self {
        let [last_added, last_two_added] = added;
        let found = |expected_gain, basis: &str, stop| Self {
            expected_gain,
            basis: basis.to_owned(),
            last_added,
            last_two_added,
            stop,
        };
        let allowed = || candidates.iter().filter(|c| c.objections.is_empty());
        let predicted = allowed().filter_map(|c| c.expected_gain).max_by(f64::total_cmp);
        if allowed().next().is_none() {
            return found(Some(0.0), "no view is left", true);
        }
        let basis = match predicted {
            Some(_) if raised => "predicted by the planner, and raised since the last scan added more than twice that",
            Some(_) => "predicted by the planner",
            None => {
                "unknown: this planner does not predict gains; give camera positions (--from) or depth images to get one"
            }
        };
        let found = found(predicted, basis, false);
        let much = missing.is_some_and(|missing| missing.between[0] >= MUCH.max(stop_below));
        Self { stop: !much && found.compared().is_some_and(|gain| gain < stop_below), ..found }
    }
}

/// Share of the whole that the membrane makes out as missing, and what was missing in truth: the fifth percentile, the
/// median and the ninety-fifth of simulated decisions after one to six scans (the example `gain_matrix` of `datagen`). The
/// membrane closes what is open by the shortest way; objects bulge.
const MISSING: [(f64, [f64; 3]); 10] = [
    (0.0, [0.0, 0.01, 0.1]),
    (0.0015, [0.0008, 0.018, 0.127]),
    (0.020, [0.021, 0.070, 0.165]),
    (0.058, [0.073, 0.148, 0.341]),
    (0.112, [0.166, 0.274, 0.352]),
    (0.168, [0.232, 0.302, 0.421]),
    (0.257, [0.311, 0.440, 0.565]),
    (0.338, [0.398, 0.514, 0.660]),
    (0.425, [0.500, 0.669, 0.719]),
    (0.488, [0.626, 0.682, 0.740]),
];

impl Missing {
    /// Bounds for real scans, from those of simulated ones: what is in reach is known less well where views are given, and sensors are
    /// noisy. 90 % of the decisions on three recorded sequences are inside, 80 % of those on the noisiest (docs/results.md).
    pub(crate) fn widened([low, high]: [f64; 2]) -> [f64; 2] {
        [(0.8 * low - 0.015).max(0.0), (1.2 * high + 0.015).min(1.0)]
    }

    /// Of the holes of a membrane whose whole share is `share`; also the expected surface that this amounts to, square metres.
    pub fn of(mut holes: Vec<Hole>, surface: &Surface) -> (Self, Surface) {
        let raw = 1.0 - surface.covered();
        let [low, share, high] = interpolated(&MISSING, raw);
        let whole = surface.known_m2 / (1.0 - share);
        for hole in &mut holes {
            hole.share *= share / raw.max(f64::MIN_POSITIVE);
            hole.area_m2 = hole.share * whole;
        }
        let out_of_reach_share = holes.iter().map(|h| h.share * (1.0 - h.within_reach)).sum::<f64>().min(share);
        let within = 1.0 - out_of_reach_share / share;
        let between = Self::widened([low * within, high * within]);
        let missing = Self { share: share * within, between, out_of_reach_share, holes };
        (missing, Surface { known_m2: surface.known_m2, expected_m2: whole - surface.known_m2 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planners::volumetric::Unseen;

    #[test]
    fn what_is_told_is_what_objects_lacked_where_the_membrane_made_out_as_much() {
        let hole = |share, within_reach| Hole {
            center_m: [0.0; 3],
            normal: [0.0; 3],
            size_m: 0.1,
            area_m2: share,
            share,
            unseen: Unseen::FacesAway,
            within_reach,
            best_candidate: None,
        };
        let surface = Surface { known_m2: 0.575, expected_m2: 0.425 };
        let (missing, told) = Missing::of(vec![hole(0.325, 1.0), hole(0.1, 0.0)], &surface);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        near(missing.share + missing.out_of_reach_share, 0.669);
        near(missing.out_of_reach_share, 0.669 * 0.1 / 0.425);
        near(missing.holes.iter().map(|h| h.share).sum(), 0.669);
        near(told.expected_m2 / (told.known_m2 + told.expected_m2), 0.669);
        near(missing.holes.iter().map(|h| h.area_m2).sum(), told.expected_m2);
        assert!(missing.between[0] < missing.share && missing.share < missing.between[1], "{missing:?}");
    }
}
