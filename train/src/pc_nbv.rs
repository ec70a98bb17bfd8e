//! PC-NBV on gains from our simulator.

use crate::TrainError;
use crate::config::TrainConfig;
use crate::metrics::Ranking;
use crate::pc_nbv_data::{GainSample, ObjectViews};
use crate::task::{Episodes, Task, Validation};
use burn::tensor::{Device, Tensor, TensorData};
use geometry::rng::stream;
use model::encode::EncodeConfig;
use model::pc_nbv::{PcNbvNet, PcNbvNetConfig, VIEWS, gain_loss, normalise};
use nalgebra::Point3;
use rand::Rng;

/// Samples in a validation batch.
const VALIDATION_BATCH: usize = 16;

/// Objects with the states of their episodes.
#[derive(Debug, Default)]
pub struct GainSet {
    /// The objects.
    pub objects: Vec<ObjectViews>,
    /// States to train on.
    pub train: Vec<GainSample>,
    /// States of other objects.
    pub validation: Vec<GainSample>,
}

/// Predict what each of the 33 fixed views would add.
#[derive(Debug)]
pub struct PcNbvTask<'a> {
    config: &'a TrainConfig,
    data: &'a GainSet,
}

/// Clouds, states and gains of some samples, row by row.
#[derive(Debug, Default)]
pub struct Batch {
    points: Vec<f32>,
    used: Vec<f32>,
    gains: Vec<f32>,
}

impl<'a> PcNbvTask<'a> {
    /// Trains on these states under these settings.
    pub fn new(config: &'a TrainConfig, data: &'a GainSet) -> Self {
        PcNbvTask { config, data }
    }

    /// Adds a sample with its cloud resampled by the stream of this name: a random subset, or points drawn again
    /// where there are too few (published).
    fn push(&self, batch: &mut Batch, sample: &GainSample, name: &str) {
        let object = &self.data.objects[sample.object];
        let cloud: Vec<[f32; 3]> = sample.scans.iter().flat_map(|&s| object.scan_points(s)).copied().collect();
        let n = self.config.pc_nbv.points;
        let mut rng = stream(self.config.seed, name);
        let chosen: Vec<usize> = if cloud.len() >= n {
            rand::seq::index::sample(&mut rng, cloud.len(), n).into_vec()
        } else {
            (0..cloud.len()).chain((cloud.len()..n).map(|_| rng.gen_range(0..cloud.len().max(1)))).collect()
        };
        let points: Vec<Point3<f64>> = chosen
            .iter()
            .map(|&i| cloud.get(i).map_or(Point3::origin(), |p| Point3::from(p.map(f64::from))))
            .collect();
        batch.points.extend(normalise(&points).iter().flatten());
        batch.used.extend(sample.used.iter().map(|&u| f32::from(u8::from(u))));
        batch.gains.extend(&sample.gains);
    }

    fn tensors(&self, batch: Batch, device: &Device) -> (Tensor<3>, Tensor<2>, Tensor<2>) {
        let (b, device) = (batch.gains.len() / VIEWS, device.clone().inner());
        let two = |rows| Tensor::from_data(TensorData::new(rows, [b, VIEWS]), &device);
        let points = TensorData::new(batch.points, [b, self.config.pc_nbv.points, 3]);
        (Tensor::from_data(points, &device), two(batch.used), two(batch.gains))
    }
}

impl Task for PcNbvTask<'_> {
    type Net = PcNbvNet;
    type Batch = Batch;

    fn network(&self) -> PcNbvNetConfig {
        PcNbvNetConfig { points: self.config.pc_nbv.points }
    }

    fn encode(&self) -> EncodeConfig {
        EncodeConfig { points: self.config.pc_nbv.points, ..self.config.encode() }
    }

    fn visits(&self) -> usize {
        self.data.train.len()
    }

    fn batch(&self, epoch: u32, visits: &[usize]) -> Batch {
        let mut batch = Batch::default();
        for &v in visits {
            self.push(&mut batch, &self.data.train[v], &format!("train/epoch/{epoch}/visit/{v}"));
        }
        batch
    }

    fn size(batch: &Batch) -> (usize, usize) {
        (batch.gains.len() / VIEWS, batch.gains.len())
    }

    /// The published sum of squares, over a batch of the full size.
    fn loss(&self, net: &PcNbvNet, batch: Batch, device: &Device) -> Tensor<1> {
        let (samples, _) = Self::size(&batch);
        let (points, used, gains) = self.tensors(batch, device);
        gain_loss(net.forward(points, used), gains) * (self.config.batch as f64 / samples.max(1) as f64)
    }

    fn validate(&self, net: &PcNbvNet, device: &Device) -> Result<Validation, TrainError> {
        let mut ranking = Ranking::default();
        let mut loss = 0.0;
        for (c, chunk) in self.data.validation.chunks(VALIDATION_BATCH).enumerate() {
            let mut batch = Batch::default();
            for (i, sample) in chunk.iter().enumerate() {
                self.push(&mut batch, sample, &format!("validation/{}", c * VALIDATION_BATCH + i));
            }
            let (points, used, gains) = self.tensors(batch, device);
            let predicted = net.forward(points, used); // [B, 33]
            loss += f64::from(gain_loss(predicted.clone(), gains).into_scalar::<f32>());
            let rows: Vec<f32> = predicted.into_data().iter::<f32>().collect();
            for (row, sample) in rows.chunks(VIEWS).zip(chunk) {
                ranking.add(row, &sample.gains);
            }
        }
        let samples = self.data.validation.len().max(1) as f64;
        Ok(Validation { loss: loss * self.config.batch as f64 / samples, ranking: ranking.means() })
    }

    fn episodes(&self, _: &PcNbvNet, _: &Device) -> Option<Episodes> {
        None
    }

    fn refusals(&self) -> Vec<String> {
        Vec::new()
    }

    fn data_name(&self) -> String {
        format!("{} objects, {} states", self.data.objects.len(), self.data.train.len() + self.data.validation.len())
    }
}
