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
/// A transform that is older by more than this than the newest of its frame comes of a clock that was set back; what overtakes each
/// other on the way differs by milliseconds.
const SET_BACK_NS: i64 = 500_000_000;

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

impl Edge {
    /// Whether its transforms are of a time that has not come yet for a clock that stands at `now`, nanoseconds.
    fn is_ahead_of(&self, now: i64) -> bool {
        match &self.motion {
            Motion::Fixed(_) => false,
            Motion::Timed(samples) => samples.back().is_some_and(|newest| newest.0 > now.saturating_add(SET_BACK_NS)),
        }
    }
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
    /// time. Where the clock was set back, the transforms of before are forgotten.
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
        let (at, mut said) = (transform.header.stamp.nanoseconds(), Ok(()));
        if !fixed && self.edges.get(&child).is_some_and(|edge| edge.is_ahead_of(at)) {
            // A recording that begins anew, or a simulator's clock set back: for all frames. What has come since then is not ahead.
            self.edges.retain(|_, edge| !edge.is_ahead_of(at));
            said = Err("time jumped back: earlier transforms are discarded".to_owned());
        }
        if self.edges.len() >= FRAMES && !self.edges.contains_key(&child) {
            return Err(format!("more than {FRAMES} frames, left out"));
        }
        let known = self.edges.entry(child).or_insert_with(|| Edge { parent: parent.clone(), motion: empty(fixed) });
        if known.parent != parent {
            said = Err(format!("its parent was {:?} before: earlier transforms are discarded", known.parent));
            *known = Edge { parent, motion: empty(fixed) };
        }
        match &mut known.motion {
            motion if fixed => *motion = Motion::Fixed(pose),
            Motion::Fixed(_) => known.motion = Motion::Timed(VecDeque::from([(at, pose)])),
            Motion::Timed(samples) => insert(samples, at, pose, self.kept_ns),
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

fn empty(fixed: bool) -> Motion {
    if fixed { Motion::Fixed(Isometry3::identity()) } else { Motion::Timed(VecDeque::new()) }
}

/// Sorts a transform in, and forgets what is older than `kept_ns` before the newest.
fn insert(samples: &mut VecDeque<(i64, Isometry3<f64>)>, at: i64, pose: Isometry3<f64>, kept_ns: i64) {
    match samples.iter().rposition(|s| s.0 <= at) {
        Some(i) if samples[i].0 == at => samples[i].1 = pose,
        Some(i) => samples.insert(i + 1, (at, pose)),
        None => samples.push_front((at, pose)),
    }
    let newest = samples.back().map_or(at, |s| s.0);
    while samples.len() > SAMPLES || samples.front().is_some_and(|s| s.0 < newest.saturating_sub(kept_ns)) {
        samples.pop_front();
    }
}

#[cfg(test)]
mod tests;
