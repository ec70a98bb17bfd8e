//! The one loop of scanning and planning, for data generation, validation in training, and evaluation alike. It drives
//! the session that a robot's loop drives.

mod config;
mod first_scan;

use crate::pose_error::PoseError;
use crate::recording::Recording;
use crate::registration::{Displacements, RegistrationOutcome};
use crate::scene::{RenderScratch, Scene};
use crate::world::{ScanCamera, World, episode_session};
use geometry::metrics::{SurfaceDistances, surface_distances, views_to};
use geometry::rng::stream;
use geometry::{PointCloud, View};
use nalgebra::Point3;
use planning::{PlanError, Planner, RankedView, ScanState, Session, SessionError};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::time::Instant;

use first_scan::first_scan;

pub use config::{EpisodeConfig, EpisodeEvidence, ImageConfig};
pub use first_scan::initial_view;

/// Why an episode ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// All next views were taken.
    AllViews,
    /// Everything was covered.
    FullCoverage,
    /// The policy had no view to offer.
    NoView,
}

/// What happened. Equal for equal input and random stream, but for `decision_seconds`.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Episode {
    /// Views scanned from: the first, then the next views.
    pub views: Vec<View>,
    /// Coverage after each of `views`.
    pub coverages: Vec<f64>,
    /// Overlap of each next view's scan with the cloud before it; `None` for an empty scan.
    pub overlaps: Vec<Option<f64>>,
    /// Points of each scan.
    pub scan_points: Vec<usize>,
    /// Voxel edge of the cloud, metres.
    pub grid_size: f64,
    /// Points of the voxel-averaged reference surface.
    pub num_reference: usize,
    /// Chamfer and Hausdorff distance between the final cloud and the reference, metres.
    pub distances: SurfaceDistances,
    /// First views that were void before this one.
    pub void_draws: usize,
    /// Why it ended.
    pub end: End,
    /// How the scans were registered, if they had to be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<RegistrationOutcome>,
    /// Wall time of each decision, seconds: not an output that repeats.
    #[serde(skip)]
    pub decision_seconds: Vec<f64>,
    /// The final cloud.
    #[serde(skip)]
    pub cloud: PointCloud,
}

impl PartialEq for Episode {
    fn eq(&self, other: &Self) -> bool {
        let outcome = |e: &Self| (e.grid_size, e.num_reference, e.distances, e.void_draws, e.end);
        outcome(self) == outcome(other)
            && self.views == other.views
            && self.coverages == other.coverages
            && self.overlaps == other.overlaps
            && self.scan_points == other.scan_points
            && self.registration == other.registration
            && self.cloud == other.cloud
    }
}

impl Episode {
    /// Coverage after the last view.
    pub fn final_coverage(&self) -> f64 {
        self.coverages.last().copied().unwrap_or(0.0)
    }

    /// Views until the coverage first reaches `level`, the first scan being view 1; `None` if it never does.
    pub fn views_to(&self, level: f64) -> Option<usize> {
        views_to(&self.coverages, level)
    }
}

/// No first view was any good.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "none of {draws} first views gave a usable scan: the best had {points} points (wanted {min_points}) and covered \
     {:.1} % of the surface (wanted {:.1} %); {}",
    100.0 * coverage, 100.0 * min_coverage,
    match (ruled_out, crowded) {
        (Some(reason), _) => format!("and views were excluded, the last one because of: {reason}"),
        (None, Some((points, reference))) => format!(
            "a scan had more points than the reference ({points}, and the reference {reference}), which is void with \
             accumulate = \"matched\": raise surface_samples"
        ),
        (None, None) => "is the object of the expected size (0.2 m) and in view at this distance?".to_owned(),
    }
)]
pub struct VoidEpisode {
    /// First views tried.
    pub draws: usize,
    /// Most points of a scan.
    pub points: usize,
    /// Points wanted.
    pub min_points: usize,
    /// Largest coverage of a scan.
    pub coverage: f64,
    /// Coverage wanted.
    pub min_coverage: f64,
    /// What spoke against views that were not even tried.
    pub ruled_out: Option<String>,
    /// Points of the last scan that had more than the reference, and those of the reference: void as published.
    pub crowded: Option<(usize, usize)>,
}

