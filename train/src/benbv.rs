//! BENBV-Net on samples of boundary decisions.

use crate::TrainError;
use crate::config::TrainConfig;
use crate::data::{self, Dataset};
use crate::episodes;
use crate::metrics::Ranking;
use crate::task::{Episodes, Task, Validation};
use burn::tensor::{Device, Tensor, TensorData};
use formats::Sample;
use geometry::rng::stream;
use model::checkpoint::Checkpoint;
use model::encode::{EncodeConfig, Encoded, encode, to_input};
use model::{BenbvNet, BenbvNetConfig, NetPlanner, NetPlannerConfig, position_weighted_loss, within_decision_loss};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// Samples in a validation batch.
const VALIDATION_BATCH: usize = 32;

/// The task of the paper: predict the score of every candidate.
#[derive(Debug)]
pub struct BenbvTask<'a> {
    config: &'a TrainConfig,
    data: &'a Dataset,
    refusals: Mutex<Vec<String>>,
}

/// Encoded samples with their true scores.
#[derive(Debug, Default)]
pub struct Batch {
    samples: Vec<Encoded>,
    scores: Vec<Vec<f32>>,
}

impl<'a> BenbvTask<'a> {
    /// Trains on this data under these settings.
    pub fn new(config: &'a TrainConfig, data: &'a Dataset) -> Self {
        BenbvTask { config, data, refusals: Mutex::new(Vec::new()) }
    }

    /// A sample in the network's terms, augmented where `augmented`; the stream decides how.
    fn prepare(&self, mut sample: Sample, augmented: bool, name: &str) -> Result<(Encoded, Vec<f32>), String> {
        data::check(&sample)?;
        let scores = sample.scores.iter().map(|&s| s as f32).collect();
        let mut rng = stream(self.config.seed, name);
        let mut settings = self.config.encode();
        if augmented {
            let augment = &self.config.augment;
            settings.diagonal_fraction = augment.draw_diagonal_fraction(&mut rng);
            let Sample { cloud, candidates, working_distance, cameras, .. } = &mut sample;
            augment.apply(cloud, candidates, working_distance, cameras, &mut rng);
        }
        let encoded = encode(&sample.observation(), &settings, &mut rng)
            .map_err(|e| format!("{} decision {}: {e}", sample.object, sample.scan_index))?;
        Ok((encoded, scores))
    }

    fn refuse(&self, reason: String) {
        let mut list = self.refusals.lock().unwrap_or_else(PoisonError::into_inner);
        list.push(format!("left out a sample: {reason}"));
    }
}

impl Task for BenbvTask<'_> {
    type Net = BenbvNet;
    type Batch = Batch;

    fn network(&self) -> BenbvNetConfig {
        self.config.network.clone()
    }

    fn network_without_dropout(&self) -> BenbvNetConfig {
        BenbvNetConfig { dropout: 0.0, ..self.network() }
    }

    fn encode(&self) -> EncodeConfig {
        self.config.encode()
    }

    fn visits(&self) -> usize {
        self.data.num_train() * self.config.augment.visits()
    }

    fn batch(&self, epoch: u32, visits: &[usize]) -> Result<Batch, TrainError> {
        let mut batch = Batch::default();
        for &visit in visits {
            let (sample, copy) = (visit % self.data.num_train(), visit / self.data.num_train());
            let name = format!("train/epoch/{epoch}/visit/{visit}");
            let augmented = self.config.augment.changes_visit(copy);
            match self.prepare(self.data.train_sample(sample)?, augmented, &name) {
                Ok((encoded, scores)) => {
                    batch.samples.push(encoded);
                    batch.scores.push(scores);
                }
                Err(reason) => self.refuse(reason),
            }
        }
        Ok(batch)
    }

    fn size(batch: &Batch) -> (usize, usize) {
        (batch.samples.len(), batch.scores.iter().map(Vec::len).sum())
    }

    fn loss(&self, net: &BenbvNet, batch: &Batch, device: &Device) -> Tensor<1> {
        let width = batch.scores.iter().map(Vec::len).max().unwrap_or(0);
        let counts: Vec<usize> = batch.scores.iter().map(Vec::len).collect();
        let target = padded(&batch.scores, width, device);
        let Ok(input) = to_input(&batch.samples, width, device) else {
            // Every sample was checked by `encode`, and the batch is as wide as the widest.
            unreachable!("a batch of encoded samples fits its own width");
        };
        let predicted = net.forward(input); // [B, K]
        let loss = position_weighted_loss(predicted.clone(), target.clone(), &counts);
        match self.config.loss.within_decision {
            0.0 => loss,
            weight => loss + within_decision_loss(predicted, target, &counts) * weight,
        }
    }

    fn validate(&self, net: &BenbvNet, device: &Device) -> Result<Validation, TrainError> {
        let mut ranking = Ranking::default();
        let (mut loss, mut terms) = (0.0, 0);
        let indices: Vec<usize> = (0..self.data.num_validation()).collect();
        for chunk in indices.chunks(VALIDATION_BATCH) {
            let prepare = |&i: &usize| {
                let sample = self.data.validation_sample(i)?;
                Ok(self.prepare(sample, false, &format!("validation/{i}")))
            };
            let prepared = chunk.par_iter().map(prepare).collect::<Result<Vec<_>, TrainError>>()?;
            let mut batch = Batch::default();
            for result in prepared {
                match result {
                    Ok((encoded, scores)) => {
                        batch.samples.push(encoded);
                        batch.scores.push(scores);
                    }
                    Err(reason) => self.refuse(reason),
                }
            }
            let (samples, chunk_terms) = Self::size(&batch);
            if samples == 0 {
                continue;
            }
            let counts: Vec<usize> = batch.scores.iter().map(Vec::len).collect();
            let width = counts.iter().copied().max().unwrap_or(0);
            let Ok(input) = to_input(&batch.samples, width, device) else {
                unreachable!("a batch of encoded samples fits its own width");
            };
            let predicted = net.forward(input); // [B, K]
            let chunk_loss = position_weighted_loss(predicted.clone(), padded(&batch.scores, width, device), &counts);
            loss += f64::from(chunk_loss.into_scalar::<f32>()) * chunk_terms as f64;
            terms += chunk_terms;
            let rows: Vec<f32> = predicted.into_data().iter::<f32>().collect();
            for (row, scores) in rows.chunks(width).zip(&batch.scores) {
                ranking.add(&row[..scores.len()], scores);
            }
        }
        Ok(Validation { loss: loss / terms.max(1) as f64, ranking: ranking.means() })
    }

    fn episodes(&self, net: &BenbvNet, _: &Device) -> Option<Episodes> {
        let info = Checkpoint::new::<BenbvNet>(self.network(), self.encode());
        let planner = NetPlanner::new(net.clone(), info, NetPlannerConfig::default());
        Some(episodes::run(&self.config.episodes, || planner.clone()))
    }

    fn refusals(&self) -> Vec<String> {
        std::mem::take(&mut *self.refusals.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn data_name(&self) -> String {
        self.data.name().to_string()
    }
}

/// Scores as [B, width], zeros at the padding.
fn padded(scores: &[Vec<f32>], width: usize, device: &Device) -> Tensor<2> {
    let mut rows = Vec::with_capacity(scores.len() * width);
    for s in scores {
        rows.extend_from_slice(s);
        rows.resize(rows.len() + width - s.len(), 0.0);
    }
    Tensor::from_data(TensorData::new(rows, [scores.len(), width]), &device.clone().inner())
}
