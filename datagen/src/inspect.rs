//! What is inside a set, so that a person sees at a glance whether the data are sane.

use formats::{FormatError, Manifest, ObjectStatus, Sample, ShardReader, Split};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Bins of the score histogram, over [0, 1].
const BINS: usize = 20;

/// A set in numbers.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Inspection {
    /// Name of the data set.
    pub dataset: String,
    /// Hash of the settings.
    pub config_hash: String,
    /// The seed.
    pub seed: u64,
    /// Commit of the source tree.
    pub commit: String,
    /// Objects and samples per split.
    pub splits: BTreeMap<Split, [usize; 2]>,
    /// Objects per category.
    pub categories: BTreeMap<String, usize>,
    /// Objects that cannot be used, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Objects not made yet.
    pub missing: usize,
    /// Scores per twentieth of [0, 1].
    pub score_histogram: Vec<usize>,
    /// Decisions by number of candidates.
    pub candidates_per_decision: BTreeMap<usize, usize>,
    /// Mean coverage after each scan, over objects that got so far.
    pub mean_coverage: Vec<f64>,
    /// Mean overlap of each next view.
    pub mean_overlap: Vec<f64>,
    /// Fewest, mean and most points of a cloud.
    pub points: [f64; 3],
    /// Samples with a number that cannot be, or without normals.
    pub oddities: usize,
    /// Names of shards that cannot be read.
    pub unreadable: Vec<String>,
    /// One sample in words.
    pub sample: String,
}

/// Looks into every shard of a set.
///
/// # Errors
/// A directory without a manifest.
pub fn inspect(directory: &Path) -> Result<Inspection, FormatError> {
    let manifest = Manifest::read(directory)?;
    let mut seen = Inspection {
        dataset: manifest.dataset,
        config_hash: manifest.config_hash,
        seed: manifest.seed,
        commit: manifest.commit,
        score_histogram: vec![0; BINS],
        points: [f64::INFINITY, 0.0, 0.0],
        ..Inspection::default()
    };
    let (mut coverages, mut overlaps) = (Means::default(), Means::default());
    let mut num_samples = 0;
    for record in manifest.objects {
        *seen.categories.entry(record.category.clone()).or_default() += 1;
        match record.status {
            ObjectStatus::Missing => seen.missing += 1,
            ObjectStatus::Skipped { reason } => seen.skipped.push((record.object, reason)),
            ObjectStatus::Done { shard, coverage, overlap, .. } => {
                coverages.add(&coverage);
                overlaps.add(&overlap);
                let path = directory.join(shard);
                let read = |reader: ShardReader| (0..reader.len()).map(|index| reader.sample(index)).collect();
                let samples: Vec<Sample> = match ShardReader::open(&path).and_then(read) {
                    Ok(samples) => samples,
                    Err(error) => {
                        seen.unreadable.push(error.to_string());
                        continue;
                    }
                };
                let counts = seen.splits.entry(record.split).or_default();
                counts[0] += 1;
                counts[1] += samples.len();
                for (index, sample) in samples.iter().enumerate() {
                    seen.add(sample, num_samples == 0 && index == samples.len() / 2);
                }
                num_samples += samples.len();
            }
        }
    }
    seen.points[1] /= num_samples.max(1) as f64;
    if num_samples == 0 {
        seen.points = [0.0; 3];
    }
    (seen.mean_coverage, seen.mean_overlap) = (coverages.means(), overlaps.means());
    Ok(seen)
}

impl Inspection {
    fn add(&mut self, sample: &Sample, describe: bool) {
        let points = sample.cloud.len() as f64;
        self.points = [self.points[0].min(points), self.points[1] + points, self.points[2].max(points)];
        *self.candidates_per_decision.entry(sample.candidates.len()).or_default() += 1;
        for score in &sample.scores {
            if (0.0..=1.0).contains(score) {
                self.score_histogram[((score * BINS as f64) as usize).min(BINS - 1)] += 1;
            }
        }
        self.oddities += usize::from(sample.check().is_err());
        self.oddities += usize::from(!sample.cloud.has_normals());
        if describe {
            let (low, high) = sample.cloud.bounding_box();
            let best = sample.scores.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |b| b.0);
            let number = |list: &[f64]| list.get(best).copied().unwrap_or(f64::NAN);
            let place = sample.candidates.get(best).map(|c| c.view);
            self.sample = format!(
                "{} after {} scans: {} points, {:.3} x {:.3} x {:.3} m, coverage {:.3}; best of {} candidates is {best}: \
                 score {:.3}, coverage {:.3}, overlap {:.3}, {}",
                sample.object,
                sample.scan_index + 1,
                sample.cloud.len(),
                high.x - low.x,
                high.y - low.y,
                high.z - low.z,
                sample.current_coverage,
                sample.candidates.len(),
                number(&sample.scores),
                number(&sample.coverage),
                number(&sample.overlap),
                place.map_or_else(String::new, |v| format!(
                    "camera at {:.3} m looking at {:.3} m",
                    v.position, v.target
                )),
            );
        }
    }
}

#[derive(Default)]
struct Means(Vec<(f64, usize)>);

impl Means {
    fn add(&mut self, values: &[f64]) {
        self.0.resize(self.0.len().max(values.len()), (0.0, 0));
        for (slot, value) in self.0.iter_mut().zip(values) {
            *slot = (slot.0 + value, slot.1 + 1);
        }
    }

    fn means(&self) -> Vec<f64> {
        self.0.iter().map(|(sum, count)| sum / *count as f64).collect()
    }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}, settings {}, seed {}, commit {}", self.dataset, self.config_hash, self.seed, self.commit)?;
        for (split, [objects, samples]) in &self.splits {
            writeln!(f, "  {:<11} {objects:>6} objects {samples:>8} samples", format!("{split:?}").to_lowercase())?;
        }
        writeln!(
            f,
            "  {} categories, {} objects skipped, {} not made yet",
            self.categories.len(),
            self.skipped.len(),
            self.missing
        )?;
        for (object, reason) in self.skipped.iter().take(20) {
            writeln!(f, "    skipped {object}: {reason}")?;
        }
        writeln!(f, "clouds: {:.0} to {:.0} points, {:.0} on average", self.points[0], self.points[2], self.points[1])?;
        write!(f, "candidates per decision:")?;
        for (count, decisions) in self.candidates_per_decision.iter().rev().take(8) {
            write!(f, " {count} ({decisions} times)")?;
        }
        let list = |values: &[f64]| values.iter().map(|x| format!("{:.1}", 100.0 * x)).collect::<Vec<_>>().join(" ");
        writeln!(f, "\ncoverage by scan, %: {}", list(&self.mean_coverage))?;
        writeln!(f, "overlap by next view, %: {}", list(&self.mean_overlap))?;
        writeln!(f, "scores:")?;
        let most = self.score_histogram.iter().copied().max().unwrap_or(0).max(1);
        for (bin, &count) in self.score_histogram.iter().enumerate() {
            let bar = "#".repeat((count * 50).div_ceil(most));
            writeln!(f, "  {:.2} {count:>8} {bar}", bin as f64 / BINS as f64)?;
        }
        writeln!(f, "odd numbers: {}", self.oddities)?;
        for text in &self.unreadable {
            writeln!(f, "unreadable: {text}")?;
        }
        write!(f, "a sample: {}", self.sample)
    }
}
