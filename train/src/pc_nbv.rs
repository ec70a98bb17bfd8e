//! PC-NBV on gains from our simulator.

use crate::TrainError;
use crate::config::{PcNbvConfig, TrainConfig};
use crate::metrics::{Ranking, argmax};
use crate::pc_nbv_data::{GainSample, ObjectViews, episode_states};
use crate::task::{Episodes, Task, Validation};
use burn::tensor::{Device, Tensor, TensorData};
use datagen::episode::initial_view;
use datagen::{EpisodeConfig, Scene, procedural};
use geometry::View;
use geometry::rng::stream;
use geometry::sampling::sample_surface;
use model::encode::EncodeConfig;
use model::pc_nbv::{PcNbvNet, PcNbvNetConfig, VIEWS, gain_loss, normalise, view_directions};
use nalgebra::Point3;
use rand::RngExt;
use rayon::prelude::*;

/// Samples in a validation batch.
const VALIDATION_BATCH: usize = 16;
/// Surface samples per object.
const SURFACE: usize = 60_000;
/// Diagonal of an object, metres (docs/method.md, 'Setting').
const DIAGONAL: f64 = 0.2;

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

impl GainSet {
    /// States of procedural objects that belong to the seed. Objects that no view sees are left out.
    pub fn procedural(config: &PcNbvConfig, seed: u64) -> GainSet {
        let set: Vec<View> = view_directions()
            .iter()
            .map(|d| View { target: Point3::origin(), position: Point3::from(d * config.distance_m) })
            .collect();
        let amount = config.objects + config.validation_objects;
        let made: Vec<(ObjectViews, Vec<GainSample>)> =
            (0..amount).into_par_iter().filter_map(|i| object_states(config, &set, seed, i)).collect();
        let training = made.len() * config.objects / amount;
        let mut all = GainSet::default();
        for (i, (views, states)) in made.into_iter().enumerate() {
            let states = states.into_iter().map(|s| GainSample { object: i, ..s });
            if i < training {
                all.train.extend(states)
            } else {
                all.validation.extend(states)
            }
            all.objects.push(views);
        }
        all
    }
}

fn object_states(
    config: &PcNbvConfig,
    set: &[View],
    seed: u64,
    index: usize,
) -> Option<(ObjectViews, Vec<GainSample>)> {
    let name = format!("pc-nbv/{index}");
    let scene = Scene::new(procedural::mesh(seed, index as u64).normalized(DIAGONAL));
    let surface = sample_surface(scene.mesh(), SURFACE, &mut stream(seed, &format!("{name}/surface")));
    let episode = EpisodeConfig::default();
    let mut rng = stream(seed, &name);
    let mut views = set.to_vec();
    views.extend((1..config.starts).map(|_| initial_view(&episode, &mut rng)));
    let camera = episode.image.camera();
    let object = ObjectViews::scan(&scene, &surface, &views, &camera, &episode.render, config.tolerance_m)?;
    let mut states = Vec::new();
    for e in 0..config.starts {
        let start = if e == 0 { rng.random_range(0..set.len()) } else { set.len() + e - 1 };
        let direction = views[start].direction();
        let along: Vec<f32> = set.iter().map(|v| v.direction().dot(&direction) as f32).collect();
        let nearest = argmax(&along);
        let explore = if e % 2 == 1 { config.explore } else { 0.0 };
        states.extend(episode_states(index, &object, set.len(), start, nearest, config.steps, explore, &mut rng));
    }
    Some((object, states))
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
            (0..cloud.len()).chain((cloud.len()..n).map(|_| rng.random_range(0..cloud.len().max(1)))).collect()
        };
        let points: Vec<Point3<f64>> =
            chosen.iter().map(|&i| cloud.get(i).map_or(Point3::origin(), |p| Point3::from(p.map(f64::from)))).collect();
        batch.points.extend(normalise(&points).iter().flatten());
        batch.used.extend(sample.used.iter().map(|&u| f32::from(u8::from(u))));
        batch.gains.extend(&sample.gains);
    }

    fn tensors(&self, batch: &Batch, device: &Device) -> (Tensor<3>, Tensor<2>, Tensor<2>) {
        let (b, device) = (batch.gains.len() / VIEWS, device.clone().inner());
        let two = |rows: &[f32]| Tensor::from_data(TensorData::new(rows.to_vec(), [b, VIEWS]), &device);
        let points = TensorData::new(batch.points.clone(), [b, self.config.pc_nbv.points, 3]);
        (Tensor::from_data(points, &device), two(&batch.used), two(&batch.gains))
    }
}

impl Task for PcNbvTask<'_> {
    type Net = PcNbvNet;
    type Batch = Batch;

    fn network(&self) -> PcNbvNetConfig {
        PcNbvNetConfig { points: self.config.pc_nbv.points, gain_unit: self.config.pc_nbv.gain_unit }
    }

    fn encode(&self) -> EncodeConfig {
        EncodeConfig { points: self.config.pc_nbv.points, ..self.config.encode() }
    }

    fn visits(&self) -> usize {
        self.data.train.len()
    }

    fn batch(&self, epoch: u32, visits: &[usize]) -> Result<Batch, TrainError> {
        let mut batch = Batch::default();
        for &v in visits {
            self.push(&mut batch, &self.data.train[v], &format!("train/epoch/{epoch}/visit/{v}"));
        }
        Ok(batch)
    }

    fn size(batch: &Batch) -> (usize, usize) {
        (batch.gains.len() / VIEWS, batch.gains.len())
    }

    /// The published sum of squares, over a batch of the full size.
    fn loss(&self, net: &PcNbvNet, batch: &Batch, device: &Device) -> Tensor<1> {
        let (samples, _) = Self::size(batch);
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
            let (points, used, gains) = self.tensors(&batch, device);
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
