//! What a run leaves behind: rows per view as CSV and JSON lines, tables as Markdown, everything as one HTML page.

pub mod arm;
pub mod closure;
pub mod compare;
pub mod folder;
pub mod missing;
pub mod paper;
pub mod plots;
pub mod recorded;
pub mod registration;
pub mod replay;
pub mod rows;
pub mod table;
pub mod tables;

use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::objects::Object;
use crate::record::{EpisodeRecord, Timing};
use datagen::dataset::DatasetName;
use formats::FormatError;
use formats::run::{atomic_write, atomic_write_with};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use table::{Table, write_csv};
use tables::Rows;

pub use missing::{Missing, Unfinished};

/// Policies of the records: in the order asked for, then any other by name.
pub fn policy_order(contents: &Contents, asked: &[String]) -> Vec<String> {
    let present: BTreeSet<&str> = contents.episodes.iter().map(|(r, _)| r.key.policy.as_str()).collect();
    let mut order: Vec<String> = asked.iter().filter(|p| present.contains(p.as_str())).cloned().collect();
    let rest: Vec<String> =
        present.iter().filter(|p| !order.iter().any(|o| o == *p)).map(|p| (*p).to_owned()).collect();
    order.extend(rest);
    order
}

/// Writes every file of a run's directory. All but `timing.csv` and `timing.md` are the same bytes for the same
/// settings, whatever the number of threads. The report says what is missing. Answers with the rows of the tables.
///
/// # Errors
/// What the operating system refuses.
pub fn write(
    directory: &Path,
    contents: &Contents,
    config: &EvaluateConfig,
    policies: &[String],
    objects: &[Object],
    missing: &Missing,
) -> Result<Rows, FormatError> {
    let records: Vec<&EpisodeRecord> = contents.episodes.iter().map(|(r, _)| r).collect();
    atomic_write_with(&directory.join("episodes.jsonl"), |w| {
        for record in &records {
            serde_json::to_writer(&mut *w, record)?;
            w.write_all(b"\n")?;
        }
        Ok(())
    })?;
    atomic_write_with(&directory.join("views.jsonl"), |w| {
        for row in records.iter().flat_map(|r| view_rows(r)) {
            serde_json::to_writer(&mut *w, &row)?;
            w.write_all(b"\n")?;
        }
        Ok(())
    })?;
    atomic_write_with(&directory.join("views.csv"), |w| {
        write_csv(w, records.iter().flat_map(|r| view_rows(r)).map(ViewCells::from))
    })?;
    atomic_write_with(&directory.join("timing.csv"), |w| {
        let decisions = |(r, t): &'_ (EpisodeRecord, Timing)| {
            let (key, episode_cpu_s) = (r.key.clone(), t.episode_s);
            let of = move |(i, s): (usize, f64)| DecisionRow {
                object: key.object.clone(),
                policy: key.policy.clone(),
                episode: key.episode,
                episode_cpu_s,
                decision: i + 1,
                decision_s: s,
            };
            t.decisions_s.clone().into_iter().enumerate().map(of)
        };
        write_csv(w, contents.episodes.iter().flat_map(decisions))
    })?;
    let order = policy_order(contents, policies);
    let rows = Rows::of(contents, config, &order, missing);
    let results = rows.tables(contents, config, &order);
    atomic_write_with(&directory.join("policies.csv"), |w| write_csv(w, &rows.policies))?;
    atomic_write_with(&directory.join("paired.csv"), |w| write_csv(w, &rows.paired))?;
    atomic_write_with(&directory.join("summary.csv"), |w| write_csv(w, &rows.objects))?;
    if !rows.recorded.is_empty() {
        atomic_write_with(&directory.join("recorded.csv"), |w| write_csv(w, &rows.recorded))?;
        atomic_write_with(&directory.join("forecasts.csv"), |w| write_csv(w, &rows.forecasts))?;
        atomic_write_with(&directory.join("stop.csv"), |w| write_csv(w, &rows.stops))?;
    }
    if !rows.registration.is_empty() {
        atomic_write_with(&directory.join("registration.csv"), |w| write_csv(w, &rows.registration))?;
        atomic_write_with(&directory.join("failures.csv"), |w| write_csv(w, &rows.failures))?;
    }
    if !rows.arm.is_empty() {
        atomic_write_with(&directory.join("arm.csv"), |w| write_csv(w, &rows.arm))?;
    }
    atomic_write(&directory.join("timing.md"), tables::timing(contents, &order).to_markdown().as_bytes())?;
    let figures = figures(contents, config, &order, &rows);
    for (file, _, svg) in &figures {
        atomic_write(&directory.join(file), svg.as_bytes())?;
    }
    let headline = headline(contents, config, &order, missing);
    let mut markdown = format!("# Results\n\n{headline}\n\n");
    results.iter().for_each(|table| markdown.push_str(&table.to_markdown()));
    atomic_write(&directory.join("report.md"), markdown.as_bytes())?;
    atomic_write(
        &directory.join("report.html"),
        html(contents, config, &order, &headline, &figures, &results, objects).as_bytes(),
    )?;
    Ok(rows)
}

/// A row of `timing.csv`.
#[derive(serde::Serialize)]
struct DecisionRow {
    object: String,
    policy: String,
    episode: usize,
    #[serde(serialize_with = "plain")]
    episode_cpu_s: f64,
    /// From 1.
    decision: usize,
    #[serde(serialize_with = "plain")]
    decision_s: f64,
}

