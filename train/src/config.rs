//! Settings of a training run.

use crate::TrainError;
use crate::augment::AugmentConfig;
use crate::schedule::ScheduleConfig;
use model::encode::{EncodeConfig, Fill, Normalisation, Orientation};
use model::pc_nbv::MIN_POINTS;
use model::{BenbvNetConfig, Precision};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::PathBuf;

/// Everything that decides a run; `configs/train.toml` lists it with its defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Seed of every random stream.
    pub seed: u64,
    /// Data sets, one or several: each a directory that `datagen` made, or one with the authors' `.bin` files, or
    /// such a file. Empty: the newest complete set under `runs/data` that has training objects.
    #[serde(deserialize_with = "one_or_several")]
    pub data: Vec<PathBuf>,
    /// Passes over the training samples.
    pub epochs: u32,
    /// Samples per optimizer step.
    pub batch: usize,
    /// Parts a batch is computed in, so that a large one fits the memory; batch norm sees a part at a time.
    pub accumulation: usize,
    /// `cpu`, or a GPU backend that was compiled in.
    pub device: String,
    /// Precision of the products of the shared MLP; anything but f32 takes a GPU that has it.
    pub precision: Precision,
    /// Which network.
    pub kind: NetworkKind,
    /// Sizes of BENBV-Net.
    pub network: BenbvNetConfig,
    /// What the network is shown.
    pub input: InputConfig,
    /// What is minimised.
    pub loss: LossConfig,
    /// Optimizer.
    pub optimizer: OptimizerConfig,
    /// Learning rate over time.
    pub schedule: ScheduleConfig,
    /// Augmentation.
    pub augment: AugmentConfig,
    /// Validation.
    pub validation: ValidationConfig,
    /// Closed-loop episodes.
    pub episodes: EpisodesConfig,
    /// When to save.
    pub checkpoint: CheckpointConfig,
    /// Loader threads.
    pub loader: LoaderConfig,
    /// Data of PC-NBV.
    pub pc_nbv: PcNbvConfig,
}

impl Default for TrainConfig {
    fn default() -> Self {
        TrainConfig {
            seed: 0,
            data: Vec::new(),
            epochs: 150,
            batch: 128,
            accumulation: 1,
            device: "cpu".into(),
            precision: Precision::default(),
            kind: NetworkKind::default(),
            network: BenbvNetConfig::default(),
            input: InputConfig::default(),
            loss: LossConfig::default(),
            optimizer: OptimizerConfig::default(),
            schedule: ScheduleConfig::default(),
            augment: AugmentConfig::default(),
            validation: ValidationConfig::default(),
            episodes: EpisodesConfig::default(),
            checkpoint: CheckpointConfig::default(),
            loader: LoaderConfig::default(),
            pc_nbv: PcNbvConfig::default(),
        }
    }
}

/// A path, or a list of paths; an empty path is none.
fn one_or_several<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<PathBuf>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "a path or a list of paths")]
    enum Paths {
        One(PathBuf),
        Several(Vec<PathBuf>),
    }
    Ok(match Paths::deserialize(deserializer)? {
        Paths::One(path) if path.as_os_str().is_empty() => Vec::new(),
        Paths::One(path) => vec![path],
        Paths::Several(paths) => paths,
    })
}

/// Networks that can be trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NetworkKind {
    /// BENBV-Net, on a data set.
    #[default]
    BenbvNet,
    /// The rival PC-NBV, on gains of procedural objects that are made as training starts.
    PcNbv,
}

/// Data of PC-NBV (Zeng et al., IROS 2020).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PcNbvConfig {
    /// Points per cloud; at least 17, a point and its 16 neighbours.
    pub points: usize,
    /// Share of the surface that one unit of the network's output stands for.
    pub gain_unit: f64,
    /// Procedural objects to train on.
    pub objects: usize,
    /// Further ones for validation.
    pub validation_objects: usize,
    /// Episodes per object: the first starts from a view of the set, the others from random views.
    pub starts: usize,
    /// Decisions per episode.
    pub steps: usize,
    /// Share of random decisions in every second episode.
    pub explore: f64,
    /// Distance of the 33 cameras from the object's centre, metres.
    pub distance_m: f64,
    /// Distance under which a surface point counts as covered, metres.
    pub tolerance_m: f64,
}

impl Default for PcNbvConfig {
    fn default() -> Self {
        PcNbvConfig {
            points: 512,
            gain_unit: 1.0,
            objects: 400,
            validation_objects: 50,
            starts: 3,
            steps: 10,
            explore: 0.5,
            distance_m: 1.5,
            tolerance_m: 0.002,
        }
    }
}

