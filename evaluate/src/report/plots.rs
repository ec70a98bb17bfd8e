//! Curves and boxes as SVG.

use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs};
use crate::report::registration::FailureRow;
use plotters::prelude::*;

fn color(i: usize) -> RGBColor {
    const COLORS: [(u8, u8, u8); 10] = [
        (31, 119, 180),
        (214, 39, 40),
        (44, 160, 44),
        (148, 103, 189),
        (255, 127, 14),
        (23, 190, 207),
        (140, 86, 75),
        (227, 119, 194),
        (127, 127, 127),
        (188, 189, 34),
    ];
    let (r, g, b) = COLORS[i % COLORS.len()];
    RGBColor(r, g, b)
}

/// Why there is no plot.
type PlotError = DrawingAreaErrorKind<std::io::Error>;

/// An SVG drawn by `draw`; a sentence instead where the drawing fails.
fn svg(
    width: u32,
    height: u32,
    draw: impl FnOnce(&DrawingArea<SVGBackend, plotters::coord::Shift>) -> Result<(), PlotError>,
) -> String {
    let mut text = String::new();
    let outcome = {
        let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        area.fill(&WHITE).and_then(|()| draw(&area)).and_then(|()| area.present())
    };
    match outcome {
        Ok(()) => text,
        Err(error) => format!("<p>No plot: {}</p>", formats::html::escape(&error.to_string())),
    }
}

/// Mean coverage after each view, one curve per policy, with objects weighing alike as in the tables.
pub fn coverage_curves(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> String {
    let curves = policies.iter().map(|policy| coverage_curve(contents, config, policy));
    svg(1100, 520, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(52)
            .build_cartesian_2d(1.0..config.episode.num_views as f64 + 1.0, 0.0..100.0)?;
        chart
            .configure_mesh()
            .x_desc("views, the first scan included")
            .y_desc("coverage, %")
            .x_label_formatter(&|x| format!("{x:.0}"))
            .draw()?;
        for (i, (policy, curve)) in policies.iter().zip(curves).enumerate() {
            let style = color(i).stroke_width(if i < 10 { 2 } else { 1 });
            chart
                .draw_series(LineSeries::new(curve, style))?
                .label(policy.as_str())
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerRight)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .draw()
    })
}

/// Views, the first scan included, each with a policy's mean coverage after it, percent.
fn coverage_curve(contents: &Contents, config: &EvaluateConfig, policy: &str) -> Vec<(f64, f64)> {
    let runs = Runs::of(contents.episodes.iter().map(|(r, _)| r), policy);
    let mean = |next_views| runs.column(Figure::CoverageAfter(next_views), config.views_if_unreached()).mean();
    (0..=config.episode.num_views).filter_map(|i| Some((i as f64 + 1.0, mean(i)?))).collect()
}

/// Failures against what there was to register by, with 95 % intervals: overlaps on the left, lambda on the right.
pub fn failure_curves(failures: &[FailureRow]) -> String {
    let panels: [(&str, [(&str, &str); 2]); 2] = [
        ("overlap, %", [("overlap", "overlap"), ("like_overlap", "overlap with like normals")]),
        ("lambda", [("lambda", "lambda"), ("expected_lambda", "lambda expected before the scan")]),
    ];
    svg(1100, 460, |area| {
        let halves = area.split_evenly((1, 2));
        for (half, (title, curves)) in halves.iter().zip(&panels) {
            let bins: Vec<&FailureRow> = failures.iter().filter(|row| row.by == curves[0].0).collect();
            let name = |row: &FailureRow| match row.to {
                Some(to) => format!("{} to {to}", row.from),
                None => format!("from {}", row.from),
            };
            let mut chart = ChartBuilder::on(half)
                .margin(12)
                .x_label_area_size(42)
                .y_label_area_size(52)
                .build_cartesian_2d(-0.5..bins.len() as f64 - 0.5, 0.0..100.0)?;
            chart
                .configure_mesh()
                .disable_x_mesh()
                .x_labels(bins.len() + 2)
                .x_label_formatter(&|x| {
                    let bin = bins.get(x.round() as usize).filter(|_| (x - x.round()).abs() < 0.05 && *x > -0.4);
                    bin.map(|row| name(row)).unwrap_or_default()
                })
                .x_desc(*title)
                .y_desc("failed, %")
                .draw()?;
            for (i, (by, label)) in curves.iter().enumerate() {
                let rows = failures.iter().filter(|row| row.by == *by).enumerate();
                let points: Vec<(f64, f64, [f64; 2])> = rows
                    .filter_map(|(k, row)| {
                        let x = k as f64 + 0.12 * (2.0 * i as f64 - 1.0);
                        Some((x, row.failed_percent?, row.interval()?))
                    })
                    .collect();
                let style = color(i).stroke_width(2);
                chart
                    .draw_series(LineSeries::new(points.iter().map(|p| (p.0, p.1)), style))?
                    .label(*label)
                    .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
                chart.draw_series(points.iter().map(|p| Circle::new((p.0, p.1), 4, color(i).filled())))?;
                chart.draw_series(
                    points.iter().map(|(x, _, [low, high])| PathElement::new(vec![(*x, *low), (*x, *high)], color(i))),
                )?;
            }
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(BLACK.mix(0.3))
                .draw()?;
        }
        Ok(())
    })
}

