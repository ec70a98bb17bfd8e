//! Confidence intervals by resampling: over episodes with the objects held fixed, and over objects.

use crate::metrics::{Column, Draw, Figure, Runs, efficiency};
use geometry::rng::stream;
use rand::RngExt;

/// What is drawn again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResampleUnit {
    /// Episodes, within each object: how far another run of the same objects may lie.
    Episodes,
    /// Objects, each with all its episodes: how far other objects may lie.
    Objects,
}

/// A value with its 95 % interval, if there is one: a single episode of each object says nothing of others, nor does a single
/// object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The value itself.
    pub value: f64,
    /// 2.5th percentile of the resampled values.
    pub low: Option<f64>,
    /// 97.5th percentile.
    pub high: Option<f64>,
}

/// Draws with repetition for lists of some sizes, the same for every policy: differences stay paired. They are drawn one at a
/// time, and anew whenever they are gone through: together they would take as much memory as all episodes times all draws.
#[derive(Clone, Debug)]
pub struct Draws {
    sizes: Vec<usize>,
    over: ResampleUnit,
    resamples: usize,
    seed: u64,
}

/// Draws for lists of these sizes.
pub fn draws(sizes: &[usize], over: ResampleUnit, resamples: usize, seed: u64) -> Draws {
    Draws { sizes: sizes.to_vec(), over, resamples, seed }
}

impl Draws {
    /// One after the other, the same ones every time.
    pub fn iter(&self) -> impl Iterator<Item = Draw> {
        let mut rng = stream(self.seed, "bootstrap");
        let sizes = &self.sizes;
        (0..self.resamples).map(move |_| -> Draw {
            match self.over {
                ResampleUnit::Episodes => sizes
                    .iter()
                    .enumerate()
                    .map(|(object, &n)| (object, (0..n).map(|_| rng.random_range(0..n)).collect()))
                    .collect(),
                ResampleUnit::Objects => (0..sizes.len())
                    .map(|_| {
                        let object = rng.random_range(0..sizes.len());
                        (object, (0..sizes[object]).collect())
                    })
                    .collect(),
            }
        })
    }
}

/// The value of a statistic of these columns over all episodes, with the interval of its values over the draws.
fn interval(
    value: Option<f64>,
    columns: &[&Column],
    draws: &Draws,
    statistic: impl Fn(&Draw) -> Option<f64>,
) -> Option<Interval> {
    let value = value?;
    if !differ(columns, draws) {
        return Some(Interval { value, low: None, high: None });
    }
    let mut values: Vec<f64> = draws.iter().filter_map(|draw| statistic(&draw)).filter(|v| v.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * (values.len().max(1) - 1) as f64).round() as usize).copied();
    Some(Interval { value, low: at(0.025), high: at(0.975) })
}

/// Whether any draw has other episodes than the rest, of those that have a value in every column.
fn differ(columns: &[&Column], draws: &Draws) -> bool {
    let known = |draw: Draw| -> Vec<(usize, usize)> {
        let all = draw.iter().flat_map(|(object, episodes)| episodes.iter().map(move |&e| (*object, e)));
        let in_all = |&(object, e): &(usize, usize)| columns.iter().all(|column| column.0[object][e].is_some());
        let mut known: Vec<_> = all.filter(in_all).collect();
        known.sort_unstable();
        known.dedup();
        known
    };
    let mut sets = draws.iter().map(known).filter(|set| !set.is_empty());
    let first = sets.next();
    sets.any(|set| first.as_ref() != Some(&set))
}

/// Interval of a figure's mean.
pub fn mean_interval(column: &Column, draws: &Draws) -> Option<Interval> {
    interval(column.mean(), &[column], draws, |d| column.mean_of(d))
}

/// Interval of the efficiency.
pub fn efficiency_interval(runs: &Runs, views_if_unreached: usize, draws: &Draws) -> Option<Interval> {
    let [c, v] = [Figure::FinalCoverage, Figure::ViewsTo(90)].map(|f| runs.column(f, views_if_unreached));
    interval(efficiency(c.mean(), v.mean()), &[&c, &v], draws, |d| efficiency(c.mean_of(d), v.mean_of(d)))
}

