//! The policies that planning is measured against, by their names on the command line: one file each.

pub mod oracle;
#[cfg(feature = "networks")]
pub mod pc_nbv;
pub mod random_boundary;
pub mod random_sphere;
pub mod random_u_sphere;
pub mod refined;
pub mod see;
pub mod sphere;
pub mod table;

use crate::config::EvaluateConfig;
use crate::learned::Learned;
use crate::networks::Networks;
use datagen::{Scene, SearchConfig, SearchPlanner};
use formats::config::digest;
use geometry::View;
use nalgebra::Point3;
use oracle::{OracleAmong, OraclePlanner};
use planning::candidates::Angles;
use planning::planners::farthest::{Distance, FarthestPlanner};
use planning::{AutoPlanner, CandidateConfig, Planner, RankedView, ScanState, SessionConfig, VolumetricPlanner};
use random_boundary::RandomBoundaryPlanner;
use random_sphere::RandomSpherePlanner;
use random_u_sphere::RandomSetPlanner;
use refined::RefinedPlanner;
use see::{SeeConfig, SeePlanner};

/// How much farther than the working distance the published sphere policies stand from the centre, metres.
const PAPER_OFFSET: f64 = 0.3;
/// Directions of a dense sphere.
const DENSE: usize = 500;

/// Distance from the origin to cameras on a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// The working distance: as far as the policies that stand before the surface.
    Working,
    /// The working distance and 0.3 m, as published.
    Paper,
    /// This many metres.
    Fixed(f64),
}

impl Radius {
    /// In metres.
    pub fn metres(self, state: &ScanState) -> f64 {
        match self {
            Radius::Working => state.working_distance,
            Radius::Paper => state.working_distance + PAPER_OFFSET,
            Radius::Fixed(r) => r,
        }
    }
}

/// Variants of `volumetric`.
const REFINED: &str = "nothing, true, shifted or learned, or one of these with -gain or -overlap";

/// A view without a prediction.
pub(crate) fn ranked(view: View, score: f64) -> RankedView {
    RankedView { view, score, gain: None, overlap: None }
}

/// A policy ready to run.
pub type BoxedPlanner<'a> = Box<dyn Planner + Send + 'a>;

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
    /// No policy of this name.
    #[error("no policy is named {0:?}; `evaluate --list-policies` lists those there are")]
    Unknown(String),
    /// The part after the colon makes no sense.
    #[error("{policy:?}: found the variant {variant:?}, expected {expected}")]
    Variant {
        /// As given.
        policy: String,
        /// The variant.
        variant: String,
        /// What would do.
        expected: &'static str,
    },
    /// Weights are missing or unfit.
    #[error("{policy:?} needs weights: {message}")]
    Weights {
        /// As given.
        policy: String,
        /// What is wrong.
        message: String,
    },
}

/// Name, and what it is, of every policy.
pub const POLICIES: &[(&str, &str)] = &[
    ("benbv", "the paper's model-based search, 20 candidates; knows the object"),
    ("benbv:60", "the same with 20 targets x 3 angles (any multiple of 3, e.g. benbv:300)"),
    ("benbv:shifted", "yardstick: the search where it does not know at which parts of a pixel its samples will fall"),
    ("auto", "what `infer` does by default: the best that the evidence allows"),
    ("benbv-net", "the paper's network; no model of the object (benbv-net:DIR with the checkpoint in DIR)"),
    ("pc-nbv", "PC-NBV over its 33 views at the working distance (pc-nbv:paper: unmasked, 0.3 m farther)"),
    ("see", "SEE++ with parameters from the first scan"),
    ("see:r010", "SEE++ with r = 0.010, rho = 4e6"),
    ("see:paper", "SEE++ as the paper's benchmark called it"),
    ("random-boundary", "one of BENBV's candidates at random"),
    ("random-sphere", "random on a sphere at the working distance (random-sphere:paper: 0.3 m farther; :R metres)"),
    ("random-u-sphere", "latitude-longitude grid without repetition (:paper, :R as above)"),
    ("random-33", "PC-NBV's 33 views at random, without repetition (:paper, :R as above)"),
    ("volumetric", "carved voxels, expected surface, gain and overlap per view; 60 candidates, no model of the object"),
    (
        "volumetric:learned",
        "the same with learned gain and overlap, from --set weights.forecasts=FILE (:learned-gain, :learned-overlap)",
    ),
    ("farthest", "largest least angle to all past cameras, on a sphere of 500 views (:R in metres)"),
    ("farthest:60", "the same among BENBV's 60 candidates"),
    ("volumetric:true", "yardstick: volumetric with true gain and overlap (:true-gain, :true-overlap)"),
    ("volumetric:shifted", "yardstick: the same as the mean of images shifted by quarter pixels (:shifted-gain, ...)"),
    ("oracle:20", "yardstick: greedy true gain among BENBV's 20 candidates (any multiple of 3 too)"),
    ("oracle:60", "yardstick: greedy true gain among 20 targets x 3 angles"),
    ("oracle:60:0.3", "yardstick: the same with an overlap of at least 0.3"),
    ("oracle:33", "yardstick: greedy true gain among PC-NBV's 33 views (oracle:33:paper: 0.3 m farther)"),
    ("oracle:sphere", "yardstick: greedy true gain among 500 views on a sphere"),
];

