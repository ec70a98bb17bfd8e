//! Which planner the evidence allows, and why.

use crate::config::{PlannerName, SessionConfig};
use crate::planners::farthest::FarthestPlanner;
use crate::planners::volumetric::SeenPart;
use crate::{
    Allowed, Angles, CameraPose, CandidateConfig, ExpectedPoint, Hole, NoReturn, PlanError, Planner, RankedView,
    ScanState, Seen, Surface, VolumetricConfig, VolumetricPlanner, Workspace,
};
use nalgebra::Isometry3;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, PoisonError};

/// What is known of the past scans, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Evidence {
    /// Depth images whose misses mean free space.
    DepthWithBackground,
    /// Depth images whose misses mean nothing.
    Depth,
    /// Clouds with camera positions: free space along the rays to the points.
    CameraPositions,
    /// At least one scan whose camera is estimated from its points.
    Clouds,
    /// At least one scan that does not tell where it was taken from.
    Unplaced,
}

impl Evidence {
    /// What all the scans of a state have.
    pub fn of(state: &ScanState) -> Self {
        if state.scans.is_empty() || state.num_placed() < state.num_scans {
            return Self::Unplaced;
        }
        let each = state.scans.iter().map(|scan| match &scan.seen {
            _ if matches!(scan.pose, CameraPose::Estimated(_)) => Self::Clouds,
            Seen::Depth { misses: NoReturn::Free, .. } => Self::DepthWithBackground,
            Seen::Depth { .. } => Self::Depth,
            Seen::Points(_) => Self::CameraPositions,
        });
        each.max().unwrap_or(Self::Unplaced)
    }

    /// For people.
    pub fn describe(self) -> &'static str {
        match self {
            Self::DepthWithBackground => "depth images with poses, whose misses are free space",
            Self::Depth => "depth images with poses",
            Self::CameraPositions => "clouds with camera positions",
            Self::Clouds => "clouds without a camera position for each",
            Self::Unplaced => "scans without a camera position",
        }
    }
}

/// A network as a planner, shared by sessions; no type of the network's library shows.
#[derive(Clone)]
pub struct Network {
    planner: Arc<Mutex<Box<dyn Planner + Send>>>,
}

impl Network {
    /// Shares a network planner, such as `model::NetPlanner`.
    pub fn new(planner: impl Planner + Send + 'static) -> Self {
        Self::boxed(Box::new(planner))
    }

    /// [`Network::new`] of one in a box already.
    pub fn boxed(planner: Box<dyn Planner + Send>) -> Self {
        Self { planner: Arc::new(Mutex::new(planner)) }
    }

    fn rank(&self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        // A planner that panicked once has no state to be wrong about: the next decision starts afresh.
        self.planner.lock().unwrap_or_else(PoisonError::into_inner).rank_views(state, rng)
    }
}

impl std::fmt::Debug for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Network")
    }
}

/// The planner chosen and the reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Never `Auto`.
    pub planner: PlannerName,
    /// A sentence for the answer.
    pub why: String,
}

/// The planner asked for, or for `auto` the best that the evidence allows.
///
/// # Errors
/// Where the planner asked for cannot work: what it lacks and the way out.
pub fn choose(asked: PlannerName, evidence: Evidence, has_network: bool) -> Result<Choice, ChooseError> {
    let has = evidence.describe();
    let choice = |planner, why: String| Ok(Choice { planner, why });
    match asked {
        PlannerName::Volumetric if evidence == Evidence::Unplaced => Err(ChooseError::NoCameras),
        PlannerName::BenbvNet if !has_network => Err(ChooseError::NoWeights),
        PlannerName::Auto if evidence != Evidence::Unplaced => {
            let carves = match evidence {
                Evidence::DepthWithBackground => "seen and unseen space can be distinguished",
                Evidence::Clouds => {
                    "cameras are estimated from the normals and the sampling density (usually within 3 degrees, occasionally on the wrong side), and space is carved from there"
                }
                _ => "space is known to be free up to the points seen",
            };
            choice(PlannerName::Volumetric, format!("there are {has}, so {carves}"))
        }
        PlannerName::Auto if has_network => choice(
            PlannerName::BenbvNet,
            format!("there are {has}, so the past directions are not known and the network ranks"),
        ),
        PlannerName::Auto => choice(
            PlannerName::Farthest,
            format!(
                "there are {has} and no network that could rank (--weights DIR; it cannot rank given views), so the normals are used instead of the past cameras"
            ),
        ),
        asked => choice(asked, format!("asked for (there are {has})")),
    }
}

/// Why the planner asked for cannot be had.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChooseError {
    /// `volumetric` where the camera of a scan is unknown.
    #[error(
        "planner volumetric needs the camera position of every scan: give --from x,y,z with each --scan, or --pose with \
         each --depth; or use --planner auto"
    )]
    NoCameras,
    /// `benbv-net` where the views are given.
    #[error("planner benbv-net only ranks views at the boundary, not given ones: use --planner volumetric or farthest")]
    GivenViews,
    /// `benbv-net` without weights.
    #[error("planner benbv-net needs weights: give --weights DIR with a checkpoint; or use --planner auto")]
    NoWeights,
}