/// What the network is shown; the number of points is the network's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputConfig {
    /// Frame and scale of the cloud.
    pub normalisation: Normalisation,
    /// Axes of the cloud.
    pub orientation: Orientation,
    /// Clouds with fewer points than the network takes.
    pub fill: Fill,
}

/// The optimizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OptimizerConfig {
    /// Which one.
    pub kind: OptimizerKind,
    /// Full learning rate.
    pub learning_rate: f64,
    /// Weight decay (decoupled for `adamw`, L2 for `adam`).
    pub weight_decay: f64,
    /// Decay of the first moment.
    pub beta_1: f64,
    /// Decay of the second moment.
    pub beta_2: f64,
    /// Added to the root of the second moment; PyTorch's 1e-8.
    pub epsilon: f64,
    /// Largest L2 norm of the whole gradient, which is scaled down to it; 0 for no limit.
    pub clip_norm: f64,
    /// Decay per step of an exponential moving average of the weights, which is then validated and stored in
    /// place of the last weights; 0 for none.
    pub average_decay: f64,
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        OptimizerConfig {
            kind: OptimizerKind::Adamw,
            learning_rate: 1e-3,
            weight_decay: 0.01,
            beta_1: 0.9,
            beta_2: 0.999,
            epsilon: 1e-8,
            clip_norm: 0.0,
            average_decay: 0.0,
        }
    }
}

/// Kinds of optimizers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OptimizerKind {
    /// Loshchilov and Hutter 2019 (the reference).
    #[default]
    Adamw,
    /// Kingma and Ba 2015 (the paper).
    Adam,
}

/// The loss of BENBV-Net.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossConfig {
    /// Weight of the error within each decision beside the paper's loss; 0 as published.
    pub within_decision: f64,
}

/// Validation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ValidationConfig {
    /// Share of the objects that is held out where the data set names no validation objects.
    pub fraction: f64,
    /// Epochs without a lower validation regret after which training ends; 0 for never.
    pub patience: u32,
}

impl Default for ValidationConfig {
    fn default() -> Self {
        ValidationConfig { fraction: 0.2, patience: 0 }
    }
}

/// Closed-loop episodes on procedural objects that are in no data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodesConfig {
    /// Epochs between two rounds; 0 for none. The last epoch has one in any case.
    pub every_epochs: u32,
    /// Objects per round, an episode each; always the same ones.
    pub objects: usize,
    /// Next views per episode.
    pub views: usize,
}

impl Default for EpisodesConfig {
    fn default() -> Self {
        EpisodesConfig { every_epochs: 10, objects: 8, views: 15 }
    }
}

/// When to save. The best weights (lowest validation regret) are always kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CheckpointConfig {
    /// Optimizer steps between two saves of the whole state beside those at the end of every epoch; 0 for none.
    pub every_steps: u64,
    /// Epochs between checkpoints that are kept; 0 for none.
    pub keep_every_epochs: u32,
}

impl Default for CheckpointConfig {
    fn default() -> Self {
        CheckpointConfig { every_steps: 500, keep_every_epochs: 0 }
    }
}

/// Loader threads. They change no result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LoaderConfig {
    /// Threads that prepare batches; 0 for one per eight cores, at least one.
    pub workers: usize,
    /// Batches that each keeps ready.
    pub ready: usize,
}

impl Default for LoaderConfig {
    fn default() -> Self {
        LoaderConfig { workers: 0, ready: 2 }
    }
}

