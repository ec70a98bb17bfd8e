//! The paper's figures of merit, per episode and over many (method, 'Metrics').

use crate::record::EpisodeRecord;
use geometry::metrics::{overlap_variation, views_to};
use std::collections::{BTreeMap, BTreeSet};

/// A figure of one episode. `None` where an episode has none (the overlap of an empty scan).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Coverage after the last view, percent.
    FinalCoverage,
    /// Views to this share of the surface in percent, the first scan being view 1; never reached counts a sentinel.
    ViewsTo(u8),
    /// Area under the curve of coverage over so many views, the first scan being the first, as a share of the whole: their mean, percent.
    CoverageArea(usize),
    /// Straight from each camera position to the next, metres, summed.
    Path,
    /// Views, the first scan being one.
    Views,
    /// Travel of the arm's joints between the views that it takes, radians and metres, summed.
    JointTravel,
    /// Views that the arm cannot take.
    OutOfReach,
    /// Overlap of next view 1, 2 or 3, percent.
    Overlap(u8),
    /// Coefficient of variation of the overlaps of next views 1 to 3, percent.
    Cv3,
    /// The same of all next views.
    CvAll,
    /// Chamfer distance, millimetres.
    Chamfer,
    /// Hausdorff distance, millimetres.
    Hausdorff,
    /// Coverage after the first scan, percent.
    FirstCoverage,
    /// Coverage after so many next views, percent.
    CoverageAfter(usize),
    /// 100 where one of so many next views was merged and is off by more than the tolerance, else 0.
    FailedIn(u8),
    /// The same if it is still off at the end, after all adjustments.
    OffAtEnd(u8),
    /// Next views whose scans could not be registered.
    RefusedViews,
    /// Root mean square of how far the merged points are off, millimetres.
    Left,
    /// Share of merged points that are off by more than the tolerance, percent.
    Off,
}

impl Figure {
    /// Of one episode. `views_if_unreached` is what a level that was not reached counts as.
    pub fn of(self, record: &EpisodeRecord, views_if_unreached: usize) -> Option<f64> {
        match self {
            Figure::FinalCoverage => Some(100.0 * record.final_coverage()),
            Figure::ViewsTo(percent) => {
                Some(views_to(&record.coverages, f64::from(percent) / 100.0).unwrap_or(views_if_unreached) as f64)
            }
            Figure::CoverageArea(views) => {
                let sum: f64 = (0..views).map(|i| record.coverage_after(i)).sum();
                (views > 0).then(|| 100.0 * sum / views as f64)
            }
            Figure::Path => Some(record.views.windows(2).map(|w| (w[1].position - w[0].position).norm()).sum()),
            Figure::Views => Some(record.views.len() as f64),
            Figure::JointTravel => record.arm.map(|tour| tour.travel),
            Figure::OutOfReach => record.arm.map(|tour| tour.unreached as f64),
            Figure::Overlap(n) => record.overlaps.get(usize::from(n).checked_sub(1)?)?.map(|o| 100.0 * o),
            Figure::Cv3 => overlap_variation(record.overlaps.get(..3).unwrap_or(&record.overlaps)),
            Figure::CvAll => overlap_variation(&record.overlaps),
            Figure::Chamfer => Some(1e3 * record.chamfer_m),
            Figure::Hausdorff => Some(1e3 * record.hausdorff_m),
            Figure::FirstCoverage => record.coverages.first().map(|c| 100.0 * c),
            Figure::CoverageAfter(n) => Some(100.0 * record.coverage_after(n)),
            Figure::FailedIn(n) => {
                let outcome = record.registration.as_ref()?;
                let failed = outcome.views.iter().take(usize::from(n)).any(|v| v.failed);
                Some(if failed { 100.0 } else { 0.0 })
            }
            Figure::OffAtEnd(n) => {
                let views = record.registration.as_ref()?.views.iter().take(usize::from(n));
                let off: Option<Vec<bool>> = views.map(|v| v.failed_in_the_end()).collect();
                Some(if off?.contains(&true) { 100.0 } else { 0.0 })
            }
            Figure::RefusedViews => {
                record.registration.as_ref().map(|o| o.views.iter().filter(|v| v.refused.is_some()).count() as f64)
            }
            Figure::Left => record.registration.as_ref().map(|o| 1e3 * o.left_m),
            Figure::Off => record.registration.as_ref().map(|o| 100.0 * o.off_share),
        }
    }
}