/// Boxes of the overlaps of next views 1, 2 and 3, policy by policy: quartiles, whiskers at 1.5 times their distance.
pub fn overlap_boxes(contents: &Contents, policies: &[String]) -> String {
    let width = (120 + 150 * policies.len()) as u32;
    svg(width, 420, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(52)
            .build_cartesian_2d(-0.6..policies.len() as f64 - 0.4, 0f32..100f32)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(policies.len() + 2)
            .x_label_formatter(&|x| {
                let nearest = x.round();
                if (x - nearest).abs() > 0.05 || nearest < 0.0 {
                    String::new()
                } else {
                    policies.get(nearest as usize).cloned().unwrap_or_default()
                }
            })
            .y_desc("overlap, %")
            .draw()?;
        for (i, policy) in policies.iter().enumerate() {
            let runs = Runs::of(contents.episodes.iter().map(|(r, _)| r), policy);
            for n in 1..=3u8 {
                let values: Vec<f64> = runs.column(Figure::Overlap(n), 0).0.into_iter().flatten().flatten().collect();
                if values.is_empty() {
                    continue;
                }
                let x = i as f64 + 0.24 * (f64::from(n) - 2.0);
                let plot =
                    Boxplot::new_vertical(x, &Quartiles::new(&values)).width(14).style(color(usize::from(n) - 1));
                chart.draw_series([plot])?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::tests::record;
    use crate::record::Timing;

    #[test]
    fn curves_are_means_over_objects_as_the_tables_are() {
        let of = |(object, episode, last): (&str, usize, f64)| {
            (record(object, "p", episode, &[0.5, last], &[]), Timing { episode_s: 0.0, decisions_s: vec![] })
        };
        // Episodes are fewer on one of two objects where some could not be run.
        let episodes = [("a", 0, 1.0), ("a", 1, 1.0), ("a", 2, 1.0), ("b", 0, 0.5)].map(of).to_vec();
        let contents = Contents { episodes, skipped: vec![] };
        let mut config = EvaluateConfig::default();
        config.episode.num_views = 2;
        assert_eq!(coverage_curve(&contents, &config, "p"), [(1.0, 50.0), (2.0, 75.0), (3.0, 75.0)]);
        assert!(coverage_curve(&contents, &config, "q").is_empty());
    }

    #[test]
    fn low_curves_are_drawn_where_they_are() {
        let of = |coverage: f64| {
            let timing = Timing { episode_s: 0.0, decisions_s: vec![] };
            let episodes = vec![(record("a", "p", 0, &[coverage, coverage], &[]), timing)];
            let contents = Contents { episodes, skipped: vec![] };
            coverage_curves(&contents, &EvaluateConfig::default(), &["p".to_owned()])
        };
        assert!(of(0.05).contains("<svg"));
        assert_ne!(of(0.05), of(0.1));
    }
}