/// Why there is no outcome.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EpisodeError {
    /// No usable first scan.
    #[error(transparent)]
    Void(#[from] VoidEpisode),
    /// The policy failed.
    #[error("next view {}: {error}", index + 1)]
    Plan {
        /// 0 for the first next view.
        index: usize,
        /// How.
        error: PlanError,
    },
    /// The session refused a recorded scan.
    #[error("recorded scan {} of the episode: {error}", scan + 1)]
    Refused {
        /// 0 for the first scan.
        scan: usize,
        /// Why.
        error: SessionError,
    },
}

/// A decision as it was taken.
pub struct Decision<'a> {
    /// 0 for the first next view.
    pub index: usize,
    /// What the policy saw.
    pub state: &'a ScanState,
    /// What it answered, best first. Empty: the episode ends.
    pub ranked: &'a [RankedView],
    /// The voxel-averaged reference surface.
    pub reference: &'a [Point3<f64>],
    /// Coverage before the view.
    pub current_coverage: f64,
}

/// Scans an object: a first view, then those of the policy. `samples` are the 60,000 surface samples, not yet
/// averaged. Draws of the first view come from `rng` before all others, so that policies given equal streams start
/// from equal views.
///
/// ```
/// use datagen::{EpisodeConfig, Scene, procedural, run_episode};
/// use geometry::{rng::stream, sampling::poisson_disk_sample};
/// use planning::{VolumetricConfig, VolumetricPlanner};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mesh = procedural::mesh(3, 0).normalized(0.2);
/// let samples = poisson_disk_sample(&mesh, 5_000, &mut stream(0, "surface"))?;
/// let config = EpisodeConfig { num_views: 2, ..Default::default() };
/// let mut planner = VolumetricPlanner::new(VolumetricConfig::default());
/// let episode = run_episode(&Scene::new(mesh), &samples, &mut planner, &config, &mut stream(0, "episode"))?;
/// assert_eq!(episode.coverages.len(), 3);
/// assert!(episode.final_coverage() > episode.coverages[0]);
/// # Ok(()) }
/// ```
///
/// # Errors
/// No usable first view, or a policy that fails.
pub fn run_episode<P: Planner + ?Sized>(
    scene: &Scene,
    samples: &[Point3<f64>],
    planner: &mut P,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
) -> Result<Episode, EpisodeError> {
    run_episode_with(scene, samples, planner, config, rng, |_, _| {})
}

/// [`run_episode`], showing every decision to `observe` together with the policy, after it decided and before its
/// view is scanned.
///
/// # Errors
/// As [`run_episode`].
pub fn run_episode_with<P: Planner + ?Sized>(
    scene: &Scene,
    samples: &[Point3<f64>],
    planner: &mut P,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
    mut observe: impl FnMut(&P, &Decision),
) -> Result<Episode, EpisodeError> {
    planner.reset();
    let decide = |session: &mut Session, progress: &Progress, rng: &mut ChaCha8Rng| {
        let state = session.state();
        let ranked = planner.rank_views(state, rng);
        let Progress { index, coverage, reference, .. } = *progress;
        let ranked_or_none = ranked.as_deref().unwrap_or_default();
        observe(planner, &Decision { index, state, ranked: ranked_or_none, reference, current_coverage: coverage });
        ranked
    };
    let session = episode_session(config, samples);
    run_session(Stage::Simulated { scene, samples }, session, config, rng, decide).map(|(episode, _)| episode)
}

/// How far an episode is when the next view is decided.
pub struct Progress<'a> {
    /// 0 for the first next view.
    pub index: usize,
    /// The view scanned last.
    pub view: &'a View,
    /// Coverage so far.
    pub coverage: f64,
    /// Overlap of the last scan with the cloud before it.
    pub overlap: Option<f64>,
    /// The voxel-averaged reference surface.
    pub reference: &'a [Point3<f64>],
}

