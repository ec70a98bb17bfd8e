//! The tree of frames over time, as `/tf` and `/tf_static` tell it.

mod error;
mod lookup;

pub use error::TransformError;
pub use lookup::Found;

use crate::messages::{TFMessage, TransformStamped};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::time::Duration;

/// Frames that are kept at most, and transforms of each: more come from no robot.
const FRAMES: usize = 4096;
const SAMPLES: usize = 1 << 16;

/// How a frame stands in its parent.
#[derive(Clone, Debug)]
struct Edge {
    parent: String,
    motion: Motion,
}

#[derive(Clone, Debug)]
enum Motion {
    Fixed(Isometry3<f64>),
    /// By time, nanoseconds, rising.
    Timed(VecDeque<(i64, Isometry3<f64>)>),
}

/// What is known of the frames.
#[derive(Clone, Debug)]
pub struct Transforms {
    edges: BTreeMap<String, Edge>,
    kept_ns: i64,
    complained: BTreeSet<String>,
}

impl Transforms {
    /// Nothing yet; transforms older than `kept` before the newest of their frame are dropped.
    pub fn new(kept: Duration) -> Self {
        let kept_ns = i64::try_from(kept.as_nanos()).unwrap_or(i64::MAX);
        Self { edges: BTreeMap::new(), kept_ns, complained: BTreeSet::new() }
    }

    /// Takes in a message of `/tf`, or of `/tf_static` where it is `fixed`. What cannot be used is left out, and told the first
    /// time.
    pub fn take(&mut self, message: &TFMessage, fixed: bool) -> Vec<String> {
        let mut complaints = Vec::new();
        for transform in &message.transforms {
            if let Err(why) = self.take_one(transform, fixed) {
                let complaint =
                    format!("transform of {:?} in {:?}: {why}", transform.child_frame_id, transform.header.frame_id);
                if self.complained.len() < FRAMES && self.complained.insert(complaint.clone()) {
                    complaints.push(complaint);
                }
            }
        }
        complaints
    }

    fn take_one(&mut self, transform: &TransformStamped, fixed: bool) -> Result<(), String> {
        let [child, parent] = [&transform.child_frame_id, &transform.header.frame_id].map(|f| plain(f).to_owned());
        if child.is_empty() || parent.is_empty() {
            return Err("a frame without a name, left out".to_owned());
        }
        if child == parent {
            return Err("a frame in itself, left out".to_owned());
        }
        let pose = transform.transform.rigid().map_err(|why| format!("{why}, left out"))?;
        if self.edges.len() >= FRAMES && !self.edges.contains_key(&child) {
            return Err(format!("more than {FRAMES} frames, left out"));
        }
        let known = self.edges.entry(child).or_insert_with(|| Edge { parent: parent.clone(), motion: empty(fixed) });
        let mut said = Ok(());
        if known.parent != parent {
            said = Err(format!("its parent was {:?} before: earlier transforms are discarded", known.parent));
            *known = Edge { parent, motion: empty(fixed) };
        }
        match &mut known.motion {
            motion if fixed => *motion = Motion::Fixed(pose),
            Motion::Fixed(_) => known.motion = Motion::Timed(VecDeque::from([(stamp(transform), pose)])),
            Motion::Timed(samples) => said = said.and(insert(samples, stamp(transform), pose, self.kept_ns)),
        }
        said
    }

    /// Names of all frames.
    pub fn frames(&self) -> BTreeSet<&str> {
        self.edges.iter().flat_map(|(child, edge)| [child.as_str(), edge.parent.as_str()]).collect()
    }
}

/// Without the slash that names of ROS 1 began with.
pub fn plain(frame: &str) -> &str {
    frame.strip_prefix('/').unwrap_or(frame)
}

fn stamp(transform: &TransformStamped) -> i64 {
    transform.header.stamp.nanoseconds()
}

fn empty(fixed: bool) -> Motion {
    if fixed { Motion::Fixed(Isometry3::identity()) } else { Motion::Timed(VecDeque::new()) }
}

fn insert(
    samples: &mut VecDeque<(i64, Isometry3<f64>)>,
    at: i64,
    pose: Isometry3<f64>,
    kept_ns: i64,
) -> Result<(), String> {
    let newest = samples.back().map(|s| s.0);
    let mut said = Ok(());
    if newest.is_some_and(|newest| at < newest.saturating_sub(kept_ns)) {
        // A recording that begins anew, or a simulator's clock set back.
        samples.clear();
        said = Err("time jumped back: earlier transforms are discarded".to_owned());
    }
    match samples.iter().rposition(|s| s.0 <= at) {
        Some(i) if samples[i].0 == at => samples[i].1 = pose,
        Some(i) => samples.insert(i + 1, (at, pose)),
        None => samples.push_front((at, pose)),
    }
    let newest = samples.back().map_or(at, |s| s.0);
    while samples.len() > SAMPLES || samples.front().is_some_and(|s| s.0 < newest.saturating_sub(kept_ns)) {
        samples.pop_front();
    }
    said
}

#[cfg(test)]
mod tests;