/// Interval of a figure's mean minus the baseline's, paired by object and episode: those where both have a value.
pub fn difference(
    runs: &Runs,
    baseline: &Runs,
    figure: Figure,
    views_if_unreached: usize,
    over: ResampleUnit,
    resamples: usize,
    seed: u64,
) -> Option<Interval> {
    let (a, b) = runs.paired(baseline);
    let [mut a, mut b] = [a, b].map(|r| r.column(figure, views_if_unreached));
    for (x, y) in a.0.iter_mut().flatten().zip(b.0.iter_mut().flatten()) {
        if x.is_none() || y.is_none() {
            (*x, *y) = (None, None);
        }
    }
    let draws = draws(&a.sizes(), over, resamples, seed);
    interval(Some(a.mean()? - b.mean()?), &[&a, &b], &draws, |d| Some(a.mean_of(d)? - b.mean_of(d)?))
}

/// Interval of the ratio of the efficiency to the baseline's, paired by object and episode.
pub fn efficiency_ratio(
    runs: &Runs,
    baseline: &Runs,
    views_if_unreached: usize,
    over: ResampleUnit,
    resamples: usize,
    seed: u64,
) -> Option<Interval> {
    let (a, b) = runs.paired(baseline);
    let columns = |r: &Runs| [Figure::FinalCoverage, Figure::ViewsTo(90)].map(|f| r.column(f, views_if_unreached));
    let ([ac, av], [bc, bv]) = (columns(&a), columns(&b));
    let draws = draws(&ac.sizes(), over, resamples, seed);
    let value = efficiency(ac.mean(), av.mean())? / efficiency(bc.mean(), bv.mean())?;
    interval(Some(value), &[&ac, &av, &bc, &bv], &draws, |d| {
        Some(efficiency(ac.mean_of(d), av.mean_of(d))? / efficiency(bc.mean_of(d), bv.mean_of(d))?)
    })
}

/// Interval of the efficiency minus the baseline's, over episodes, paired by object and episode.
pub fn efficiency_lead(
    runs: &Runs,
    baseline: &Runs,
    views_if_unreached: usize,
    resamples: usize,
    seed: u64,
) -> Option<Interval> {
    let (a, b) = runs.paired(baseline);
    efficiencies(&[a, b], views_if_unreached, resamples, seed, |e| e[0] - e[1])
}

/// Interval of how much of the lead of `leader` over `best` a policy closes, over episodes: 0 where it is level with
/// `best`, 1 where it is level with `leader`. All three paired by object and episode.
pub fn gap_closure(
    runs: &Runs,
    best: &Runs,
    leader: &Runs,
    views_if_unreached: usize,
    resamples: usize,
    seed: u64,
) -> Option<Interval> {
    let (a, b) = runs.paired(best);
    let (a, c) = a.paired(leader);
    let b = b.paired(&c).0;
    efficiencies(&[a, b, c], views_if_unreached, resamples, seed, |e| (e[0] - e[1]) / (e[2] - e[1]))
}

/// Interval of a statistic of the efficiencies of runs over the same episodes.
fn efficiencies(
    runs: &[Runs],
    views_if_unreached: usize,
    resamples: usize,
    seed: u64,
    statistic: impl Fn(&[f64]) -> f64,
) -> Option<Interval> {
    let columns: Vec<[Column; 2]> = runs
        .iter()
        .map(|r| [Figure::FinalCoverage, Figure::ViewsTo(90)].map(|f| r.column(f, views_if_unreached)))
        .collect();
    let draws = draws(&columns.first()?[0].sizes(), ResampleUnit::Episodes, resamples, seed);
    let all: Option<Vec<f64>> = columns.iter().map(|[c, v]| efficiency(c.mean(), v.mean())).collect();
    let every: Vec<&Column> = columns.iter().flatten().collect();
    interval(Some(statistic(&all?)), &every, &draws, |d| {
        let drawn: Option<Vec<f64>> = columns.iter().map(|[c, v]| efficiency(c.mean_of(d), v.mean_of(d))).collect();
        drawn.map(|e| statistic(&e))
    })
}

#[cfg(test)]
mod tests;
