//! Inverse kinematics: damped least squares from several starts, within the joints' limits.

use super::{JointKind, Joints, MOST_JOINTS, Reach, travel};
use geometry::rng;
use nalgebra::{Isometry3, SMatrix, SVector};
use rand::RngExt;

/// Starts: where the arm is, the middle of its limits, and others drawn once for all.
pub const SEEDS: usize = 24;
/// Steps from each.
const STEPS: usize = 60;
/// What is near enough: metres, radians.
const NEAR: [f64; 2] = [1e-5, 1e-4];
/// A radian counts as so many metres.
const LEVER: f64 = 0.3;

/// Joint values for a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// As many as move; the others are zero.
    pub joints: Joints,
    /// Travel from where the arm is.
    pub travel: f64,
}

/// Why no joint values give a pose.
#[derive(Clone, Debug, PartialEq)]
pub enum Unreached {
    /// The camera would be so far from the first joint, and the arm is so long, metres.
    TooFar(f64, f64),
    /// It could be without the limit of this joint.
    Limit(String),
    /// No values were found: from all starts the nearest was so far off, metres and radians.
    Nowhere([f64; 2]),
}

type Jacobian = SMatrix<f64, 6, MOST_JOINTS>;

impl Reach {
    /// Joint values within the limits that give this pose of the camera in the cell, from one of 24 starts.
    pub fn solve(&self, target: &Isometry3<f64>, seed: usize) -> Option<Solution> {
        if self.too_far(target).is_some() {
            return None;
        }
        let (joints, off) = self.descend(target, self.start(seed), true);
        let near = off[0] <= NEAR[0] && off[1] <= NEAR[1];
        let joints = self.unwound(joints);
        near.then(|| Solution { joints, travel: travel(&self.home(), &joints) })
    }

    fn too_far(&self, target: &Isometry3<f64>) -> Option<f64> {
        let first = self.cell_from_base * self.origins.first().copied().unwrap_or_default();
        let away = (target.translation.vector - first.translation.vector).norm();
        let slides = match self.axes.first() {
            Some((JointKind::Prismatic, _)) => self.limits[0][0].abs().max(self.limits[0][1].abs()),
            _ => 0.0,
        };
        (away > self.longest + slides).then_some(away)
    }

    /// Why [`Reach::solve`] found nothing.
    pub(super) fn unreached(&self, target: &Isometry3<f64>) -> Unreached {
        if let Some(away) = self.too_far(target) {
            return Unreached::TooFar(away, self.longest);
        }
        let mut nearest = [f64::INFINITY; 2];
        for seed in 0..SEEDS / 3 {
            let (joints, off) = self.descend(target, self.start(seed), false);
            if off[0] <= NEAR[0] && off[1] <= NEAR[1] {
                let beyond = |k: &usize| {
                    let [low, high] = self.limits[*k];
                    (low - joints[*k]).max(joints[*k] - high)
                };
                let worst = (0..self.len()).max_by(|a, b| beyond(a).total_cmp(&beyond(b)));
                if let Some(worst) = worst.filter(|k| beyond(k) > 0.0) {
                    return Unreached::Limit(self.names[worst].clone());
                }
            }
            if off[0] + LEVER * off[1] < nearest[0] + LEVER * nearest[1] {
                nearest = off;
            }
        }
        Unreached::Nowhere(nearest)
    }

    fn start(&self, seed: usize) -> Joints {
        let home = self.home();
        if seed == 0 {
            return home;
        }
        let mut rng = rng::stream(0, &format!("reach/start/{seed}"));
        std::array::from_fn(|k| match self.limits.get(k) {
            Some([low, high]) if seed == 1 => 0.5 * (low + high),
            Some([low, high]) => low + (high - low) * rng.random_range(0.05..0.95),
            None => 0.0,
        })
    }

