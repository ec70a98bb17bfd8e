//! The kernels that one training step launches on a GPU, by kind, and its time.
//!
//! `cargo run --release -p train --features wgpu --example gpu_kernels -- [batch] [points] [paper|compact] [precision]`
//!
//! Counts the second group of steps, so that nothing is compiled or tuned in between. Mesa's software driver serves for the
//! counts (with the feature `wgpu-untuned`, since autotune takes minutes there); its times say nothing about a card.

mod random_set;

use burn::cubecl::config::{TypeNameFormatLevel, type_name_format};
use burn::cubecl::logging::{LaunchObservation, LaunchObserver};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;
use train::step::{Group, Step, Work};
use train::{BenbvTask, Dataset, Task, TrainConfig, learner};

/// Steps of a group, which are read together.
const STEPS: usize = 2;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| arguments.get(i).and_then(|a| a.parse().ok()).unwrap_or(default);
    let (batch, points) = (number(0, 8), number(1, 256));
    let preset = arguments.get(2).map_or("paper", String::as_str);

    let folder = tempfile::tempdir()?;
    random_set::write(folder.path(), batch)?;
    let mut config = TrainConfig { batch, device: "wgpu".into(), ..Default::default() };
    config.network = model::BenbvNetConfig::preset(preset).ok_or("expected paper or compact")?;
    config.network.points = points;
    config.optimizer.clip_norm = 1.0;
    config.optimizer.average_decay = 0.998;
    if let Some(precision) = arguments.get(3) {
        config.precision = serde_json::from_value(serde_json::Value::String(precision.clone()))?;
    }
    let data = Dataset::open(folder.path(), 0.2, 0)?;
    let task = BenbvTask::new(&config, &data);
    let device = train::trainer::open_device(&config)?;
    let mut learner = learner::fresh(&task, &config, &device)?;
    let visits: Vec<usize> = (0..batch).collect();
    let counts = Arc::new(Counts::default());
    for round in 0..2 {
        let watching = (round == 1).then(|| LaunchObservation::new(counts.clone()));
        let began = Instant::now();
        let mut group = Group::new(&learner, true);
        for step in 0..STEPS as u64 {
            let work = Work::new::<BenbvTask>(step, 1e-3, 0.0, vec![task.batch(0, &visits)?]);
            group.push(&task, &config, &device, &mut learner, work);
        }
        let submitted = began.elapsed().as_secs_f64();
        let steps = group.finish(&task, &config, &device, &mut learner);
        drop(watching);
        if let Some((_, Step::Skipped(reason))) = steps.iter().find(|(_, step)| matches!(step, Step::Skipped(_))) {
            return Err(format!("a step was skipped: {reason}").into());
        }
        let done = began.elapsed().as_secs_f64();
        println!("group {}: {STEPS} steps submitted in {submitted:.3} s, done in {done:.3} s", round + 1);
    }
    counts.print();
    Ok(())
}

/// Launches by the name of the kernel.
#[derive(Default)]
struct Counts(Mutex<BTreeMap<&'static str, usize>>);

impl LaunchObserver for Counts {
    fn launched(&self, kernel: &'static str) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner).entry(kernel).or_default() += 1;
    }
}

impl Counts {
    fn print(&self) {
        let counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut by_name: BTreeMap<String, usize> = BTreeMap::new();
        for (name, count) in counts.iter() {
            *by_name.entry(type_name_format(name, TypeNameFormatLevel::Balanced)).or_default() += count;
        }
        let mut rows: Vec<(String, usize)> = by_name.into_iter().collect();
        rows.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let total: usize = rows.iter().map(|(_, count)| count).sum();
        println!("{:.0} kernels a step", total as f64 / STEPS as f64);
        for (name, count) in rows {
            println!("{:8.1}  {name}", count as f64 / STEPS as f64);
        }
    }
}