/// What is scanned.
#[derive(Clone, Copy)]
pub enum Stage<'a> {
    /// An object in the simulator; `samples` are those of its surface, not yet averaged. The first view is drawn.
    Simulated {
        /// The object.
        scene: &'a Scene,
        /// Its surface.
        samples: &'a [Point3<f64>],
    },
    /// Recorded scans: views of others are passed over, and the episode ends where none is left.
    Recorded {
        /// The scans.
        recording: &'a Recording,
        /// The first one.
        start: usize,
        /// What the session may know about each; `None`: nothing, for orders that need no session.
        evidence: Option<EpisodeEvidence>,
    },
}

/// The loop itself: scans into a session, `decide` answering with views, best first, and the first of them scanned.
/// The session comes back with all scans.
///
/// # Errors
/// No usable first view, a decision that fails, a recorded scan that the session refuses.
pub fn run_session(
    stage: Stage,
    session: Session,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
    mut decide: impl FnMut(&mut Session, &Progress, &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError>,
) -> Result<(Episode, Session), EpisodeError> {
    let mut config = config.clone();
    let noise_key: u64 = rng.random();
    if let Some(noise) = &mut config.render.noise {
        noise.seed ^= noise_key;
    }
    let pose_error = config.pose_error.clone().map(|c| PoseError::new(c, stream(noise_key, "pose")));
    let displacements = config.registration.clone().map(|c| Displacements::new(c, noise_key));
    let mut camera = match stage {
        Stage::Simulated { scene, .. } => {
            let scratch = RenderScratch::default();
            ScanCamera::Simulated { scene, config: &config, scratch, pose_error, displacements }
        }
        Stage::Recorded { recording, .. } => ScanCamera::Recorded { recording, taken: vec![false; recording.len()] },
    };
    let mut world = World::new(session, &config, &stage);
    let (mut view, void_draws) = match stage {
        Stage::Simulated { .. } => first_scan(&mut camera, &mut world, &config, rng)?,
        Stage::Recorded { recording, start, .. } => {
            let view = recording.views()[start];
            world.begin(world.shoot(&mut camera, &view)).map_err(|error| EpisodeError::Refused { scan: 0, error })?;
            (view, 0)
        }
    };
    let mut episode = Episode {
        views: vec![view],
        coverages: vec![world.covered],
        overlaps: Vec::new(),
        scan_points: vec![world.first_points],
        grid_size: world.grid_size,
        num_reference: world.reference().len(),
        distances: SurfaceDistances::default(),
        void_draws,
        end: End::AllViews,
        registration: None,
        decision_seconds: Vec::new(),
        cloud: PointCloud::default(),
    };
    for index in 0..config.num_views {
        if config.stop_at_full_coverage && world.covered >= 1.0 {
            episode.end = End::FullCoverage;
            break;
        }
        let overlap_before = episode.overlaps.last().copied().flatten();
        let clock = Instant::now();
        let answer = world.decide(|session, reference, coverage| {
            decide(session, &Progress { index, view: &view, coverage, overlap: overlap_before, reference }, rng)
        });
        episode.decision_seconds.push(clock.elapsed().as_secs_f64());
        let ranked = match answer {
            Err(error) if !error.is_end() => return Err(EpisodeError::Plan { index, error }),
            ranked => ranked.unwrap_or_default(),
        };
        let between = world.session.between();
        let at_hand = ranked.iter().chain(&between).filter(|r| camera.can_take(&r.view));
        let Some((best, bridge)) = world.session.first_registrable(at_hand) else {
            episode.end = End::NoView;
            break;
        };
        view = best.view;
        let shot = world.shoot(&mut camera, &view);
        episode.overlaps.push(world.overlap(&view, &shot));
        if bridge {
            world.bridges();
        }
        episode.scan_points.push(shot.points.len());
        world.add(shot).map_err(|error| EpisodeError::Refused { scan: index + 1, error })?;
        episode.views.push(view);
        episode.coverages.push(world.covered);
    }
    episode.registration = world.registration();
    episode.distances = surface_distances(&world.cloud().points, world.reference());
    episode.cloud = world.cloud().into_owned();
    Ok((episode, world.session))
}

#[cfg(test)]
mod tests;
