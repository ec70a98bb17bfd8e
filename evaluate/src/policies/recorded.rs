//! The policies on recorded sequences: orders of their scans, and the session that ships choosing among them.

use super::name::{Kind, Policy};
use crate::record::Forecast;
use datagen::{Episode, EpisodeConfig, EpisodeError, EpisodeEvidence, Progress, Recording, Stage, run_session};
use geometry::View;
use planning::{PlanError, PlannerName, RankBy, RankedView, Session, SessionConfig, SessionError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// The evidence that a recording may hold, best first, by its name in `auto:NAME`.
pub const EVIDENCE: [(&str, EpisodeEvidence); 5] = [
    ("depth-with-background", EpisodeEvidence::DepthWithBackground),
    ("depth", EpisodeEvidence::Depth),
    ("camera-positions", EpisodeEvidence::CameraPositions),
    ("clouds", EpisodeEvidence::Clouds),
    ("merged", EpisodeEvidence::Merged),
];

/// How the next scan is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Any of those left.
    Random,
    /// The next one that was recorded, the first after the last.
    Recorded,
    /// The largest true gain.
    Oracle,
    /// A session with this planner and this evidence; `None`: the best that the recording has.
    Session(PlannerName, Option<EpisodeEvidence>),
}

impl Order {
    /// What a policy does on a recording; `None` where it needs more than that.
    pub fn of(policy: &Policy) -> Option<Self> {
        Some(match policy.kind() {
            Kind::Random => Self::Random,
            Kind::RecordedOrder => Self::Recorded,
            Kind::Oracle { .. } if policy.name() == "oracle" => Self::Oracle,
            Kind::FarthestOnSphere(_) if policy.name() == "farthest" => {
                Self::Session(PlannerName::Farthest, Some(EpisodeEvidence::CameraPositions))
            }
            Kind::Auto => Self::Session(PlannerName::Auto, None),
            Kind::AutoOn(evidence) => Self::Session(PlannerName::Auto, Some(*evidence)),
            _ => return None,
        })
    }

    /// Whether the recording has its inputs.
    pub fn fits(self, recording: &Recording) -> bool {
        match self {
            Self::Session(_, Some(evidence)) => recording.has(evidence),
            _ => true,
        }
    }
}

/// The scan that episode `number` starts with: the next episode starts far away, and as many as there are scans start with
/// each.
pub fn start(number: usize, scans: usize) -> usize {
    let coprime = |stride: &usize| (2..=*stride).all(|d| !stride.is_multiple_of(d) || !scans.is_multiple_of(d));
    let near = (0.382 * scans as f64).round() as usize;
    let stride = (near.max(1)..=scans.max(1)).find(coprime).unwrap_or(1);
    number * stride % scans.max(1)
}

/// One episode on a recording, and what the session expected at each decision; `rank_by` is what a session ranks by.
///
/// # Errors
/// A scan that the session refuses, a decision that fails.
pub fn replay(
    recording: &Recording,
    order: Order,
    number: usize,
    config: &EpisodeConfig,
    rank_by: RankBy,
    rng: &mut ChaCha8Rng,
) -> Result<(Episode, Vec<Forecast>), EpisodeError> {
    let start = start(number, recording.len());
    let mut left = Left { recording, scans: vec![true; recording.len()] };
    let Order::Session(planner, evidence) = order else {
        let stage = Stage::Recorded { recording, start, evidence: None };
        let session = Session::unchecked(SessionConfig::default());
        let decide = |_: &mut Session, progress: &Progress, rng: &mut ChaCha8Rng| {
            left.without(progress.view);
            Ok(match order {
                Order::Random => left.shuffled(rng),
                Order::Oracle => left.by_gain(),
                _ => left.after(start),
            })
        };
        return run_session(stage, session, config, rng, decide).map(|(episode, _)| (episode, Vec::new()));
    };
    let best = EVIDENCE.iter().map(|(_, e)| *e).find(|e| recording.has(*e));
    let evidence = evidence.or(best).unwrap_or(EpisodeEvidence::Clouds);
    let tolerance_m = recording.tolerance_m();
    let settings = SessionConfig { planner, rank_by, tolerance_m, ..recording.session_config(evidence) };
    let failed = |index, error: String| EpisodeError::Plan { index, error: PlanError::failed("session", error) };
    let mut session = Session::new(settings, None).map_err(|e| failed(0, e.to_string()))?;
    session.set_given_views(recording.poses());
    let stage = Stage::Recorded { recording, start, evidence: Some(evidence) };
    let mut forecasts = Vec::new();
    let decide = |session: &mut Session, progress: &Progress, _: &mut ChaCha8Rng| {
        left.without(progress.view);
        let answer = session.next_view().map_err(|error| match error {
            SessionError::Plan(error) => error,
            error => PlanError::failed(planner.as_str(), error.to_string()),
        })?;
        let allowed = answer.candidates.iter().filter(|c| c.objections.is_empty());
        let ranked = allowed.filter_map(|c| {
            let scan = c.given.filter(|&i| left.scans[i])?;
            let (gain, overlap) = (c.expected_gain, c.expected_overlap);
            Some(RankedView { gain, overlap, ..RankedView::scored(recording.views()[scan], c.score) })
        });
        let ranked: Vec<RankedView> = ranked.collect();
        let (gain, most) = (ranked.first().and_then(|r| r.gain), answer.stop.compared());
        forecasts.push(Forecast { gain, most });
        Ok(ranked)
    };
    let (episode, _) = run_session(stage, session, config, rng, decide)?;
    Ok((episode, forecasts))
}

/// The scans that are left.
struct Left<'a> {
    recording: &'a Recording,
    scans: Vec<bool>,
}

impl Left<'_> {
    /// Without the one from this view.
    fn without(&mut self, view: &View) {
        let views = self.recording.views();
        if let Some(taken) = (0..views.len()).find(|&i| self.scans[i] && views[i] == *view) {
            self.scans[taken] = false;
        }
    }

    fn ranked(&self, scans: impl Iterator<Item = (usize, f64)>) -> Vec<RankedView> {
        let views = self.recording.views();
        let left = scans.filter(|(i, _)| self.scans[*i]);
        left.map(|(i, score)| RankedView::scored(views[i], score)).collect()
    }

    fn shuffled(&self, rng: &mut ChaCha8Rng) -> Vec<RankedView> {
        let mut scans: Vec<usize> = (0..self.scans.len()).collect();
        for i in (1..scans.len()).rev() {
            scans.swap(i, rng.random_range(0..=i));
        }
        self.ranked(scans.into_iter().map(|i| (i, 0.0)))
    }

    fn after(&self, start: usize) -> Vec<RankedView> {
        let count = self.scans.len();
        self.ranked((1..count).map(|i| ((start + i) % count, 0.0)))
    }

    /// Equal ones stay in the order recorded.
    fn by_gain(&self) -> Vec<RankedView> {
        let mut covered = vec![false; self.recording.reference().len()];
        for scan in (0..self.scans.len()).filter(|&i| !self.scans[i]) {
            self.recording.covered_by(scan).iter().for_each(|&i| covered[i as usize] = true);
        }
        let gain = |scan: usize| self.recording.covered_by(scan).iter().filter(|&&i| !covered[i as usize]).count();
        let mut scans: Vec<(usize, f64)> = (0..self.scans.len()).map(|i| (i, gain(i) as f64)).collect();
        scans.sort_by(|a, b| b.1.total_cmp(&a.1));
        self.ranked(scans.into_iter())
    }
}

#[cfg(test)]
mod tests;
