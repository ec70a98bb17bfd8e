//! Sizes of BENBV-Net.

use serde::{Deserialize, Serialize};

/// Sizes of [`BenbvNet`](crate::BenbvNet); the default is the published network with 5.4 million parameters
/// (docs/method.md, 'Network, layer by layer').
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BenbvNetConfig {
    /// Points that a cloud is resampled to, N.
    pub points: usize,
    /// Candidates in a training batch, K; fewer are padded and masked. Inference takes any number.
    pub candidates: usize,
    /// Output channels of the shared MLP over positions.
    pub position_widths: Vec<usize>,
    /// Output channels of the shared MLP over normals.
    pub normal_widths: Vec<usize>,
    /// Output channels of the encoders of candidate positions and directions.
    pub boundary_widths: [usize; 2],
    /// Output channels of the encoders of density and view order; the last is also that of their fusion.
    pub context_widths: [usize; 2],
    /// Output channels of the shared MLP over past cameras (at most six layers); empty: the network is not told of them
    /// (published).
    pub past_widths: Vec<usize>,
    /// Channels of the trunk's three stages.
    pub trunk_widths: [usize; 3],
    /// Channels of the attention over candidates.
    pub attention_width: usize,
    /// Attention heads; divide the attention width.
    pub heads: usize,
    /// Channels of the score head's hidden layer.
    pub head_width: usize,
    /// Share of the score head's hidden units that training drops, in [0, 1).
    pub dropout: f64,
}

impl Default for BenbvNetConfig {
    fn default() -> Self {
        Self::paper()
    }
}

/// A limit far above any use.
pub(crate) const MOST: usize = 1 << 20;

/// What makes the sizes of a network impossible.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SizeError {
    /// A layer without channels, a list without layers.
    #[error("{key} = {found:?}: every size must be at least 1")]
    Zero {
        /// The setting.
        key: &'static str,
        /// Its sizes.
        found: Vec<usize>,
    },
    /// More than any use.
    #[error("{key} = {found:?}: no size may exceed {MOST}")]
    TooLarge {
        /// The setting.
        key: &'static str,
        /// Its sizes.
        found: Vec<usize>,
    },
    /// Heads that do not share the attention alike.
    #[error("heads = {heads} must divide attention_width = {width}")]
    Heads {
        /// Number of heads.
        heads: usize,
        /// Width of the attention.
        width: usize,
    },
    /// A number out of its range.
    #[error("{key} = {found}: expected {expected}")]
    Value {
        /// The setting.
        key: &'static str,
        /// Its value.
        found: String,
        /// What would do.
        expected: String,
    },
}

impl SizeError {
    pub(crate) fn value(key: &'static str, found: impl ToString, expected: impl Into<String>) -> Self {
        Self::Value { key, found: found.to_string(), expected: expected.into() }
    }
}

impl BenbvNetConfig {
    /// The published network: 5,425,921 parameters.
    pub fn paper() -> Self {
        Self {
            points: 4096,
            candidates: 20,
            position_widths: vec![64, 128, 256, 512, 1024],
            normal_widths: vec![64, 128, 256, 512],
            boundary_widths: [64, 128],
            context_widths: [32, 128],
            past_widths: Vec::new(),
            trunk_widths: [512, 256, 128],
            attention_width: 256,
            heads: 4,
            head_width: 64,
            dropout: 0.1,
        }
    }

    /// About a twentieth of the parameters, for training on a CPU and for embedding.
    pub fn compact() -> Self {
        Self {
            points: 1024,
            position_widths: vec![32, 64, 128, 256],
            normal_widths: vec![32, 64, 128],
            boundary_widths: [32, 64],
            context_widths: [16, 32],
            trunk_widths: [128, 64, 64],
            attention_width: 64,
            head_width: 32,
            ..Self::paper()
        }
    }

    /// A few thousand parameters, for tests.
    pub fn tiny() -> Self {
        Self {
            points: 64,
            candidates: 8,
            position_widths: vec![8, 16, 24],
            normal_widths: vec![8, 16],
            boundary_widths: [8, 8],
            context_widths: [4, 8],
            past_widths: Vec::new(),
            trunk_widths: [16, 16, 8],
            attention_width: 16,
            heads: 4,
            head_width: 8,
            dropout: 0.1,
        }
    }

    /// The preset of this name: `paper`, `compact` or `tiny`.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "paper" => Some(Self::paper()),
            "compact" => Some(Self::compact()),
            "tiny" => Some(Self::tiny()),
            _ => None,
        }
    }

    /// Channels after the fusion of both global features.
    pub fn global_width(&self) -> usize {
        self.position_widths.last().copied().unwrap_or(0) + self.normal_widths.last().copied().unwrap_or(0)
    }

    /// Channels that tell of a candidate by itself: its target, its direction, and past cameras.
    pub(crate) fn candidate_width(&self) -> usize {
        2 * self.boundary_widths[1] + self.past_widths.last().copied().unwrap_or(0)
    }

    /// Weights that a network of these sizes has at the very least: its matrices, without biases and norms.
    pub(crate) fn least_weights(&self) -> f64 {
        let chain = |first: f64, widths: &[usize]| {
            let widths = widths.iter().map(|&w| w as f64);
            widths.fold((first, 0.0), |(input, sum), output| (output, sum + input * output)).1
        };
        let global = self.global_width() as f64;
        let attention = self.attention_width as f64;
        chain(3.0, &self.position_widths)
            + chain(3.0, &self.normal_widths)
            + global * global
            + 2.0 * chain(3.0, &self.boundary_widths)
            + 2.0 * chain(1.0, &self.context_widths)
            + chain(3.0, &self.past_widths)
            + chain(global + self.candidate_width() as f64, &self.trunk_widths)
            + 4.0 * attention * attention
            + attention * self.head_width as f64
    }

    /// What makes these sizes impossible, in words that name the key, or `Ok`.
    pub fn validate(&self) -> Result<(), SizeError> {
        let widths = [
            ("position_widths", self.position_widths.as_slice()),
            ("normal_widths", self.normal_widths.as_slice()),
            ("boundary_widths", self.boundary_widths.as_slice()),
            ("context_widths", self.context_widths.as_slice()),
            ("trunk_widths", self.trunk_widths.as_slice()),
            ("attention_width", &[self.attention_width]),
            ("head_width", &[self.head_width]),
            ("points", &[self.points]),
            ("candidates", &[self.candidates]),
            ("heads", &[self.heads]),
        ];
        if let Some((key, found)) = widths.iter().find(|(_, w)| w.is_empty() || w.contains(&0)) {
            return Err(SizeError::Zero { key, found: found.to_vec() });
        }
        if self.past_widths.contains(&0) {
            return Err(SizeError::Zero { key: "past_widths", found: self.past_widths.clone() });
        }
        // A limit far above any use: a mistyped width must not ask for terabytes.
        if let Some((key, found)) = widths
            .iter()
            .chain([&("past_widths", self.past_widths.as_slice())])
            .find(|(_, w)| w.iter().any(|&w| w > MOST))
        {
            return Err(SizeError::TooLarge { key, found: found.to_vec() });
        }
        if !self.attention_width.is_multiple_of(self.heads) {
            return Err(SizeError::Heads { heads: self.heads, width: self.attention_width });
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return Err(SizeError::value("dropout", self.dropout, "a share in [0, 1)"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