/// The episodes of one policy, by object and number.
#[derive(Clone, Debug, Default)]
pub struct Runs<'a> {
    by_object: BTreeMap<&'a str, BTreeMap<usize, &'a EpisodeRecord>>,
}

/// Indices of episodes into each object's list, one list per object drawn.
pub type Draw = Vec<(usize, Vec<usize>)>;

impl<'a> Runs<'a> {
    /// Those of one policy.
    pub fn of(records: impl IntoIterator<Item = &'a EpisodeRecord>, policy: &str) -> Self {
        let mut runs = Self::default();
        for record in records.into_iter().filter(|r| r.key.policy == policy) {
            runs.by_object.entry(&record.key.object).or_default().insert(record.key.episode, record);
        }
        runs
    }

    /// Only this object's.
    pub fn object(&self, object: &str) -> Self {
        let by_object = self.by_object.iter().filter(|(o, _)| **o == object).map(|(o, e)| (*o, e.clone())).collect();
        Self { by_object }
    }

    /// Objects, in the order of their names.
    pub fn objects(&self) -> Vec<&'a str> {
        self.by_object.keys().copied().collect()
    }

    /// All episodes, by object and number.
    pub fn records(&self) -> impl Iterator<Item = &'a EpisodeRecord> + '_ {
        self.by_object.values().flat_map(|episodes| episodes.values().copied())
    }

    /// Number of episodes.
    pub fn len(&self) -> usize {
        self.by_object.values().map(BTreeMap::len).sum()
    }

    /// Whether there is no episode.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Both restricted to the objects and numbers that both have: pairs that start from the same view.
    pub fn paired(&self, other: &Self) -> (Self, Self) {
        let common: BTreeSet<(&str, usize)> = self
            .by_object
            .iter()
            .flat_map(|(o, episodes)| episodes.keys().map(move |&e| (*o, e)))
            .filter(|(o, e)| other.by_object.get(o).is_some_and(|episodes| episodes.contains_key(e)))
            .collect();
        let restrict = |runs: &Self| {
            let mut kept = Self::default();
            for (object, episodes) in &runs.by_object {
                for (&number, &record) in episodes {
                    if common.contains(&(*object, number)) {
                        kept.by_object.entry(object).or_default().insert(number, record);
                    }
                }
            }
            kept
        };
        (restrict(self), restrict(other))
    }

    /// The values of a figure, object by object.
    pub fn column(&self, figure: Figure, views_if_unreached: usize) -> Column {
        let of = |episodes: &BTreeMap<usize, &EpisodeRecord>| {
            episodes.values().map(|r| figure.of(r, views_if_unreached)).collect()
        };
        Column(self.by_object.values().map(of).collect())
    }

    /// Per object the coefficient of variation of its overlap list averaged over episodes (next views 1 to 3, percent),
    /// then the mean over objects: fits some rows of the paper.
    pub fn cv_of_mean_list(&self) -> Option<f64> {
        let columns = [1, 2, 3].map(|n| self.column(Figure::Overlap(n), 0));
        let per_object = (0..self.by_object.len()).filter_map(|i| {
            let list: Vec<Option<f64>> = columns.iter().map(|c| mean(c.0[i].iter().copied().flatten())).collect();
            overlap_variation(&list)
        });
        mean(per_object)
    }
}

/// Values of a figure: one list per object, one entry per episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Column(pub Vec<Vec<Option<f64>>>);

impl Column {
    /// Mean over objects of the mean over their episodes. `None` without a value.
    pub fn mean(&self) -> Option<f64> {
        mean(self.0.iter().filter_map(|episodes| mean(episodes.iter().copied().flatten())))
    }