impl TrainConfig {
    /// Says in words what is out of range.
    pub fn validate(&self) -> Result<(), TrainError> {
        fn bad(key: &'static str, found: impl ToString, expected: impl Into<String>) -> TrainError {
            TrainError::setting(key, found, expected)
        }
        self.network.validate().map_err(|text| bad("network", "sizes as given", text.to_string()))?;
        // The least and the most: a mistyped number must not ask for all memory there is.
        let counts = [
            ("epochs", u64::from(self.epochs), 1, u64::from(u32::MAX)),
            ("batch", self.batch as u64, 1, 1 << 20),
            ("accumulation", self.accumulation as u64, 1, 1 << 20),
            ("augment.copies", u64::from(self.augment.copies), 0, 10_000),
            ("loader.ready", self.loader.ready as u64, 1, 1024),
            ("loader.workers", self.loader.workers as u64, 0, 1024),
            ("episodes.objects", self.episodes.objects as u64, 0, 1 << 20),
            ("episodes.views", self.episodes.views as u64, 0, 10_000),
            ("pc_nbv.points", self.pc_nbv.points as u64, MIN_POINTS as u64, 1 << 20),
            ("pc_nbv.objects", self.pc_nbv.objects as u64, 1, 1 << 20),
            ("pc_nbv.validation_objects", self.pc_nbv.validation_objects as u64, 1, 1 << 20),
            ("pc_nbv.starts", self.pc_nbv.starts as u64, 1, 10_000),
            ("pc_nbv.steps", self.pc_nbv.steps as u64, 1, 10_000),
            ("schedule.step_epochs", u64::from(self.schedule.step_epochs), 1, u64::from(u32::MAX)),
        ];
        for (key, value, least, most) in counts {
            if value < least {
                return Err(bad(key, value, format!("expected at least {least}")));
            }
            if value > most {
                return Err(bad(key, value, format!("expected at most {most}")));
            }
        }
        if self.accumulation > self.batch {
            return Err(bad("accumulation", self.accumulation, format!("expected at most the batch, {}", self.batch)));
        }
        let o = &self.optimizer;
        let a = &self.augment;
        let (p, within) = (&self.pc_nbv, self.loss.within_decision);
        let ranges: [(&'static str, f64, bool, &str); 19] = [
            ("loss.within_decision", within, within >= 0.0, "0 or more"),
            ("optimizer.learning_rate", o.learning_rate, o.learning_rate > 0.0, "a positive number"),
            ("optimizer.weight_decay", o.weight_decay, o.weight_decay >= 0.0, "0 or more"),
            ("optimizer.beta_1", o.beta_1, (0.0..1.0).contains(&o.beta_1), "a number in [0, 1)"),
            ("optimizer.beta_2", o.beta_2, (0.0..1.0).contains(&o.beta_2), "a number in [0, 1)"),
            ("optimizer.epsilon", o.epsilon, o.epsilon > 0.0, "a positive number"),
            ("optimizer.clip_norm", o.clip_norm, o.clip_norm >= 0.0, "0 (no limit) or more"),
            ("optimizer.average_decay", o.average_decay, (0.0..1.0).contains(&o.average_decay), "a number in [0, 1)"),
            ("augment.rotation_deg", a.rotation_deg, (0.0..=180.0).contains(&a.rotation_deg), "0 to 180"),
            ("augment.scale", a.scale, (0.0..1.0).contains(&a.scale), "a number in [0, 1)"),
            ("augment.noise_m", a.noise_m, a.noise_m >= 0.0, "0 or more"),
            ("augment.dropout", a.dropout, (0.0..1.0).contains(&a.dropout), "a share in [0, 1)"),
            ("augment.forget_cameras", a.forget_cameras, (0.0..=1.0).contains(&a.forget_cameras), "a share in [0, 1]"),
            ("augment.camera_error_deg", a.camera_error_deg, (0.0..=180.0).contains(&a.camera_error_deg), "0 to 180"),
            ("pc_nbv.gain_unit", p.gain_unit, p.gain_unit > 0.0, "a positive number"),
            ("pc_nbv.explore", p.explore, (0.0..=1.0).contains(&p.explore), "a share in [0, 1]"),
            ("pc_nbv.distance_m", p.distance_m, p.distance_m > 0.0, "a length above 0"),
            ("pc_nbv.tolerance_m", p.tolerance_m, p.tolerance_m > 0.0, "a length above 0"),
            (
                "validation.fraction",
                self.validation.fraction,
                self.validation.fraction > 0.0 && self.validation.fraction < 1.0,
                "a share in (0, 1)",
            ),
        ];
        for (key, value, fits, expected) in ranges {
            if !fits || !value.is_finite() {
                return Err(bad(key, value, format!("expected {expected}")));
            }
        }
        let [low, high] = a.diagonal_fraction;
        if !(low > 0.0 && low <= high && high.is_finite()) {
            return Err(bad(
                "augment.diagonal_fraction",
                format!("[{low}, {high}]"),
                "expected two positive numbers in rising order",
            ));
        }
        let s = &self.schedule;
        if !(s.factor > 0.0 && s.factor <= 1.0) {
            return Err(bad("schedule.factor", s.factor, "expected a number in (0, 1]"));
        }
        if !(s.min_learning_rate >= 0.0 && s.threshold >= 0.0) {
            return Err(bad(
                "schedule.min_learning_rate or schedule.threshold",
                s.min_learning_rate.min(s.threshold),
                "expected 0 or more",
            ));
        }
        Ok(())
    }

    /// How observations become tensors, apart from the diagonal's share, which each sample draws.
    pub fn encode(&self) -> EncodeConfig {
        EncodeConfig {
            points: self.network.points,
            normalisation: self.input.normalisation,
            orientation: self.input.orientation,
            fill: self.input.fill,
            diagonal_fraction: 1.0,
        }
    }
}

#[cfg(test)]
mod tests;
