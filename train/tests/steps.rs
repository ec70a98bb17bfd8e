//! Steps that are read together are those that are read one by one; and a device that computes wrongly is found out. The CPU
//! stands in for a GPU here; `gpu.rs` has the same with one.
#![allow(missing_docs)]

mod common;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, Tensor};
use common::{all_numbers, one_at_a_time, sample, tiny_config, write_set};
use formats::Split;
use model::Precision;
use model::encode::Normalisation;
use train::agreement::{Bounds, check, compare, first_step};
use train::augment::AugmentConfig;
use train::config::TrainConfig;
use train::step::{Group, Step, Work};
use train::{BenbvTask, Dataset, Task, learner};

/// Twelve samples of which the sixth overflows in f32.
fn data(folder: &std::path::Path) -> Dataset {
    let mut samples: Vec<_> = (0..12).map(|d| sample("a", d, 8)).collect();
    samples[5].cloud.points[0].x = 1e30;
    write_set(folder, &[("a", Split::Train, samples), ("b", Split::Validation, vec![sample("b", 0, 8)])]);
    Dataset::open(folder, 0.2, 5).expect("a set")
}

fn config() -> TrainConfig {
    let mut config = tiny_config();
    config.augment = AugmentConfig::none();
    config.input.normalisation = Normalisation::AsIs;
    config.network.points = 150; // Every point of the cloud, so that the bad one is always seen.
    config.optimizer.average_decay = 0.8;
    config
}

/// Weights, statistics and average after these steps (number and samples of each), and what the steps came to.
fn after(
    config: &TrainConfig,
    data: &Dataset,
    steps: &[(u64, [usize; 4])],
    unread: bool,
) -> (Vec<f32>, Vec<f32>, Vec<Step>) {
    let (task, device) = (BenbvTask::new(config, data), Device::flex());
    let mut learner = learner::fresh(&task, config, &device).expect("a network");
    let mut came_to = Vec::new();
    for group in steps.chunks(if unread { steps.len() } else { 1 }) {
        let mut open = Group::new(&learner, unread);
        for (step, visits) in group {
            let parts = visits.chunks(2).map(|part| task.batch(0, part).expect("data")).collect();
            let work = Work::new::<BenbvTask>(*step, 1e-2, 0.0, parts);
            open.push(&task, config, &device, &mut learner, work);
        }
        came_to.extend(open.finish(&task, config, &device, &mut learner).into_iter().map(|(_, step)| step));
    }
    let average = learner.average.as_ref().map(all_numbers).unwrap_or_default();
    (all_numbers(&learner.net), average, came_to)
}

const GOOD: [(u64, [usize; 4]); 3] = [(0, [0, 1, 2, 3]), (1, [4, 6, 7, 8]), (3, [8, 9, 10, 11])];

#[test]
fn steps_read_together_are_those_read_one_by_one() {
    let _turn = one_at_a_time();
    let folder = tempfile::tempdir().expect("temp dir");
    let data = data(folder.path());
    let mut config = config();
    assert_eq!(after(&config, &data, &GOOD, true).0, after(&config, &data, &GOOD, false).0, "to the bit");
    config.optimizer.epsilon = 1.0; // Updates in proportion to the gradient, which Adam would otherwise scale by itself.
    let free = after(&config, &data, &GOOD, true);
    config.optimizer.clip_norm = 0.01;
    let (together, alone) = (after(&config, &data, &GOOD, true), after(&config, &data, &GOOD, false));
    let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let (worst, clipped) = (apart(&together.0, &alone.0), apart(&together.0, &free.0));
    assert!(worst < 1e-6 && clipped > 1e-4, "{worst:e} apart, {clipped:e} from what is not clipped");
    for (a, b) in together.2.iter().zip(&alone.2) {
        let (Step::Done { loss: a, gradient_norm: x }, Step::Done { loss: b, gradient_norm: y }) = (a, b) else {
            panic!("{a:?} {b:?}")
        };
        assert!((a - b).abs() < 1e-5 * b && (x - y).abs() < 1e-4 * y && *y > 0.01, "{a} {b}, {x} {y}");
    }
}

#[test]
fn a_bad_step_among_unread_ones_leaves_everything_as_it_was() {
    let _turn = one_at_a_time();
    let folder = tempfile::tempdir().expect("temp dir");
    let data = data(folder.path());
    let config = config();
    let [first, second, last] = GOOD;
    let with_bad = after(&config, &data, &[first, second, (2, [4, 5, 6, 7]), last], true);
    let without = after(&config, &data, &GOOD, false);
    assert!(
        matches!(&with_bad.2[2], Step::Skipped(why) if why.contains("its statistics overflow")),
        "{:?}",
        with_bad.2
    );
    assert!(with_bad.0.iter().all(|x| x.is_finite()));
    assert_eq!(with_bad.0, without.0, "weights, statistics, and by the last step the moments");
    assert_eq!(with_bad.1, without.1, "the average");
    let done: Vec<_> = with_bad.2.iter().filter(|step| matches!(step, Step::Done { .. })).cloned().collect();
    assert_eq!(done, without.2);
}

#[test]
fn a_device_that_computes_wrongly_is_found_out() {
    struct Off;
    impl ModuleMapper for Off {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            if D == 2 { param.map(|weight| weight * 1.02) } else { param }
        }
    }
    let _turn = one_at_a_time();
    let folder = tempfile::tempdir().expect("temp dir");
    let data = data(folder.path());
    let config = config();
    let (task, cpu) = (BenbvTask::new(&config, &data), Device::flex());
    let batch = task.batch(0, &[0, 1, 2, 3]).expect("data");
    let net = learner::fresh(&task, &config, &cpu).expect("a network").net;
    let text = check(&task, &config, &cpu, &net, &batch).expect("the same device").expect("usable samples");
    assert!(text.contains("gradients 0.00 % apart"), "{text}");

    let of = |weights| first_step(&task, &cpu, weights, &batch).expect("a step");
    let (sound, broken) = (of(net.clone().into_record()), of(net.map(&mut Off).into_record()));
    let text =
        compare("gpu", &sound, &broken, Bounds::of(Precision::F32)).expect_err("2 % off in every weight").to_string();
    assert!(text.contains("device `gpu` gives wrong results") && text.contains("--device cpu"), "{text}");
    let mut dead = sound.clone();
    dead.gradient.fill(f32::NAN);
    assert!(compare("gpu", &sound, &dead, Bounds::of(Precision::F32)).is_err(), "not a number is not close");
}
