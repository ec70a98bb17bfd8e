use super::*;
use crate::metrics::tests::record;

fn bounds(interval: Interval) -> (f64, f64) {
    interval.low.zip(interval.high).unwrap_or_else(|| panic!("{interval:?}"))
}

#[test]
fn draws_are_those_of_one_stream_and_are_made_one_at_a_time() {
    let sizes = [3, 1, 4];
    let first = |over| -> Vec<Draw> { draws(&sizes, over, usize::MAX, 7).iter().take(5).collect() };
    let mut rng = stream(7, "bootstrap");
    let mut expected: Vec<Draw> = Vec::new();
    for _ in 0..5 {
        let mut draw = Draw::new();
        for (object, n) in sizes.into_iter().enumerate() {
            let mut episodes = Vec::new();
            (0..n).for_each(|_| episodes.push(rng.random_range(0..n)));
            draw.push((object, episodes));
        }
        expected.push(draw);
    }
    assert_eq!(first(ResampleUnit::Episodes), expected);
    let mut rng = stream(7, "bootstrap");
    for draw in first(ResampleUnit::Objects) {
        let objects: Vec<usize> = (0..3).map(|_| rng.random_range(0..3)).collect();
        assert_eq!(draw.iter().map(|(object, _)| *object).collect::<Vec<_>>(), objects);
        assert!(draw.iter().all(|(object, episodes)| episodes.iter().copied().eq(0..sizes[*object])), "{draw:?}");
    }
    let some = draws(&sizes, ResampleUnit::Episodes, 4, 7);
    assert_eq!(some.iter().collect::<Vec<_>>(), expected[..4]);
    assert_eq!(some.iter().collect::<Vec<_>>(), expected[..4], "the same ones every time");
}

#[test]
fn what_cannot_be_drawn_otherwise_has_a_value_and_no_interval() {
    use ResampleUnit::{Episodes, Objects};
    let of = |objects: &[&str], episodes: usize, over: ResampleUnit| {
        let overlap = |e: usize| [(e == 0).then_some(0.4)];
        let list: Vec<_> = objects
            .iter()
            .flat_map(|o| (0..episodes).map(move |e| record(o, "p", e, &[0.5 + 0.01 * e as f64], &overlap(e))))
            .collect();
        let runs = Runs::of(&list, "p");
        let columns = [Figure::FinalCoverage, Figure::Overlap(1)].map(|f| runs.column(f, 17));
        let draws = draws(&columns[0].sizes(), over, 200, 0);
        let [coverage, overlap] = columns.map(|c| mean_interval(&c, &draws).expect("a value"));
        let efficiency = efficiency_interval(&runs, 17, &draws).expect("a value");
        let ratio = efficiency_ratio(&runs, &runs, 17, over, 200, 0).expect("a value");
        assert_eq!([efficiency.low, ratio.low].map(|x| x.is_some()), [coverage.low.is_some(); 2], "{coverage:?}");
        [coverage, overlap].map(|i| (i.low.is_some(), i.high.is_some()))
    };
    let (none, there) = ((false, false), (true, true));
    assert_eq!(of(&["a"], 1, Episodes), [none, none]);
    assert_eq!(of(&["a", "b"], 1, Episodes), [none, none]);
    assert_eq!(of(&["a", "b"], 1, Objects), [there, there]);
    assert_eq!(of(&["a"], 8, Objects), [none, none]);
    // Only one of the eight episodes has an overlap.
    assert_eq!(of(&["a"], 8, Episodes), [there, none]);
}

#[test]
fn the_interval_of_a_mean_is_that_of_theory() {
    let mut rng = stream(3, "normal");
    let list: Vec<_> = (0..100)
        .map(|e| {
            let sum: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            record("a", "p", e, &[0.5 + 0.05 * sum], &[])
        })
        .collect();
    let column = Runs::of(&list, "p").column(Figure::FinalCoverage, 17);
    let found = mean_interval(&column, &draws(&column.sizes(), ResampleUnit::Episodes, 4000, 1)).unwrap();
    let half = 1.96 * column.standard_error().unwrap();
    let (low, high) = bounds(found);
    assert!((found.value - low - half).abs() < 0.15 * half, "{found:?} against +-{half}");
    assert!((high - found.value - half).abs() < 0.15 * half);
}

