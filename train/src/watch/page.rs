//! `index.html`: the curves of a run in one file that needs nothing else, rewritten during training.

use super::record::Record;
use formats::html::escape;
use plotters::prelude::*;
use std::fmt::Write;

/// A named curve.
type Series<'a> = (&'a str, Vec<(f64, f64)>);

/// The page for these records. While the run is active (`total_steps` are to be done) it reloads itself every 20 seconds and
/// shows the time left.
pub fn render(title: &str, records: &[Record], total_steps: Option<u64>) -> String {
    let epochs = || records.iter().filter_map(|r| if let Record::Epoch(e) = r { Some(e) } else { None });
    let steps = || records.iter().filter_map(|r| if let Record::Step(s) = r { Some(s) } else { None });
    let episodes = || records.iter().filter_map(|r| if let Record::Episodes(e) = r { Some(e) } else { None });
    let charts = [
        chart(
            "Loss per epoch (logarithmic)",
            &[
                ("training", epochs().map(|e| (e.step as f64, e.train_loss)).collect()),
                ("validation", epochs().map(|e| (e.step as f64, e.valid_loss)).collect()),
            ],
            true,
        ),
        chart(
            "Validation regret, as a share of a random choice's",
            &[("relative regret", epochs().map(|e| (e.step as f64, e.valid.relative_regret())).collect())],
            false,
        ),
        chart(
            "Validation: rank correlation and hit rate",
            &[
                ("rank correlation", epochs().map(|e| (e.step as f64, e.valid.rank_correlation)).collect()),
                ("hit rate", epochs().map(|e| (e.step as f64, e.valid.hit_rate)).collect()),
            ],
            false,
        ),
        chart(
            "Closed-loop episodes: final coverage",
            &[("coverage", episodes().map(|e| (e.step as f64, e.coverage)).collect())],
            false,
        ),
        chart(
            "Closed-loop episodes: views to 90 %",
            &[("views", episodes().map(|e| (e.step as f64, e.views_to_90)).collect())],
            false,
        ),
        chart("Loss per step (logarithmic)", &with_smoothed("loss", steps().map(|s| (s.step as f64, s.loss))), true),
        chart(
            "Learning rate",
            &[("learning rate", steps().map(|s| (s.step as f64, s.learning_rate)).collect())],
            false,
        ),
        chart(
            "Gradient norm (logarithmic)",
            &with_smoothed("norm", steps().map(|s| (s.step as f64, s.gradient_norm))),
            true,
        ),
    ];
    let mut page = String::from("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n");
    if total_steps.is_some() {
        page.push_str("<meta http-equiv=\"refresh\" content=\"20\">\n");
    }
    let title = escape(title);
    let _ = write!(
        page,
        "<title>{title}</title>\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<style>{}</style>\n\
         </head><body>\n<h1>{title}</h1>\n",
        include_str!("page.css")
    );
    if let Some(total) = total_steps {
        let done = records.iter().map(Record::step).max().unwrap_or(0);
        let recent: Vec<f64> = steps().rev().take(100).map(|s| s.seconds).collect();
        let mean = recent.iter().sum::<f64>() / recent.len().max(1) as f64;
        let left = if recent.is_empty() {
            "not known yet".to_owned()
        } else {
            duration(mean * total.saturating_sub(done) as f64)
        };
        let _ = writeln!(
            page,
            "<p>Step {done} of {total}, about {left} left</p><progress max=\"{total}\" value=\"{done}\"></progress>"
        );
    }
    if let Some(last) = epochs().next_back() {
        let best = epochs().rfind(|e| e.best).unwrap_or(last);
        let _ = writeln!(
            page,
            "<div class=\"scroll\"><table><tr><th></th><th>epoch</th><th>step</th><th>training loss</th><th>validation loss</th>\
             <th>relative regret</th><th>rank correlation</th><th>hit rate</th><th>samples/s</th></tr>"
        );
        for (name, e) in [("last", last), ("best", best)] {
            let _ = writeln!(
                page,
                "<tr><th>{name}</th><td>{}</td><td>{}</td><td>{:.5}</td><td>{:.5}</td><td>{:.3}</td><td>{:.3}</td>\
                 <td>{:.3}</td><td>{:.1}</td></tr>",
                e.epoch + 1,
                e.step,
                e.train_loss,
                e.valid_loss,
                e.valid.relative_regret(),
                e.valid.rank_correlation,
                e.valid.hit_rate,
                e.samples_per_second
            );
        }
        page.push_str("</table></div>\n");
    }
    page.push_str("<div class=\"charts\">\n");
    charts.iter().for_each(|c| page.push_str(c));
    page.push_str("</div>\n<ul>\n");
    for record in records {
        if let Record::Message { step, text } = record {
            let _ = writeln!(page, "<li>step {step}: {}</li>", escape(text));
        }
    }
    page.push_str("</ul>\n</body></html>\n");
    page
}

