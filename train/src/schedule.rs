//! Learning rate over time, and when to stop.

use serde::{Deserialize, Serialize};

/// How the learning rate moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScheduleKind {
    /// Reduced when the validation loss no longer falls (the reference's `ReduceLROnPlateau`).
    #[default]
    Plateau,
    /// Half a cosine from the full rate down to `min_learning_rate` at the last step.
    Cosine,
    /// Multiplied by `factor` every `step_epochs` epochs (PC-NBV's `StepLR`).
    Step,
    /// The full rate throughout.
    Constant,
}

/// Settings of the learning rate's course; the full rate itself belongs to the optimizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScheduleConfig {
    /// Course after the warm-up.
    pub kind: ScheduleKind,
    /// Optimizer steps over which the rate rises linearly from nothing; 0 for none.
    pub warmup_steps: u64,
    /// Multiplier of a reduction (plateau, step).
    pub factor: f64,
    /// Epochs without improvement before a reduction (plateau).
    pub patience: u32,
    /// Relative improvement that counts as one (plateau); PyTorch's 1e-4.
    pub threshold: f64,
    /// Epochs between reductions (step).
    pub step_epochs: u32,
    /// The rate never falls below this (all kinds but constant).
    pub min_learning_rate: f64,
}

impl Default for ScheduleConfig {
    fn default() -> Self {
        ScheduleConfig {
            kind: ScheduleKind::Plateau,
            warmup_steps: 0,
            factor: 0.5,
            patience: 3,
            threshold: 1e-4,
            step_epochs: 20,
            min_learning_rate: 0.0,
        }
    }
}

/// The course with its memory, which a checkpoint carries.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    config: ScheduleConfig,
    base_rate: f64,
    total_steps: u64,
    state: ScheduleState,
}

/// What a schedule remembers between epochs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScheduleState {
    /// Product of the reductions so far.
    pub scale: f64,
    /// Lowest loss seen; absent before the first epoch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<f64>,
    /// Epochs since it was seen.
    pub bad_epochs: u32,
}

impl Schedule {
    /// A fresh course of `total_steps` optimizer steps at full rate `base_rate`.
    pub fn new(config: &ScheduleConfig, base_rate: f64, total_steps: u64) -> Self {
        let state = ScheduleState { scale: 1.0, best: None, bad_epochs: 0 };
        Schedule { config: config.clone(), base_rate, total_steps, state }
    }

    /// Continues from a saved state.
    pub fn with_state(mut self, state: ScheduleState) -> Self {
        self.state = state;
        self
    }

    /// What must be saved to resume.
    pub fn state(&self) -> ScheduleState {
        self.state
    }

    /// The rate of optimizer step `step` (0-based) in epoch `epoch` (0-based).
    pub fn rate(&self, step: u64, epoch: u32) -> f64 {
        let c = &self.config;
        if step < c.warmup_steps {
            return self.base_rate * (step + 1) as f64 / c.warmup_steps as f64;
        }
        let floor = c.min_learning_rate.min(self.base_rate);
        match c.kind {
            ScheduleKind::Constant => self.base_rate,
            ScheduleKind::Plateau => (self.base_rate * self.state.scale).max(floor),
            ScheduleKind::Step => (self.base_rate * c.factor.powi((epoch / c.step_epochs.max(1)) as i32)).max(floor),
            ScheduleKind::Cosine => {
                let length = self.total_steps.saturating_sub(c.warmup_steps).max(1) as f64;
                let done = ((step - c.warmup_steps) as f64 / length).min(1.0);
                floor + (self.base_rate - floor) * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())
            }
        }
    }

    /// Takes note of an epoch's validation loss. A loss that is not finite counts as no improvement.
    pub fn observe(&mut self, loss: f64) {
        let s = &mut self.state;
        if loss.is_finite() && s.best.is_none_or(|best| loss < best * (1.0 - self.config.threshold)) {
            s.best = Some(loss);
            s.bad_epochs = 0;
        } else {
            s.bad_epochs += 1;
        }
        if s.bad_epochs > self.config.patience {
            s.bad_epochs = 0;
            s.scale *= self.config.factor;
        }
    }
}

/// Keeps the lowest value and counts the epochs since.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Lowest value; absent before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Epoch of it.
    pub epoch: u32,
    /// Epochs since.
    pub bad_epochs: u32,
}

impl Best {
    /// Whether `value` is the lowest so far; it is then kept.
    pub fn observe(&mut self, value: f64, epoch: u32) -> bool {
        let improved = value.is_finite() && self.value.is_none_or(|best| value < best);
        if improved {
            *self = Best { value: Some(value), epoch, bad_epochs: 0 };
        } else {
            self.bad_epochs += 1;
        }
        improved
    }

    /// Whether `patience` epochs (0: any number) have passed without a new lowest value.
    pub fn exhausted(&self, patience: u32) -> bool {
        patience > 0 && self.bad_epochs >= patience
    }
}

#[cfg(test)]
mod tests;
