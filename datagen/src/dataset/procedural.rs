//! The built-in family of solids: training and test objects never meet.

use super::{DatasetConfig, DatasetError, Object, Source, SplitChoice, selection};
use formats::Split;

/// Objects taken where the user names no number: a look at the program in a few seconds.
const DEFAULT_OBJECTS: usize = 20;
/// Test objects are numbered from here.
const FIRST_TEST: u64 = 1 << 32;

pub(super) fn list(config: &DatasetConfig, seed: u64, validation_share: f64) -> Result<Vec<Object>, DatasetError> {
    if config.list.is_some() || config.root.is_some() {
        let text =
            "procedural objects are generated, not read: --list and --root do not apply; choose another --dataset";
        return Err(DatasetError::Choice(text.to_owned()));
    }
    let choice = config.split();
    let (word, first) = match choice {
        SplitChoice::Train => ("train", 0),
        SplitChoice::Test => ("test", FIRST_TEST),
    };
    let count = config.objects.or(config.per_category).unwrap_or(DEFAULT_OBJECTS);
    let objects = (0..count as u64).map(|i| Object {
        name: format!("procedural/{word}_{i:06}"),
        category: "procedural".to_owned(),
        split: Split::Train,
        source: Source::Procedural { seed, index: first + i },
    });
    Ok(selection::assign_splits(objects.collect(), choice, seed, validation_share))
}