/// A curve and its mean over about a fiftieth of the run before each point.
fn with_smoothed<'a>(name: &'a str, points: impl Iterator<Item = (f64, f64)>) -> Vec<Series<'a>> {
    let raw: Vec<(f64, f64)> = points.filter(|p| p.1.is_finite()).collect();
    let keep = 1.0 - 1.0 / (raw.len() as f64 / 50.0).max(1.0);
    let mut mean = raw.first().map_or(0.0, |p| p.1);
    let smoothed = raw.iter().map(|&(x, y)| {
        mean = keep * mean + (1.0 - keep) * y;
        (x, mean)
    });
    let smoothed = smoothed.collect();
    vec![(name, raw), ("smoothed", smoothed)]
}

/// A time for people.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s >= 5400.0 => format!("{:.1} h", s / 3600.0),
        s if s >= 90.0 => format!("{:.0} min", s / 60.0),
        s => format!("{s:.0} s"),
    }
}

/// One chart as SVG; empty where no curve has a finite point.
fn chart(caption: &str, series: &[Series], log: bool) -> String {
    let value = |y: f64| if log { y.log10() } else { y };
    let series: Vec<Series> = series
        .iter()
        .map(|(name, s)| (*name, thin(s.iter().map(|&(x, y)| (x, value(y))).filter(|p| p.1.is_finite()).collect())))
        .collect();
    let points = || series.iter().flat_map(|s| &s.1);
    if points().next().is_none() {
        return String::new();
    }
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let (low, high) = points().map(pick).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let margin = if high > low { 0.05 * (high - low) } else { 0.5 * low.abs().max(1e-6) };
        low - margin..high + margin
    };
    let mut svg = String::new();
    let drawn = draw(&mut svg, caption, &series, log, range(|p| p.0), range(|p| p.1));
    match drawn {
        Ok(()) => svg,
        Err(reason) => format!("<p>{}: {}</p>\n", escape(caption), escape(&reason.to_string())),
    }
}

fn draw(
    svg: &mut String,
    caption: &str,
    series: &[Series],
    log: bool,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
    let area = SVGBackend::with_string(svg, (660, 320)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut context = ChartBuilder::on(&area)
        .caption(caption, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(30)
        .y_label_area_size(64)
        .build_cartesian_2d(x, y)?;
    context
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc("step")
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| short(if log { 10f64.powf(*y) } else { *y }))
        .draw()?;
    for (i, (name, curve)) in series.iter().enumerate() {
        // A curve that has a smoothed one beside it stands back.
        let faint = series.get(i + 1).is_some_and(|(next, _)| *next == "smoothed");
        let colour = Palette99::pick(i).mix(if faint { 0.3 } else { 1.0 });
        let line = LineSeries::new(curve.iter().copied(), colour.stroke_width(2));
        context
            .draw_series(line)?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    if series.len() > 1 {
        context.configure_series_labels().background_style(WHITE.mix(0.8)).draw()?;
    }
    area.present()
}

/// A label of an axis with two or three digits: 0.15, 0.063, 1.4, 2.5e-5.
fn short(value: f64) -> String {
    let digits = match value.abs() {
        v if v < 1e-9 => return "0".to_owned(),
        v if v < 1e-3 => return format!("{value:.1e}"),
        v if v < 0.1 => 4,
        v if v < 10.0 => 2,
        _ => 0,
    };
    let text = format!("{value:.digits$}");
    if digits == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').to_owned() }
}

/// At most 2,000 points, so that a long run's page stays small: means over equal stretches.
fn thin(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let stretch = points.len().div_ceil(2000).max(1);
    if stretch == 1 {
        return points;
    }
    let mean = |c: &[(f64, f64)]| {
        let n = c.len() as f64;
        (c.iter().map(|p| p.0).sum::<f64>() / n, c.iter().map(|p| p.1).sum::<f64>() / n)
    };
    points.chunks(stretch).map(mean).collect()
}

#[cfg(test)]
mod tests;
