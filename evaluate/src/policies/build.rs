//! From the name of a policy to a policy that runs.

use super::name::{Among, COUNT, Kind, NameError, Policy, See, Source};
use super::oracle::{OracleAmong, OraclePlanner};
use super::random_boundary::RandomBoundaryPlanner;
use super::random_sphere::RandomSpherePlanner;
use super::random_u_sphere::RandomSetPlanner;
use super::recorded::Order;
use super::refined::{self, RefinedPlanner};
use super::see::{SeeConfig, SeePlanner};
use super::{BoxedPlanner, PAPER_OFFSET, Radius, sphere};
use crate::config::EvaluateConfig;
use crate::learned::{Learned, LearnedError};
use crate::networks::{Networks, WeightsError};
use datagen::dataset::DatasetName;
use datagen::{Scene, SearchConfig, SearchPlanner};
use formats::config::digest;
use nalgebra::Point3;
use planning::candidates::Angles;
use planning::planners::farthest::{Distance, FarthestPlanner};
use planning::{AutoPlanner, SessionConfig};
use planning::{CandidateConfig, VolumetricPlanner};

/// Directions of a dense sphere.
const DENSE: usize = 500;

/// What policies are made from. Only the search and the oracles look at the scene.
pub struct PolicyContext<'a> {
    /// The object.
    pub scene: &'a Scene,
    /// Its surface samples, not yet averaged.
    pub samples: &'a [Point3<f64>],
    /// Settings.
    pub config: &'a EvaluateConfig,
    /// Weights.
    pub networks: &'a Networks,
}

/// Why a policy cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Its name is none, or does not go with the settings.
    #[error(transparent)]
    Name(#[from] NameError),
    /// Weights of a network are missing or unfit.
    #[error("{policy:?} needs weights: {cause}")]
    Weights {
        /// Its name.
        policy: String,
        /// What is wrong.
        cause: WeightsError,
    },
    /// It needs more than recorded scans.
    #[error(
        "{policy:?} does not run on recorded sequences: it needs the object or generates views; available are oracle, farthest, \
         auto, auto:EVIDENCE, random and recorded-order"
    )]
    NotOnRecordings {
        /// Its name.
        policy: String,
    },
    /// It chooses among recorded scans.
    #[error("{policy:?} only runs on recorded sequences (--dataset sequences)")]
    OnRecordingsAlone {
        /// Its name.
        policy: String,
    },
    /// The learned forecasts are missing or unfit.
    #[error("{policy:?} needs weights: {cause}")]
    Forecasts {
        /// Its name.
        policy: String,
        /// What is wrong.
        cause: LearnedError,
    },
}

/// `count` candidates from the candidates of the configuration: 20 as configured, more as targets x angles.
fn with_candidates(config: &CandidateConfig, count: usize) -> Option<CandidateConfig> {
    let tilts = config.tilts_deg.len();
    if count == config.num_targets && config.angles == Angles::Cycle {
        return Some(config.clone());
    }
    if tilts > 0 && count >= tilts && count.is_multiple_of(tilts) {
        return Some(CandidateConfig { num_targets: count / tilts, angles: Angles::All, ..config.clone() });
    }
    None
}

/// Digest of the weights or coefficients that a policy reads from files or carries; `None` where there are none. Episodes
/// with others do not count as done.
pub fn weights_of(policy: &Policy, config: &EvaluateConfig, networks: &Networks) -> Option<String> {
    match policy.kind() {
        Kind::Volumetric(Some(refined)) if refined.source == Source::Learned => {
            Some(digest(&std::fs::read(&config.weights.forecasts).unwrap_or_default()))
        }
        Kind::BenbvNet(directory) => networks.benbv_net_digest(directory.as_deref()),
        // Given views are not ranked by the network.
        Kind::Auto if config.dataset.name != DatasetName::Sequences => networks.benbv_net_digest(None),
        Kind::PcNbv { .. } => networks.pc_nbv_digest(),
        Kind::Own(own) => own.version.clone(),
        _ => None,
    }
}

/// Whether a policy can run with these settings and weights: nothing of an object is needed to tell.
///
/// # Errors
/// A number of candidates that the settings cannot make; weights missing or unfit; a policy that does not go with the kind
/// of data set.
pub fn check(policy: &Policy, config: &EvaluateConfig, networks: &Networks) -> Result<(), PolicyError> {
    if config.dataset.name == DatasetName::Sequences {
        let refusal = || PolicyError::NotOnRecordings { policy: policy.name().to_owned() };
        return Order::of(policy).map(drop).ok_or_else(refusal);
    }
    match policy.kind() {
        Kind::Search(Some(count))
        | Kind::FarthestAmong(count)
        | Kind::Oracle { among: Among::Candidates(count), .. } => candidates(policy, config, *count).map(drop),
        Kind::Volumetric(Some(refined)) if refined.source == Source::Learned => learned(policy, config).map(drop),
        Kind::BenbvNet(directory) => {
            networks.benbv_net(directory.as_deref()).map(drop).map_err(|source| unfit_weights(policy, source))
        }
        Kind::PcNbv { published } => {
            networks.pc_nbv(policy.name(), *published).map(drop).map_err(|source| unfit_weights(policy, source))
        }
        Kind::Random | Kind::RecordedOrder | Kind::AutoOn(_) => Err(on_recordings_alone(policy)),
        _ => Ok(()),
    }
}