/// The paper's policies, as `--preset paper` runs them.
pub const PAPER_POLICIES: &[&str] = &[
    "benbv",
    "random-boundary",
    "random-sphere:paper",
    "random-u-sphere:paper",
    "see:paper",
    "pc-nbv:paper",
    "benbv-net",
];

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
pub fn weights_of(policy: &str, config: &EvaluateConfig, networks: &Networks) -> Option<String> {
    let (family, variant) = policy.split_once(':').map_or((policy, None), |(f, v)| (f, Some(v)));
    match variant {
        Some(v) if family == "volumetric" && v.starts_with("learned") => {
            Some(digest(&std::fs::read(&config.weights.forecasts).unwrap_or_default()))
        }
        _ => networks.digest(family, variant),
    }
}

/// Makes a policy by its name.
pub fn make<'a>(policy: &str, context: &PolicyContext<'a>) -> Result<BoxedPlanner<'a>, PolicyError> {
    let (family, variant) = policy.split_once(':').map_or((policy, None), |(f, v)| (f, Some(v)));
    let config = context.config;
    let unfit = |expected| PolicyError::Variant {
        policy: policy.to_owned(),
        variant: variant.unwrap_or_default().to_owned(),
        expected,
    };
    let radius = |variant: Option<&str>| match variant {
        None => Ok(Radius::Working),
        Some("paper") => Ok(Radius::Paper),
        Some(v) => match v.parse() {
            Ok(r) if r > 0.0 && f64::is_finite(r) => Ok(Radius::Fixed(r)),
            _ => Err(unfit("nothing, paper, or a radius in metres, e.g. 1.5")),
        },
    };
    let candidates = |variant: Option<&str>, default: usize| {
        let count = variant.map_or(Some(default), |v| v.parse().ok());
        count
            .and_then(|count| with_candidates(&config.candidates, count))
            .ok_or_else(|| unfit("a number of candidates: 20, or a multiple of the number of angles, e.g. 60"))
    };
    let search = |candidates| SearchConfig::of(&config.episode, candidates);
    let weights = |message| PolicyError::Weights { policy: policy.to_owned(), message };
    Ok(match (family, variant) {
        ("benbv", Some("shifted")) => {
            let search = SearchConfig { shifted: true, ..search(config.candidates.clone()) };
            Box::new(SearchPlanner::new(context.scene, context.samples, search))
        }
        ("benbv", _) => {
            let candidates = candidates(variant, config.candidates.num_targets)?;
            Box::new(SearchPlanner::new(context.scene, context.samples, search(candidates)))
        }
        ("auto", None) => {
            let session = SessionConfig { tolerance_m: config.episode.tolerance_m, ..SessionConfig::default() };
            Box::new(AutoPlanner::new(context.networks.of_auto().map_err(weights)?, &session))
        }
        ("random-boundary", None) => Box::new(RandomBoundaryPlanner::new(config.candidates.clone())),
        ("random-sphere", _) => Box::new(RandomSpherePlanner::new(policy, radius(variant)?)),
        ("random-u-sphere", _) => {
            Box::new(RandomSetPlanner::new(policy, sphere::latitude_longitude(), radius(variant)?))
        }
        ("random-33", _) => Box::new(RandomSetPlanner::new(policy, sphere::pc_nbv_33(), radius(variant)?)),
        ("volumetric", None) => Box::new(VolumetricPlanner::new(config.volumetric.clone())),
        ("volumetric", Some(v)) => {
            let (source, what) = v.split_once('-').unwrap_or((v, "gain-overlap"));
            let (gain, overlap) = match what {
                "gain" => (true, false),
                "overlap" => (false, true),
                "gain-overlap" => (true, true),
                _ => return Err(unfit(REFINED)),
            };
            let source = match source {
                "true" | "shifted" => {
                    let search = SearchConfig { shifted: source == "shifted", ..search(config.candidates.clone()) };
                    refined::Source::Truth { scene: context.scene, samples: context.samples, search }
                }
                "learned" => {
                    let weights = |message| PolicyError::Weights { policy: policy.to_owned(), message };
                    let file = &config.weights.forecasts;
                    if file.as_os_str().is_empty() {
                        return Err(weights(
                            "make a file with the example learn_forecasts and give --set \
                                            weights.forecasts=FILE"
                                .to_owned(),
                        ));
                    }
                    refined::Source::Learned(Learned::read(file).map_err(weights)?)
                }
                _ => return Err(unfit(REFINED)),
            };
            let replaced = refined::Replaced { gain, overlap };
            Box::new(RefinedPlanner::new(policy, config.volumetric.clone(), source, replaced))
        }
        ("farthest", Some(v)) if v.parse::<usize>().is_ok() => {
            let among = candidates(variant, 60)?;
            Box::new(FarthestPlanner::among_candidates(policy, among, Some(Point3::origin())))
        }
        ("farthest", _) => {
            let distance = match radius(variant)? {
                Radius::Working => Distance::Beyond(0.0),
                Radius::Paper => Distance::Beyond(PAPER_OFFSET),
                Radius::Fixed(r) => Distance::Fixed(r),
            };
            Box::new(FarthestPlanner::on_sphere(policy, sphere::fibonacci(DENSE), distance, Point3::origin()))
        }
        ("see", None) => Box::new(SeePlanner::new(policy, config.see.clone())),
        ("see", Some("r010")) => Box::new(SeePlanner::new(policy, SeeConfig::fixed())),
        ("see", Some("paper")) => Box::new(SeePlanner::paper()),
        ("see", Some(_)) => return Err(unfit("nothing, r010 or paper")),
        ("oracle", _) => {
            let (set, rest) =
                variant.unwrap_or("60").split_once(':').map_or((variant.unwrap_or("60"), None), |(s, r)| (s, Some(r)));
            let (radius, min_overlap) = match rest {
                None => (Radius::Working, 0.0),
                Some("paper") => (Radius::Paper, 0.0),
                Some(r) => {
                    let least: f64 =
                        r.parse().map_err(|_| unfit("a set of views, then a least overlap, e.g. 60:0.3"))?;
                    (Radius::Working, least)
                }
            };
            let among = match set {
                "sphere" => OracleAmong::Set(sphere::fibonacci(DENSE), radius),
                "33" => OracleAmong::Set(sphere::pc_nbv_33(), radius),
                count => OracleAmong::Candidates(candidates(Some(count), 60)?),
            };
            let search = search(config.candidates.clone());
            Box::new(OraclePlanner::new(policy, context.scene, context.samples, among, search, min_overlap))
        }
        #[cfg(feature = "networks")]
        ("benbv-net", directory) => context.networks.benbv_net(directory).map_err(weights)?,
        #[cfg(feature = "networks")]
        ("pc-nbv", None | Some("paper")) => context.networks.pc_nbv(policy, variant.is_some()).map_err(weights)?,
        #[cfg(not(feature = "networks"))]
        ("benbv-net" | "pc-nbv", _) => {
            let message = "this program was built without networks; build it with `--features networks`".to_owned();
            return Err(PolicyError::Weights { policy: policy.to_owned(), message });
        }
        _ => return Err(PolicyError::Unknown(policy.to_owned())),
    })
}