#[test]
fn pairing_removes_what_both_share() {
    // Each episode's difficulty moves both policies alike; the second is always half a point better.
    let mut rng = stream(4, "pairs");
    let list: Vec<_> = (0..40)
        .flat_map(|e| {
            let c = rng.random_range(0.5..0.9);
            [record("a", "p", e, &[c], &[]), record("a", "q", e, &[c + 0.005], &[])]
        })
        .collect();
    let (p, q) = (Runs::of(&list, "p"), Runs::of(&list, "q"));
    let d = difference(&q, &p, Figure::FinalCoverage, 17, ResampleUnit::Episodes, 500, 0).unwrap();
    let (low, high) = bounds(d);
    assert!((low - 0.5).abs() < 1e-9 && (high - 0.5).abs() < 1e-9, "{d:?}");
}

#[test]
fn an_episode_where_one_of_two_has_no_value_counts_for_neither() {
    let list = [
        record("a", "p", 0, &[0.5], &[Some(0.4)]),
        record("a", "p", 1, &[0.5], &[Some(0.6)]),
        record("a", "p", 2, &[0.5], &[None]),
        record("a", "q", 0, &[0.5], &[Some(0.5)]),
        record("a", "q", 1, &[0.5], &[None]),
        record("a", "q", 2, &[0.5], &[Some(0.9)]),
    ];
    let (p, q) = (Runs::of(&list, "p"), Runs::of(&list, "q"));
    let d = difference(&q, &p, Figure::Overlap(1), 17, ResampleUnit::Episodes, 200, 0).expect("a pair");
    assert!((d.value - 10.0).abs() < 1e-9 && (d.low, d.high) == (None, None), "a single pair: {d:?}");
}

#[test]
fn a_closure_is_the_share_of_the_gap() {
    let policy = |name: &str, views: usize| -> Vec<_> {
        let mut coverages = vec![0.5; views];
        coverages.extend(vec![0.9; 8 - views]);
        (0..6).map(|e| record("a", name, e, &coverages, &[])).collect()
    };
    let list = [policy("best", 6), policy("leader", 3), policy("level", 4)].concat();
    let runs = |name| Runs::of(&list, name);
    let [best, leader, level] = [runs("best"), runs("leader"), runs("level")];
    let mean = |r: &Runs, figure| r.column(figure, 17).mean();
    let e = |r: &Runs| efficiency(mean(r, Figure::FinalCoverage), mean(r, Figure::ViewsTo(90))).unwrap();
    let found = gap_closure(&level, &best, &leader, 17, 100, 0).unwrap();
    let expected = (e(&level) - e(&best)) / (e(&leader) - e(&best));
    assert!((0.1..0.9).contains(&expected) && (found.value - expected).abs() < 1e-12, "{found:?}, {expected}");
    let lead = efficiency_lead(&leader, &best, 17, 100, 0).unwrap();
    assert!((lead.value - (e(&leader) - e(&best))).abs() < 1e-12 && bounds(lead).0 > 0.0, "{lead:?}");
}

#[test]
fn objects_drawn_again_widen_the_interval() {
    let list: Vec<_> = (0..5)
        .flat_map(|o| (0..20).map(move |e| record(&format!("o{o}"), "p", e, &[0.5 + 0.1 * o as f64], &[])))
        .collect();
    let column = Runs::of(&list, "p").column(Figure::FinalCoverage, 17);
    let over = |over| mean_interval(&column, &draws(&column.sizes(), over, 1000, 0)).unwrap();
    let [(low, high), (least, most)] = [ResampleUnit::Episodes, ResampleUnit::Objects].map(|unit| bounds(over(unit)));
    assert_eq!(low, high, "episodes of an object do not differ here");
    assert!(most - least > 10.0);
}