fn on_recordings_alone(policy: &Policy) -> PolicyError {
    PolicyError::OnRecordingsAlone { policy: policy.name().to_owned() }
}

fn candidates(policy: &Policy, config: &EvaluateConfig, count: usize) -> Result<CandidateConfig, PolicyError> {
    Ok(with_candidates(&config.candidates, count).ok_or_else(|| policy.unfit(COUNT))?)
}

fn learned(policy: &Policy, config: &EvaluateConfig) -> Result<Learned, PolicyError> {
    Learned::read(&config.weights.forecasts)
        .map_err(|source| PolicyError::Forecasts { policy: policy.name().to_owned(), cause: source })
}

fn unfit_weights(policy: &Policy, source: WeightsError) -> PolicyError {
    PolicyError::Weights { policy: policy.name().to_owned(), cause: source }
}

/// Makes a policy.
///
/// # Errors
/// As [`check`].
pub fn make<'a>(policy: &Policy, context: &PolicyContext<'a>) -> Result<BoxedPlanner<'a>, PolicyError> {
    let (name, config) = (policy.name(), context.config);
    let search = |candidates| SearchConfig::of(&config.episode, candidates);
    let shifted = || SearchConfig { shifted: true, ..search(config.candidates.clone()) };
    Ok(match policy.kind() {
        Kind::Search(count) => {
            let candidates = candidates(policy, config, count.unwrap_or(config.candidates.num_targets))?;
            Box::new(SearchPlanner::new(context.scene, context.samples, search(candidates)))
        }
        Kind::ShiftedSearch => Box::new(SearchPlanner::new(context.scene, context.samples, shifted())),
        Kind::BenbvNet(directory) => {
            context.networks.benbv_net(directory.as_deref()).map_err(|source| unfit_weights(policy, source))?
        }
        Kind::PcNbv { published } => {
            context.networks.pc_nbv(name, *published).map_err(|source| unfit_weights(policy, source))?
        }
        Kind::See(See::Configured) => Box::new(SeePlanner::new(name, config.see.clone())),
        Kind::See(See::Fixed) => Box::new(SeePlanner::new(name, SeeConfig::fixed())),
        Kind::See(See::Paper) => Box::new(SeePlanner::paper()),
        Kind::RandomBoundary => Box::new(RandomBoundaryPlanner::new(config.candidates.clone())),
        Kind::RandomSphere(radius) => Box::new(RandomSpherePlanner::new(name, *radius)),
        Kind::RandomUSphere(radius) => Box::new(RandomSetPlanner::new(name, sphere::latitude_longitude(), *radius)),
        Kind::Random33(radius) => Box::new(RandomSetPlanner::new(name, sphere::pc_nbv_33(), *radius)),
        Kind::Volumetric(None) => Box::new(VolumetricPlanner::new(config.volumetric.clone())),
        Kind::Volumetric(Some(better)) => {
            let truth = |search| refined::Source::Truth { scene: context.scene, samples: context.samples, search };
            let source = match better.source {
                Source::True => truth(search(config.candidates.clone())),
                Source::Shifted => truth(shifted()),
                Source::Learned => refined::Source::Learned(learned(policy, config)?),
            };
            let replaced = refined::Replaced { gain: better.gain, overlap: better.overlap };
            Box::new(RefinedPlanner::new(name, config.volumetric.clone(), source, replaced))
        }
        Kind::Random | Kind::RecordedOrder | Kind::AutoOn(_) => return Err(on_recordings_alone(policy)),
        Kind::Own(own) => own.make(),
        Kind::Auto => {
            let session = SessionConfig { tolerance_m: config.episode.tolerance_m, ..SessionConfig::default() };
            let network = context.networks.of_auto().map_err(|source| unfit_weights(policy, source))?;
            Box::new(AutoPlanner::new(network, &session))
        }
        Kind::FarthestOnSphere(radius) => {
            let distance = match radius {
                Radius::Working => Distance::Beyond(0.0),
                Radius::Paper => Distance::Beyond(PAPER_OFFSET),
                Radius::Fixed(r) => Distance::Fixed(*r),
            };
            Box::new(FarthestPlanner::on_sphere(name, sphere::fibonacci(DENSE), distance, Point3::origin()))
        }
        Kind::FarthestAmong(count) => {
            let among = candidates(policy, config, *count)?;
            Box::new(FarthestPlanner::among_candidates(name, among, Some(Point3::origin())))
        }
        Kind::Oracle { among, radius, min_overlap } => {
            let among = match among {
                Among::Sphere => OracleAmong::Set(sphere::fibonacci(DENSE), *radius),
                Among::PcNbv33 => OracleAmong::Set(sphere::pc_nbv_33(), *radius),
                Among::Candidates(count) => OracleAmong::Candidates(candidates(policy, config, *count)?),
            };
            let search = search(config.candidates.clone());
            Box::new(OraclePlanner::new(name, context.scene, context.samples, among, search, *min_overlap))
        }
    })
}