    /// Downhill from a start: the values, and how far off they are, metres and radians.
    fn descend(&self, target: &Isometry3<f64>, start: Joints, within: bool) -> (Joints, [f64; 2]) {
        let mut joints = start;
        if within {
            self.clamp(&mut joints);
        }
        let mut damping = 1e-3;
        let (mut error, mut jacobian) = self.linearised(target, &joints);
        for _ in 0..STEPS {
            if near(&error) {
                break;
            }
            let mut normal = jacobian * jacobian.transpose();
            (0..6).for_each(|k| normal[(k, k)] += damping);
            let Some(solver) = normal.cholesky() else { break };
            let step = jacobian.transpose() * solver.solve(&error);
            let longest = step.amax().max(1e-12);
            let shorten = (0.7 / longest).min(1.0);
            let mut next: Joints = std::array::from_fn(|k| joints[k] + shorten * step[k]);
            if within {
                self.clamp(&mut next);
            }
            let (next_error, next_jacobian) = self.linearised(target, &next);
            if next_error.norm_squared() < error.norm_squared() {
                (joints, error, jacobian) = (next, next_error, next_jacobian);
                damping = (damping * 0.2).max(1e-9);
            } else if damping > 10.0 {
                break;
            } else {
                damping *= 10.0;
            }
        }
        let off = [error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm() / LEVER];
        (joints, off)
    }

    /// The same pose by whole turns less, where the limits allow it: each joint as near as it can be to where it is.
    fn unwound(&self, mut joints: Joints) -> Joints {
        let (turn, home) = (std::f64::consts::TAU, self.home());
        for (k, [low, high]) in self.limits.iter().enumerate().filter(|(k, _)| self.axes[*k].0 == JointKind::Revolute) {
            let nearer = joints[k] - turn * ((joints[k] - home[k]) / turn).round();
            if nearer >= *low && nearer <= *high {
                joints[k] = nearer;
            }
        }
        joints
    }

    fn clamp(&self, joints: &mut Joints) {
        let turn = std::f64::consts::TAU;
        for (value, [low, high]) in joints.iter_mut().zip(&self.limits) {
            // A turn more or less is the same, where the limits hold one.
            if *value > *high && *value - turn >= *low {
                *value -= turn;
            } else if *value < *low && *value + turn <= *high {
                *value += turn;
            }
            *value = value.clamp(*low, *high);
        }
    }

    /// What is left to the target, metres (rotations by the lever), and how it changes with the joints.
    fn linearised(&self, target: &Isometry3<f64>, joints: &Joints) -> (SVector<f64, 6>, Jacobian) {
        let mut frames = [Isometry3::identity(); MOST_JOINTS];
        let mut at = self.cell_from_base;
        for k in 0..self.len() {
            at = at * self.origins[k] * self.motion(k, joints[k]);
            frames[k] = at;
        }
        let camera = at * self.last_from_camera;
        let position = target.translation.vector - camera.translation.vector;
        let rotation = (target.rotation * camera.rotation.inverse()).scaled_axis() * LEVER;
        let mut error = SVector::<f64, 6>::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&position);
        error.fixed_rows_mut::<3>(3).copy_from(&rotation);
        let mut jacobian = Jacobian::zeros();
        for (k, frame) in frames.iter().enumerate().take(self.len()) {
            let (kind, axis) = &self.axes[k];
            let axis = frame.rotation * axis.into_inner();
            let (along, about) = match kind {
                JointKind::Prismatic => (axis, axis * 0.0),
                _ => (axis.cross(&(camera.translation.vector - frame.translation.vector)), axis * LEVER),
            };
            jacobian.fixed_view_mut::<3, 1>(0, k).copy_from(&along);
            jacobian.fixed_view_mut::<3, 1>(3, k).copy_from(&about);
        }
        (error, jacobian)
    }
}

fn near(error: &SVector<f64, 6>) -> bool {
    error.fixed_rows::<3>(0).norm() <= NEAR[0] && error.fixed_rows::<3>(3).norm() <= LEVER * NEAR[1]
}
