//! What the last scan added, as a second witness of what the next will: gains decline from scan to scan, but not at once to
//! nothing, even where the cloud shows nothing more. It holds what a planner cannot know: grooves that a sensor measures
//! differently from each side, and surface beyond what the membrane closes.

use crate::ScanState;
use crate::answer::Candidate;
use crate::scan::PreparedScan;
use crate::stop::Missing;
use geometry::NeighborGrid;

/// Of what the last scan added, the part that the next can be expected to add: on recorded sequences 0.3 to 0.7 from the third scan on,
/// where each was the best by the planner (docs/log.md).
const NEXT: f64 = 0.5;
/// Weight of that beside the planner's own number, where it is more.
const WEIGHT: f64 = 0.7;
/// Points of the cloud that are looked at, about.
const ASKED: usize = 4_000;
/// A scan stands for the surface within so many of its spacings: the widest holes of a lattice of points that is seen at 45 degrees
/// reach as far.
const HOLES: f64 = 0.85;

/// Share of the accumulated cloud that only the last scan, and only the last two, measured: no point of those before lies within reach,
/// nor as near as their own points leave holes. `None` where there are none before.
pub(super) fn lately_added(scans: &[PreparedScan], state: &ScanState) -> [Option<f64>; 2] {
    [1, 2].map(|last| added_since(&scans[..scans.len().saturating_sub(last)], state))
}

fn added_since(before: &[PreparedScan], state: &ScanState) -> Option<f64> {
    if before.is_empty() || state.cloud.is_empty() {
        return None;
    }
    let points: Vec<_> = before.iter().flat_map(|scan| scan.cloud.points.iter().copied()).collect();
    let apart = before.iter().map(|scan| scan.spacing * scan.cloud.len() as f64).sum::<f64>() / points.len() as f64;
    let reach = state.reach.max(HOLES * apart);
    let grid = NeighborGrid::new(&points, reach);
    let asked = state.cloud.points.iter().step_by(state.cloud.len().div_ceil(ASKED));
    let all = asked.len() as f64;
    Some(asked.filter(|p| !grid.any_within(p, reach)).count() as f64 / all)
}

/// Raises what candidates are expected to add, all by one factor, where the last scan leads one to expect more of the best of them; and
/// what is missing likewise. `last_added` is a share of the whole surface. Returns whether gains were raised.
pub(super) fn heed(candidates: &mut [Candidate], missing: Option<&mut Missing>, last_added: f64) -> bool {
    let raised = |predicted: f64, declined: f64| predicted + WEIGHT * (declined - predicted).max(0.0);
    let allowed = candidates.iter().filter(|c| c.objections.is_empty());
    let best = allowed.filter_map(|c| c.expected_gain).fold(0.0, f64::max);
    // Where no view is expected to add anything, there is nothing to raise, nor is that missing which none would add.
    if best <= 0.0 {
        return false;
    }
    let mut most = 1.0;
    if let Some(missing) = missing {
        // What is left if each scan adds that part of the one before.
        let left = NEXT / (1.0 - NEXT) * last_added;
        missing.share = raised(missing.share, left).min(1.0);
        missing.between[1] = missing.between[1].max(Missing::widened([0.0, left.max(missing.share)])[1]);
        most = missing.share;
    }
    let to = raised(best, NEXT * last_added);
    if to <= best {
        return false;
    }
    let gains = candidates.iter_mut().filter_map(|c| c.expected_gain.as_mut());
    gains.for_each(|gain| *gain = (*gain * (to / best)).min(most.max(*gain)));
    true
}

#[cfg(test)]
mod tests;