/// A row of `views.csv`: [`ViewRow`] with one column per number.
#[derive(serde::Serialize)]
struct ViewCells<'a> {
    object: &'a str,
    policy: &'a str,
    episode: usize,
    view: usize,
    #[serde(serialize_with = "plain")]
    coverage: f64,
    overlap: Option<String>,
    points: usize,
    #[serde(serialize_with = "plain")]
    target_x_m: f64,
    #[serde(serialize_with = "plain")]
    target_y_m: f64,
    #[serde(serialize_with = "plain")]
    target_z_m: f64,
    #[serde(serialize_with = "plain")]
    camera_x_m: f64,
    #[serde(serialize_with = "plain")]
    camera_y_m: f64,
    #[serde(serialize_with = "plain")]
    camera_z_m: f64,
}

impl<'a> From<ViewRow<'a>> for ViewCells<'a> {
    fn from(r: ViewRow<'a>) -> Self {
        let ([target_x_m, target_y_m, target_z_m], [camera_x_m, camera_y_m, camera_z_m]) = (r.target, r.camera);
        Self {
            object: r.object,
            policy: r.policy,
            episode: r.episode,
            view: r.view,
            coverage: r.coverage,
            overlap: r.overlap.map(|o| o.to_string()),
            points: r.points,
            target_x_m,
            target_y_m,
            target_z_m,
            camera_x_m,
            camera_y_m,
            camera_z_m,
        }
    }
}

/// A number without exponent: what every spreadsheet reads.
#[allow(clippy::trivially_copy_pass_by_ref)] // serde's signature
fn plain<S: serde::Serializer>(x: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(x)
}

/// A row of `views.jsonl`.
#[derive(serde::Serialize)]
struct ViewRow<'a> {
    object: &'a str,
    policy: &'a str,
    episode: usize,
    /// 1 is the first scan.
    view: usize,
    coverage: f64,
    overlap: Option<f64>,
    points: usize,
    target: [f64; 3],
    camera: [f64; 3],
}

fn view_rows(r: &EpisodeRecord) -> impl Iterator<Item = ViewRow<'_>> {
    r.views.iter().enumerate().map(|(i, view)| ViewRow {
        object: &r.key.object,
        policy: &r.key.policy,
        episode: r.key.episode,
        view: i + 1,
        coverage: r.coverages[i],
        overlap: i.checked_sub(1).and_then(|n| r.overlaps[n]),
        points: r.scan_points[i],
        target: view.target.into(),
        camera: view.position.into(),
    })
}

fn headline(contents: &Contents, config: &EvaluateConfig, policies: &[String], missing: &Missing) -> String {
    let objects: BTreeSet<&str> = contents.episodes.iter().map(|(r, _)| r.key.object.as_str()).collect();
    let (kind, distance) = match config.dataset.name {
        DatasetName::Sequences => ("recorded sequences", "each one's own".to_owned()),
        _ => ("objects", format!("{} m", config.episode.working_distance_m)),
    };
    // Beside those that are left, "not run" would be taken for these.
    let (preliminary, not_run) = match missing.unfinished {
        Some(unfinished) => (format!("Preliminary report, {unfinished}. "), "could not be run"),
        None => (String::new(), "not run"),
    };
    let unusable = missing.unusable_objects().map_or_else(String::new, |text| format!(" {text}."));
    format!(
        "{preliminary}{} episodes of {} policies on {} {kind} ({}), seed {}, {} next views after the first, working \
         distance {distance}, {} episodes {not_run}.{unusable} Never reached counts {} views. Intervals are 95 %, bootstrapped.",
        contents.episodes.len(),
        policies.len(),
        objects.len(),
        objects.into_iter().collect::<Vec<_>>().join(", "),
        config.seed,
        config.episode.num_views,
        contents.skipped.len(),
        config.views_if_unreached(),
    )
}

/// The figures: name of the file, heading, SVG.
fn figures(
    contents: &Contents,
    config: &EvaluateConfig,
    policies: &[String],
    rows: &Rows,
) -> Vec<(&'static str, &'static str, String)> {
    let mut list = vec![
        ("coverage.svg", "Coverage over views", plots::coverage_curves(contents, config, policies)),
        ("overlaps.svg", "Overlap of next views 1 to 3", plots::overlap_boxes(contents, policies)),
    ];
    if !rows.failures.is_empty() {
        let curves = plots::failure_curves(&rows.failures);
        list.push(("failures.svg", "Failures of scans onto a sound cloud, with 95 % intervals", curves));
    }
    list
}

fn html(
    contents: &Contents,
    config: &EvaluateConfig,
    policies: &[String],
    headline: &str,
    figures: &[(&str, &str, String)],
    tables: &[Table],
    objects: &[Object],
) -> String {
    let mut page = String::from(include_str!("report/head.html"));
    let _ = write!(page, "<h1>Results</h1><p>{}</p>", formats::html::escape(headline));
    for (_, heading, svg) in figures {
        let _ = write!(page, "<h2>{heading}</h2>{svg}");
    }
    if let Some((object, record)) = replay::choose(contents, policies, objects) {
        page.push_str(&replay::html(object, record, config));
    }
    for table in tables {
        page.push_str(&table.to_html());
    }
    page.push_str("</body></html>\n");
    page
}
