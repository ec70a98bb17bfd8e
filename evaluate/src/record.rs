//! What is kept of an episode.

use datagen::{End, Episode, RegistrationOutcome};
use geometry::View;
use planning::reach::Tour;
use serde::{Deserialize, Serialize};

/// Names an episode of a run.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct EpisodeKey {
    /// The object.
    pub object: String,
    /// The policy, as on the command line.
    pub policy: String,
    /// Number of the episode, from 0. Episodes of one object and number start from the same view whatever the policy.
    pub episode: usize,
}

/// What was expected at a decision.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// Gain of the view taken, as a share of the whole surface, if the planner predicts it.
    pub gain: Option<f64>,
    /// What `stop` is based on: the most that any view was expected to add, if the planner predicts it, or what the last scan added where that is more.
    pub most: Option<f64>,
}

/// The outcome of an episode; equal for equal settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeRecord {
    /// Which episode.
    #[serde(flatten)]
    pub key: EpisodeKey,
    /// Views scanned from: the first, then the next views.
    pub views: Vec<View>,
    /// Coverage after each view, in [0, 1].
    pub coverages: Vec<f64>,
    /// Overlap of each next view's scan with the cloud before it; null for an empty scan.
    pub overlaps: Vec<Option<f64>>,
    /// Points of each scan.
    pub scan_points: Vec<usize>,
    /// Voxel edge, metres.
    pub grid_size_m: f64,
    /// Points of the voxel-averaged reference surface.
    pub num_reference: usize,
    /// Chamfer distance of the final cloud, metres.
    pub chamfer_m: f64,
    /// Hausdorff distance of the final cloud, metres.
    pub hausdorff_m: f64,
    /// First views that were void before this one.
    pub void_draws: usize,
    /// Why it ended.
    pub end: End,
    /// What was expected at each decision, on recordings by policies that expect anything.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub forecasts: Vec<Forecast>,
    /// How the scans were registered, if they had to be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationOutcome>,
    /// An arm's way through the views, where the settings have an arm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm: Option<Tour>,
    /// Digest of the weights that the policy used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<String>,
    /// Digest of the files that the object was read from ([`crate::objects::files`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<String>,
}

/// Times of an episode: never equal twice, so kept apart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Processor time of the whole episode, simulation included, seconds.
    pub episode_s: f64,
    /// Wall time of each decision, seconds.
    pub decisions_s: Vec<f64>,
}

/// An episode that could not be run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Which episode.
    #[serde(flatten)]
    pub key: EpisodeKey,
    /// Why.
    pub reason: String,
    /// Digest of the weights that the policy would have used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<String>,
    /// Digest of the files that the object was read from ([`crate::objects::files`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<String>,
}

impl EpisodeRecord {
    /// From the episode as it was run.
    pub fn new(key: EpisodeKey, episode: &Episode) -> Self {
        Self {
            key,
            views: episode.views.clone(),
            coverages: episode.coverages.clone(),
            overlaps: episode.overlaps.clone(),
            scan_points: episode.scan_points.clone(),
            grid_size_m: episode.grid_size,
            num_reference: episode.num_reference,
            chamfer_m: episode.distances.chamfer,
            hausdorff_m: episode.distances.hausdorff,
            void_draws: episode.void_draws,
            end: episode.end,
            forecasts: Vec::new(),
            registration: episode.registration.clone(),
            arm: None,
            weights: None,
            files: None,
        }
    }

    /// Coverage after the last view.
    pub fn final_coverage(&self) -> f64 {
        self.coverages.last().copied().unwrap_or(0.0)
    }

    /// Coverage after `index` next views; the last one where the episode ended before.
    pub fn coverage_after(&self, index: usize) -> f64 {
        self.coverages.get(index).copied().unwrap_or_else(|| self.final_coverage())
    }
}