/// The policy `auto`: the planner asked for, or the best that the evidence allows. What a robot gets and what
/// `evaluate` measures.
#[derive(Clone, Debug)]
pub struct AutoPlanner {
    asked: PlannerName,
    network: Option<Network>,
    farthest: FarthestPlanner,
    volumetric: VolumetricPlanner,
}

impl AutoPlanner {
    /// With these settings; without a network, the next best answers where it would.
    pub fn new(network: Option<Network>, config: &SessionConfig) -> Self {
        let volumetric = volumetric_config(config);
        let farthest = FarthestPlanner::among_candidates("farthest", volumetric.candidates.clone(), None);
        Self { asked: config.planner, network, farthest, volumetric: VolumetricPlanner::new(volumetric) }
    }

    /// Whether there are weights.
    pub fn has_network(&self) -> bool {
        self.network.is_some()
    }

    /// Memory held, bytes.
    pub(crate) fn memory(&self) -> usize {
        self.volumetric.memory()
    }

    /// Other settings; what is known of the scans stays where it does not depend on what changed.
    pub(crate) fn configure(&mut self, config: &SessionConfig) {
        self.asked = config.planner;
        let volumetric = volumetric_config(config);
        if *self.volumetric.config() != volumetric {
            self.volumetric = VolumetricPlanner::new(volumetric);
        }
    }

    /// Which planner answers, and why.
    ///
    /// # Errors
    /// The planner asked for cannot work.
    pub fn choose(&self, state: &ScanState) -> Result<Choice, ChooseError> {
        let given = !state.given_views.is_empty();
        if given && self.asked == PlannerName::BenbvNet {
            return Err(ChooseError::GivenViews);
        }
        choose(self.asked, Evidence::of(state), self.has_network() && !given)
    }

    /// The known and the expected surface at the last decision, where the planner chosen makes them out.
    pub fn surface(&self, planner: PlannerName) -> Option<Surface> {
        (planner == PlannerName::Volumetric).then(|| self.volumetric.surface())
    }

    /// Which of the past scans, from 0, have misses that proved not to be free space.
    pub fn scans_with_distrusted_misses(&self) -> Vec<usize> {
        self.volumetric.scans_with_distrusted_misses()
    }

    /// What is missing of that surface ([`VolumetricPlanner::holes`]).
    pub fn holes(&self, planner: PlannerName, state: &ScanState, allowed: &Allowed) -> Vec<Hole> {
        if planner == PlannerName::Volumetric { self.volumetric.holes(state, allowed) } else { Vec::new() }
    }

    /// What cameras see of it ([`VolumetricPlanner::seen_of_expected`]).
    pub fn seen_of_expected(&self, state: &ScanState, poses: &[Isometry3<f64>]) -> (Vec<Vec<SeenPart>>, Vec<[f64; 2]>) {
        self.volumetric.seen_of_expected(state, poses)
    }

    /// The surface expected where nothing is known yet ([`VolumetricPlanner::expected_surface`]).
    pub fn expected_surface(&self, planner: PlannerName) -> Vec<ExpectedPoint> {
        if planner == PlannerName::Volumetric { self.volumetric.expected_surface() } else { Vec::new() }
    }

    /// The views of the planner chosen.
    ///
    /// # Errors
    /// Why it has none.
    pub fn rank(
        &mut self,
        planner: PlannerName,
        state: &ScanState,
        rng: &mut ChaCha8Rng,
    ) -> Result<Vec<RankedView>, PlanError> {
        state.budget.allows(false)?;
        match planner {
            PlannerName::BenbvNet => match &self.network {
                Some(network) => network.rank(state, rng),
                None => Err(PlanError::lacks("benbv-net", "there are no weights")),
            },
            PlannerName::Volumetric => self.volumetric.rank_views(state, rng),
            PlannerName::Farthest | PlannerName::Auto => self.farthest.rank_views(state, rng),
        }
    }
}

fn volumetric_config(config: &SessionConfig) -> VolumetricConfig {
    let candidates = CandidateConfig { angles: Angles::All, ..Default::default() };
    let bound = config.region_m.map(|[low, high]| Workspace {
        center_m: [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0),
        half_m: [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0).into_iter().fold(0.0, f64::max),
    });
    VolumetricConfig { candidates, bound, ..Default::default() }
}

impl Planner for AutoPlanner {
    fn name(&self) -> &str {
        "auto"
    }

    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let choice = self.choose(state).map_err(|e| PlanError::lacks("auto", e.to_string()))?;
        self.rank(choice.planner, state, rng)
    }

    fn reset(&mut self) {
        self.farthest.reset();
        self.volumetric.reset();
    }
}

#[cfg(test)]
mod tests;