    /// [`Column::mean`] of a draw with repetition.
    pub fn mean_of(&self, draw: &Draw) -> Option<f64> {
        mean(draw.iter().filter_map(|(object, episodes)| {
            let list = &self.0[*object];
            mean(episodes.iter().filter_map(|&e| list[e]))
        }))
    }

    /// Standard error of [`Column::mean`] with the objects held fixed.
    pub fn standard_error(&self) -> Option<f64> {
        let per_object: Vec<f64> = self
            .0
            .iter()
            .filter_map(|episodes| {
                let known: Vec<f64> = episodes.iter().copied().flatten().collect();
                let m = mean(known.iter().copied())?;
                let n = known.len() as f64;
                (n > 1.0).then(|| known.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (n * (n - 1.0)))
            })
            .collect();
        let n = per_object.len() as f64;
        (n > 0.0).then(|| per_object.iter().sum::<f64>().sqrt() / n)
    }

    /// Number of episodes per object.
    pub fn sizes(&self) -> Vec<usize> {
        self.0.iter().map(Vec::len).collect()
    }
}

/// Arithmetic mean; `None` without a value.
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Quantile of values at a share in [0, 1], linear between the two nearest (0.5: the median); `None` without a value.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let place = share * values.len().checked_sub(1)? as f64;
    let (below, above) = (values[place.floor() as usize], values[place.ceil() as usize]);
    // Two infinite values have no difference.
    Some(if below == above { below } else { below + place.fract() * (above - below) })
}

