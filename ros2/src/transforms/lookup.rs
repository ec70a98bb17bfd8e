//! A frame in another at a time.

use super::{Edge, FRAMES, Motion, TransformError, Transforms, plain};
use nalgebra::Isometry3;

/// A transform as it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// `base_from_frame`.
    pub pose: Isometry3<f64>,
    /// The longest time between two transforms that were interpolated, seconds, and of which frame they are.
    pub gap: Option<(f64, String)>,
}

impl Transforms {
    /// Where `frame` is in `base` at this time (nanoseconds; `None`: the newest that is known).
    ///
    /// # Errors
    /// A frame that is not known, trees without a connection, or a time that no transforms cover.
    pub fn lookup(&self, base: &str, frame: &str, at: Option<i64>) -> Result<Found, TransformError> {
        let (base, frame) = (plain(base), plain(frame));
        let mut found = Found { pose: Isometry3::identity(), gap: None };
        if base == frame {
            return Ok(found);
        }
        let (up, down) = (self.path(frame)?, self.path(base)?);
        let meet = up.iter().find_map(|a| down.iter().position(|b| a == b).map(|j| (*a, j)));
        let Some((meet, j)) = meet else {
            let root = |path: &[&str]| (*path.last().unwrap_or(&"")).to_owned();
            let [frame, base] = [frame, base].map(str::to_owned);
            return Err(TransformError::Unconnected { frame, root: root(&up), base, base_root: root(&down) });
        };
        let i = up.iter().position(|a| *a == meet).unwrap_or(0);
        let meet_from_frame = self.along(&up[..i], at, &mut found.gap)?;
        let meet_from_base = self.along(&down[..j], at, &mut found.gap)?;
        found.pose = meet_from_base.inverse() * meet_from_frame;
        Ok(found)
    }

    /// From a frame to the root of its tree.
    fn path<'a>(&'a self, frame: &'a str) -> Result<Vec<&'a str>, TransformError> {
        if !self.edges.contains_key(frame) && !self.edges.values().any(|e| e.parent == frame) {
            return Err(TransformError::Unknown { frame: frame.to_owned(), known: self.describe() });
        }
        let mut path = vec![frame];
        while let Some(edge) = self.edges.get(path[path.len() - 1]) {
            if path.len() > FRAMES || path.contains(&edge.parent.as_str()) {
                return Err(TransformError::Circle { frame: frame.to_owned() });
            }
            path.push(&edge.parent);
        }
        Ok(path)
    }

    fn describe(&self) -> String {
        const SHOWN: usize = 12;
        let frames: Vec<&str> = self.frames().into_iter().collect();
        match frames.len() {
            0 => "none has arrived on /tf or /tf_static".to_owned(),
            n if n <= SHOWN => frames.join(", "),
            n => format!("{}, and {} more", frames[..SHOWN].join(", "), n - SHOWN),
        }
    }

    /// The frames of a path one in another: the first in the parent of the last.
    fn along(
        &self,
        path: &[&str],
        at: Option<i64>,
        gap: &mut Option<(f64, String)>,
    ) -> Result<Isometry3<f64>, TransformError> {
        let mut pose = Isometry3::identity();
        for child in path {
            let Some(edge) = self.edges.get(*child) else { continue };
            let (parent_from_child, apart) = self.at(child, edge, at)?;
            if gap.as_ref().is_none_or(|g| apart > g.0) && apart > 0.0 {
                *gap = Some((apart, (*child).to_owned()));
            }
            pose = parent_from_child * pose;
        }
        Ok(pose)
    }

    /// The transform at a time, and the seconds between the two that it was interpolated from.
    fn at(&self, child: &str, edge: &Edge, at: Option<i64>) -> Result<(Isometry3<f64>, f64), TransformError> {
        let samples = match &edge.motion {
            Motion::Fixed(pose) => return Ok((*pose, 0.0)),
            Motion::Timed(samples) => samples,
        };
        let (Some(oldest), Some(newest)) = (samples.front(), samples.back()) else {
            return Err(TransformError::Unknown { frame: child.to_owned(), known: self.describe() });
        };
        let Some(at) = at else { return Ok((newest.1, 0.0)) };
        let seconds = |ns: i64| ns as f64 * 1e-9;
        let [name, parent] = [child, &edge.parent].map(str::to_owned);
        if at > newest.0 {
            return Err(TransformError::TooNew { child: name, parent, by_s: seconds(at - newest.0) });
        }
        if at < oldest.0 {
            let by_s = seconds(oldest.0 - at);
            return Err(TransformError::TooOld { child: name, parent, by_s, kept_s: seconds(self.kept_ns) });
        }
        let after = samples.partition_point(|s| s.0 < at);
        let (late, second) = samples[after];
        if late == at || after == 0 {
            return Ok((second, 0.0));
        }
        let (early, first) = samples[after - 1];
        let share = (at - early) as f64 / (late - early) as f64;
        // Half a turn between two transforms has no way to go: the nearer one is taken.
        let between = first.try_lerp_slerp(&second, share, 1e-9);
        Ok((between.unwrap_or(if share < 0.5 { first } else { second }), seconds(late - early)))
    }
}
