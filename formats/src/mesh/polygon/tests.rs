use super::*;

/// Sum of the triangles' areas, and whether all are turned like the polygon.
fn cut(outline: &[[f64; 2]]) -> (f64, bool, Work) {
    let tilt = |p: &[f64; 2]| ([p[0], p[1], 0.3 * p[0] - 0.2 * p[1]], None);
    let corners: Vec<CornerData> = outline.iter().map(tilt).collect();
    let mut work = Work::default();
    let triangles = triangulate(&corners, &mut work).expect("little work");
    assert_eq!(triangles.len(), outline.len() - 2);
    let at = |i: usize| Vector2::from(outline[i]);
    let areas: Vec<f64> = triangles.iter().map(|&[a, b, c]| 0.5 * turn(&at(a), &at(b), &at(c))).collect();
    (areas.iter().map(|a| a.abs()).sum(), areas.iter().all(|&a| a >= 0.0), work)
}

fn area(outline: &[[f64; 2]]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    0.5 * outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
}

#[test]
fn concave_outlines_are_covered_once() {
    let l = [[2.0, 2.0], [1.9, 2.0], [1.9, 0.1], [0.0, 0.1], [0.0, 0.0], [2.0, 0.0]];
    let arrow = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]];
    let comb: Vec<[f64; 2]> = (0..40)
        .map(|i| [f64::from(i) * 0.1, if i % 2 == 0 { 1.0 } else { 0.1 }])
        .chain([[4.0, 0.0], [0.0, 0.0]])
        .rev()
        .collect();
    // A square with a square hole, joined by a bridge walked both ways.
    let keyhole = [
        [0.0, 0.0],
        [3.0, 0.0],
        [3.0, 3.0],
        [0.0, 3.0],
        [0.0, 0.0],
        [1.0, 1.0],
        [1.0, 2.0],
        [2.0, 2.0],
        [2.0, 1.0],
        [1.0, 1.0],
    ];
    for outline in [&l[..], &arrow, &comb, &keyhole] {
        for first in 0..outline.len() {
            let turned: Vec<[f64; 2]> = outline[first..].iter().chain(&outline[..first]).copied().collect();
            let (covered, one_way, work) = cut(&turned);
            let expected = area(&turned).abs();
            assert!((covered - expected).abs() < 1e-9, "{turned:?}: {covered} for {expected}");
            assert!(one_way && work.crossing == 0, "{turned:?}");
        }
    }
    assert!((area(&l) - 0.39).abs() < 1e-9);
}

#[test]
fn convex_ones_stay_fans() {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| ([x, y, 0.0], None));
    let triangles = triangulate(&square, &mut Work::default());
    assert_eq!(triangles, Some(vec![[0, 1, 2], [0, 2, 3]]));
}

#[test]
fn crossing_outlines_end_and_are_counted() {
    let eight = [[0.0, 0.0], [3.0, 3.0], [3.0, 0.0], [0.0, 2.0]];
    assert_eq!(cut(&eight).2.crossing, 1);
    // A spiral walked out and back in asks for many tests; the work is bounded.
    let wild: Vec<CornerData> =
        (0..30_000).map(f64::from).map(|i| ([(i * 1.7).sin(), (i * 2.9).cos(), 0.0], None)).collect();
    assert_eq!(triangulate(&wild, &mut Work::default()), None, "too much work");
}
