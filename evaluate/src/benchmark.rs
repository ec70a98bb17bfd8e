//! Objects x policies x episodes on all cores, resumable: the outcome of an episode depends on the settings, the object,
//! the policy and its number alone.

use crate::config::EvaluateConfig;
use crate::journal::{Contents, Entry, Journal, JournalError};
use crate::networks::Networks;
use crate::objects::{Body, Meshed, Object};
use crate::policies::recorded::{Order, replay};
use crate::policies::table::AboveTable;
use crate::policies::{BoxedPlanner, Policy, PolicyContext, PolicyError, make, weights_of};
use crate::record::{EpisodeKey, EpisodeRecord, Skipped, Timing};
use cpu_time::ThreadTime;
use datagen::{Decision, Episode, EpisodeError, run_episode_with};
use geometry::rng::stream;
use geometry::{NeighborGrid, View};
use nalgebra::Isometry3;
use planning::reach::{Obstacles, Reach, Tour};
use planning::{Planner, RankBy, RobotConfig};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a run stops.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    /// A policy cannot be made.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The journal cannot be written.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

/// Makes the policy that an episode runs, within reach of the table if there is one.
pub fn planner<'a>(
    policy: &Policy,
    object: &'a Meshed,
    config: &'a EvaluateConfig,
    networks: &'a Networks,
) -> Result<BoxedPlanner<'a>, PolicyError> {
    let context = PolicyContext { scene: &object.scene, samples: &object.samples, config, networks };
    let inner = make(policy, &context)?;
    Ok(match object.least_z {
        Some(z) => Box::new(AboveTable::new(inner, z)),
        None => inner,
    })
}

/// Whether a policy can run on an object: a recording must have the policy's inputs.
pub fn fits(object: &Object, policy: &Policy) -> bool {
    match &object.body {
        Body::Mesh(_) => true,
        Body::Recorded(recording) => Order::of(policy).is_some_and(|order| order.fits(recording)),
    }
}

/// The episodes of an object; on a recording one of each start, if it has the policy's inputs.
pub fn wanted<'a>(
    object: &'a Object,
    policies: &'a [Policy],
    config: &'a EvaluateConfig,
) -> impl Iterator<Item = (&'a Policy, EpisodeKey)> {
    policies.iter().flat_map(move |policy| {
        let episodes = match &object.body {
            _ if !fits(object, policy) => 0,
            Body::Mesh(_) => config.episodes,
            Body::Recorded(recording) => config.episodes.min(recording.len()),
        };
        let key = move |episode| EpisodeKey { object: object.name.clone(), policy: policy.to_string(), episode };
        (0..episodes).map(move |episode| (policy, key(episode)))
    })
}

/// One episode. Policies given the same object and number start from the same view.
///
/// # Errors
/// No usable first view, or a policy that fails.
pub fn episode(
    name: &str,
    object: &Meshed,
    planner: &mut (dyn Planner + Send + '_),
    number: usize,
    config: &EvaluateConfig,
    observe: impl FnMut(&Decision),
) -> Result<Episode, EpisodeError> {
    let mut rng = stream(config.seed, &format!("episode/{name}/{number}"));
    let mut observe = observe;
    run_episode_with(&object.scene, &object.samples, planner, &config.episode, &mut rng, |_, decision| {
        observe(decision)
    })
}

/// Runs what is missing of these objects' episodes and adds it to the journal and to `contents`. Returns early, with
/// what is done kept, once `stop` is set.
///
/// # Errors
/// A policy that cannot be made, a journal that cannot be written.
pub fn run(
    objects: &[Object],
    policies: &[Policy],
    config: &EvaluateConfig,
    networks: &Networks,
    journal: &Journal,
    contents: &mut Contents,
    stop: &AtomicBool,
    done: impl Fn(&EpisodeKey) + Sync,
) -> Result<(), BenchmarkError> {
    let have: BTreeSet<EpisodeKey> = contents.keys();
    let jobs: Vec<(&Object, &Policy, EpisodeKey)> = objects
        .iter()
        .flat_map(|object| wanted(object, policies, config).map(move |(policy, key)| (object, policy, key)))
        .filter(|(_, _, key)| !have.contains(key))
        .collect();
    let weights: BTreeMap<&str, Option<String>> =
        policies.iter().map(|policy| (policy.name(), weights_of(policy, config, networks))).collect();
    let entries: Vec<Entry> = jobs
        .into_par_iter()
        .with_max_len(1)
        .filter_map(|(object, policy, key)| {
            if stop.load(Ordering::Relaxed) {
                return None;
            }
            let weights = weights.get(key.policy.as_str()).cloned().flatten();
            Some(run_one(object, policy, key, weights, config, networks).and_then(|entry| {
                journal.append(&entry)?;
                match &entry {
                    Entry::Episode { record, .. } => done(&record.key),
                    Entry::Skipped(skipped) => done(&skipped.key),
                    Entry::Settings(_) => {}
                }
                Ok(entry)
            }))
        })
        .collect::<Result<_, _>>()?;
    for entry in entries {
        match entry {
            Entry::Episode { record, timing } => contents.episodes.push((record, timing)),
            Entry::Skipped(skipped) => contents.skipped.push(skipped),
            Entry::Settings(_) => {}
        }
    }
    contents.sort();
    Ok(())
}

/// The arm's way through the views of an episode, past the true surface.
fn tour(robot: &RobotConfig, object: &Object, episode: &Episode) -> Tour {
    const CELL_M: f64 = 0.05;
    let surface = object.mesh().map_or(&episode.cloud.points, |mesh| &mesh.samples);
    let grid = NeighborGrid::new(surface, CELL_M);
    let obstacles = Obstacles { measured: Some((surface, &grid)), ..Obstacles::default() };
    Reach::new(robot).tour(episode.views.iter().map(View::world_from_camera), &obstacles, &Isometry3::identity())
}

fn run_one(
    object: &Object,
    policy: &Policy,
    key: EpisodeKey,
    weights: Option<String>,
    config: &EvaluateConfig,
    networks: &Networks,
) -> Result<Entry, BenchmarkError> {
    let number = key.episode;
    let (clock, outcome) = match (&object.body, Order::of(policy)) {
        (Body::Mesh(mesh), _) => {
            let mut planner = planner(policy, mesh, config, networks)?;
            let clock = ThreadTime::now();
            let outcome = episode(&object.name, mesh, planner.as_mut(), number, config, |_| {});
            (clock, outcome.map(|episode| (episode, Vec::new())))
        }
        (Body::Recorded(recording), Some(order)) => {
            let mut rng = stream(config.seed, &format!("episode/{}/{number}", object.name));
            let rank_by = if config.volumetric.gain_only { RankBy::Gain } else { RankBy::Score };
            (ThreadTime::now(), replay(recording, order, number, &config.episode, rank_by, &mut rng))
        }
        (Body::Recorded(_), None) => {
            return Err(PolicyError::NotOnRecordings { policy: policy.name().to_owned() }.into());
        }
    };
    Ok(match outcome {
        Ok((outcome, forecasts)) => Entry::Episode {
            timing: Timing { episode_s: clock.elapsed().as_secs_f64(), decisions_s: outcome.decision_seconds.clone() },
            record: EpisodeRecord {
                weights,
                files: object.files.clone(),
                forecasts,
                arm: config.robot.as_ref().map(|robot| tour(robot, object, &outcome)),
                ..EpisodeRecord::new(key, &outcome)
            },
        },
        Err(error) => Entry::Skipped(Skipped { key, reason: error.to_string(), weights, files: object.files.clone() }),
    })
}