/// Efficiency, a ratio of means: mean final coverage in percent over mean number of views to 90 %.
pub fn efficiency(final_coverage: Option<f64>, views_to_90: Option<f64>) -> Option<f64> {
    Some(final_coverage? / views_to_90?)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::record::EpisodeKey;
    use datagen::End;
    use geometry::View;
    use nalgebra::Point3;

    pub(crate) fn record(object: &str, policy: &str, episode: usize, c: &[f64], o: &[Option<f64>]) -> EpisodeRecord {
        EpisodeRecord {
            key: EpisodeKey { object: object.into(), policy: policy.into(), episode },
            views: Vec::new(),
            coverages: c.to_vec(),
            overlaps: o.to_vec(),
            scan_points: vec![1000; c.len()],
            grid_size_m: 0.0023,
            num_reference: 5000,
            chamfer_m: 1e-4,
            hausdorff_m: 5e-3,
            void_draws: 0,
            end: End::AllViews,
            forecasts: Vec::new(),
            registration: None,
            arm: None,
            weights: None,
            files: None,
        }
    }

    #[test]
    fn figures_equal_brute_force() {
        let c = [0.3, 0.55, 0.81, 0.9, 0.93];
        let o = [Some(0.4), None, Some(0.6), Some(0.8)];
        let r = record("a", "p", 0, &c, &o);
        let of = |f: Figure| f.of(&r, 17);
        assert_eq!(of(Figure::FinalCoverage), Some(93.0));
        assert_eq!(of(Figure::FirstCoverage), Some(30.0));
        for (level, expected) in [(50, 2.0), (80, 3.0), (90, 4.0), (95, 17.0)] {
            let mut brute = 17.0;
            for i in (0..c.len()).rev() {
                if c[i] >= f64::from(level) / 100.0 {
                    brute = (i + 1) as f64;
                }
            }
            assert_eq!(brute, expected);
            assert_eq!(of(Figure::ViewsTo(level)), Some(brute));
        }
        assert_eq!(
            (of(Figure::Overlap(1)), of(Figure::Overlap(2)), of(Figure::Overlap(3))),
            (Some(40.0), None, Some(60.0))
        );
        // Seven views of which five were taken: the last coverage stays.
        let area: f64 = c.iter().sum::<f64>() + 2.0 * 0.93;
        assert!((of(Figure::CoverageArea(7)).unwrap() - 100.0 * area / 7.0).abs() < 1e-9);
        assert_eq!((of(Figure::CoverageArea(1)), of(Figure::CoverageArea(0))), (Some(30.0), None));
        let at = |x: f64, y: f64| View { target: Point3::origin(), position: Point3::new(x, y, 0.0) };
        let moved = EpisodeRecord { views: vec![at(0.0, 0.0), at(3.0, 4.0), at(3.0, 6.0)], ..r.clone() };
        assert_eq!((Figure::Path.of(&moved, 17), of(Figure::Path)), (Some(7.0), Some(0.0)));
        // By hand: 0.4 and 0.6 have mean 0.5 and population deviation 0.1.
        assert!((of(Figure::Cv3).unwrap() - 20.0).abs() < 1e-9);
        let all = [0.4, 0.6, 0.8f64];
        let m = all.iter().sum::<f64>() / 3.0;
        let sd = (all.iter().map(|x| (x - m).powi(2)).sum::<f64>() / 3.0).sqrt();
        assert!((of(Figure::CvAll).unwrap() - 100.0 * sd / m).abs() < 1e-9);
        assert!(
            (of(Figure::Chamfer).unwrap() - 0.1).abs() < 1e-12 && (of(Figure::Hausdorff).unwrap() - 5.0).abs() < 1e-12
        );
    }

    #[test]
    fn efficiency_is_a_ratio_of_means_not_a_mean_of_ratios() {
        let fast = record("a", "p", 0, &[0.5, 1.0], &[Some(0.4)]);
        let slow = record("a", "p", 1, &[0.5, 0.6, 0.7, 0.8, 0.9], &[Some(0.4); 4]);
        let runs = Runs::of([&fast, &slow], "p");
        let (c, v) = (runs.column(Figure::FinalCoverage, 17).mean(), runs.column(Figure::ViewsTo(90), 17).mean());
        assert_eq!((c, v), (Some(95.0), Some(3.5)));
        assert!((efficiency(c, v).unwrap() - 95.0 / 3.5).abs() < 1e-12);
        assert!((efficiency(c, v).unwrap() - (100.0 / 2.0 + 90.0 / 5.0) / 2.0).abs() > 1.0);
    }

    #[test]
    fn objects_weigh_alike_and_pairs_are_cut_to_what_both_have() {
        let list = [
            record("a", "p", 0, &[1.0], &[]),
            record("a", "p", 1, &[0.8], &[]),
            record("b", "p", 0, &[0.5], &[]),
            record("a", "q", 1, &[0.4], &[]),
            record("c", "q", 0, &[0.1], &[]),
        ];
        let (p, q) = (Runs::of(&list, "p"), Runs::of(&list, "q"));
        assert!((p.column(Figure::FinalCoverage, 17).mean().unwrap() - 70.0).abs() < 1e-9);
        assert_eq!(p.objects(), ["a", "b"]);
        let (pp, qq) = p.paired(&q);
        assert_eq!((pp.len(), qq.len()), (1, 1));
        assert!((pp.column(Figure::FinalCoverage, 17).mean().unwrap() - 80.0).abs() < 1e-9);
    }

    #[test]
    fn quantiles_lie_between_the_two_nearest_values() {
        // As numpy.quantile.
        let of = |share| quantile(vec![4.0, 1.0, 3.0, 8.0], share);
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(of), [1.0, 2.5, 3.5, 5.0, 8.0].map(Some));
        assert_eq!((quantile(vec![3.0, 1.0, 2.0], 0.5), quantile(vec![7.0], 0.25)), (Some(2.0), Some(7.0)));
        assert_eq!(quantile(Vec::new(), 0.5), None);
    }

    #[test]
    fn variation_of_the_averaged_list() {
        let list = [
            record("a", "p", 0, &[0.3; 4], &[Some(0.2), Some(0.4), Some(0.6)]),
            record("a", "p", 1, &[0.3; 4], &[Some(0.6), Some(0.4), Some(0.2)]),
        ];
        let runs = Runs::of(&list, "p");
        assert!(runs.cv_of_mean_list().unwrap().abs() < 1e-9, "the two lists average to a constant");
        assert!(runs.column(Figure::Cv3, 17).mean().unwrap() > 40.0);
    }
}
