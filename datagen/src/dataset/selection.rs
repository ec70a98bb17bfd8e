//! Which of the models found are taken, and for what.

use super::{DatasetConfig, DatasetError, Found, Object, SplitChoice, file_name, stem};
use formats::Split;
use rand::Rng;
use std::collections::BTreeMap;
use std::path::Path;

/// Takes what the settings ask for: exactly the models of a list, or a half, so many of each category.
pub(super) fn select(
    config: &DatasetConfig,
    root: &Path,
    choice: SplitChoice,
    found: Vec<Found>,
) -> Result<Vec<Found>, DatasetError> {
    let mut taken = match &config.list {
        Some(list) => listed(list, root, found)?,
        None => {
            let mut counts = BTreeMap::<String, usize>::new();
            let mut found: Vec<Found> = found.into_iter().filter(|f| f.half.is_none_or(|h| h == choice)).collect();
            found.sort_by(|a, b| a.name.cmp(&b.name));
            found.retain(|f| {
                let count = counts.entry(f.category.clone()).or_default();
                *count += 1;
                config.per_category.is_none_or(|most| *count <= most)
            });
            found
        }
    };
    taken.truncate(config.objects.unwrap_or(usize::MAX));
    if taken.is_empty() {
        let text = format!("no object is left under {root:?} with these settings (split, per_category, list, objects)");
        return Err(DatasetError::Choice(text));
    }
    Ok(taken)
}

/// The models that a file names, in its order.
fn listed(list: &Path, root: &Path, found: Vec<Found>) -> Result<Vec<Found>, DatasetError> {
    let bytes = formats::file::read(list)?;
    let text = String::from_utf8_lossy(&bytes);
    // Every way to name a model; one that fits several fits none.
    let mut names = BTreeMap::<String, Option<usize>>::new();
    for (i, f) in found.iter().enumerate() {
        let relative = f.path.strip_prefix(root).unwrap_or(&f.path);
        let slashes = |p: &Path| p.iter().map(|c| c.to_string_lossy()).collect::<Vec<_>>().join("/");
        let model = f.name.rsplit('/').next().unwrap_or_default().to_owned();
        let mut own = vec![
            f.name.clone(),
            model,
            slashes(relative),
            slashes(&relative.with_extension("")),
            file_name(&f.path),
            stem(&f.path),
        ];
        own.sort();
        own.dedup();
        for name in own {
            names.entry(name).and_modify(|entry| *entry = entry.filter(|&j| j == i)).or_insert(Some(i));
        }
    }
    let mut taken = vec![];
    for (index, line) in text.lines().enumerate() {
        let entry =
            line.split('#').next().unwrap_or("").trim_matches(|c: char| c.is_whitespace() || "\"',[]".contains(c));
        let entry = entry.trim_start_matches("./");
        if entry.is_empty() {
            continue;
        }
        let Some(Some(i)) = names.get(entry) else {
            let (list, root, entry) = (list.to_owned(), root.to_owned(), entry.to_owned());
            return Err(DatasetError::Unlisted { list, line: index + 1, entry, root });
        };
        if !taken.contains(i) {
            taken.push(*i);
        }
    }
    Ok(taken.into_iter().map(|i| found[i].clone()).collect())
}

/// Sets objects aside for validation, by draw of their names: `validation_share` of them, at least one of two.
pub(crate) fn assign_splits(
    mut objects: Vec<Object>,
    choice: SplitChoice,
    seed: u64,
    validation_share: f64,
) -> Vec<Object> {
    if choice == SplitChoice::Test {
        objects.iter_mut().for_each(|o| o.split = Split::Test);
        return objects;
    }
    let count = objects.len();
    let wanted = (validation_share * count as f64).round() as usize;
    let wanted = if validation_share > 0.0 && count >= 2 { wanted.clamp(1, count - 1) } else { 0 };
    let mut draws: Vec<(u64, usize)> = objects
        .iter()
        .enumerate()
        .map(|(i, o)| (geometry::rng::stream(seed, &format!("split/{}", o.name)).next_u64(), i))
        .collect();
    draws.sort_unstable();
    for &(_, i) in &draws[..wanted] {
        objects[i].split = Split::Validation;
    }
    objects
}
