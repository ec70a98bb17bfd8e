//! References: greedy choices that know the true surface. No policy may use them; they show what a decision could
//! have brought.

use super::Radius;
use super::sphere::view_at;
use datagen::{Scene, SearchConfig, score_views};
use geometry::View;
use nalgebra::{Point3, Vector3};
use planning::accumulate::reference_surface;
use planning::planner::checked;
use planning::{CandidateConfig, PlanError, Planner, RankedView, ScanState, candidate_views};
use rand_chacha::ChaCha8Rng;

/// The views that an oracle chooses from.
pub enum OracleAmong {
    /// Directions from the origin, at a radius.
    Set(Vec<Vector3<f64>>, Radius),
    /// BENBV's candidates.
    Candidates(CandidateConfig),
}

/// Takes the view that covers the most new surface, among those whose scan overlaps the cloud by at least
/// `min_overlap` while there are any.
pub struct OraclePlanner<'a> {
    name: String,
    scene: &'a Scene,
    samples: &'a [Point3<f64>],
    among: OracleAmong,
    search: SearchConfig,
    min_overlap: f64,
    reference: Vec<Point3<f64>>,
}

impl<'a> OraclePlanner<'a> {
    /// An oracle of this scene; `samples` are its surface samples, not yet averaged.
    pub fn new(
        name: &str,
        scene: &'a Scene,
        samples: &'a [Point3<f64>],
        among: OracleAmong,
        search: SearchConfig,
        min_overlap: f64,
    ) -> Self {
        Self { name: name.to_owned(), scene, samples, among, search, min_overlap, reference: Vec::new() }
    }
}

impl Planner for OraclePlanner<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        if self.reference.is_empty() {
            self.reference = reference_surface(self.samples, state.grid_size, self.search.accumulate);
        }
        let views: Vec<View> = match &self.among {
            OracleAmong::Set(directions, radius) => {
                let radius = radius.metres(state);
                directions.iter().map(|d| view_at(d, radius)).collect()
            }
            OracleAmong::Candidates(config) => {
                let near = state.neighborhoods(config.boundary.neighbors);
                let candidates = candidate_views(&state.cloud, &near, state.working_distance, config, rng);
                candidates.into_iter().map(|c| c.view).collect()
            }
        };
        let (current, scores) = score_views(self.scene, &self.reference, state, &state.grid(), &views, &self.search);
        let mut list: Vec<RankedView> = views
            .iter()
            .zip(&scores)
            .map(|(view, s)| {
                let gain = s.coverage - current;
                RankedView { gain: Some(gain), overlap: s.overlap, ..RankedView::scored(*view, gain) }
            })
            .collect();
        let overlaps = |r: &RankedView| r.overlap.unwrap_or(0.0) >= self.min_overlap;
        list.sort_by(|a, b| overlaps(b).cmp(&overlaps(a)).then(b.score.total_cmp(&a.score)));
        checked(&self.name, list, PlanError::NoBoundary)
    }

    fn reset(&mut self) {
        self.reference.clear();
    }
}
