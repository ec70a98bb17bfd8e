//! A run is resumed on the samples that it was begun with, wherever they lie, and on no others of the same names and number.
#![allow(missing_docs)]

mod common;

use common::{one_at_a_time, sample, tiny_config, write_set};
use formats::Split;
use std::collections::BTreeMap;
use train::{BenbvTask, Dataset, Outcome, Run, TrainError};

#[test]
fn other_samples_of_the_same_names_and_number_are_refused() {
    let _turn = one_at_a_time();
    let tmp = tempfile::tempdir().expect("temp dir");
    for (set, decision) in [("first", 0), ("moved", 0), ("other", 10)] {
        let samples = |object: &str| (decision..decision + 4).map(|d| sample(object, d, 8)).collect::<Vec<_>>();
        let objects = [("a", Split::Train, samples("a")), ("b", Split::Validation, samples("b"))];
        write_set(&tmp.path().join(set), &objects);
    }
    let config = tiny_config();
    let run = |set: &str, resume: bool, last: u64| -> Result<Outcome, TrainError> {
        let data = Dataset::open(&tmp.path().join(set), 0.2, config.seed)?;
        let stop = |step: u64| step >= last;
        let run = Run { dir: &tmp.path().join("run"), resume, quiet: true, stop: &stop, provenance: BTreeMap::new() };
        train::train(&BenbvTask::new(&config, &data), &config, &run)
    };
    run("first", false, 1).expect("begun");
    let text = run("other", true, u64::MAX).expect_err("other samples").to_string();
    assert!(text.contains("it was trained on synthetic (settings none, seed 7, 8 samples), contents "), "{text}");
    assert!(run("moved", true, u64::MAX).expect("the same samples").finished);
}
