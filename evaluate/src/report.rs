//! What a run leaves behind: rows per view as CSV and JSON lines, tables as Markdown, everything as one HTML page.

pub mod closure;
pub mod compare;
pub mod paper;
pub mod plots;
pub mod replay;
pub mod table;
pub mod tables;

use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::objects::Object;
use crate::record::EpisodeRecord;
use formats::FormatError;
use formats::run::{atomic_write, atomic_write_with};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;
use table::Table;

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
/// settings, whatever the number of threads.
///
/// # Errors
/// What the operating system refuses.
pub fn write(
    directory: &Path,
    contents: &Contents,
    config: &EvaluateConfig,
    policies: &[String],
    objects: &[Object],
) -> Result<(), FormatError> {
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
        writeln!(
            w,
            "object,policy,episode,view,coverage,overlap,points,target_x,target_y,target_z,camera_x,camera_y,camera_z"
        )?;
        for r in records.iter().flat_map(|r| view_rows(r)) {
            let overlap = r.overlap.map_or(String::new(), |o| o.to_string());
            let (t, c) = (r.target, r.camera);
            writeln!(
                w,
                "{},{},{},{},{},{overlap},{},{},{},{},{},{},{}",
                r.object, r.policy, r.episode, r.view, r.coverage, r.points, t[0], t[1], t[2], c[0], c[1], c[2]
            )?;
        }
        Ok(())
    })?;
    atomic_write_with(&directory.join("timing.csv"), |w| {
        writeln!(w, "object,policy,episode,cpu_seconds,decision,decision_seconds")?;
        for (r, t) in &contents.episodes {
            for (i, d) in t.decisions_s.iter().enumerate() {
                writeln!(w, "{},{},{},{},{},{d}", r.key.object, r.key.policy, r.key.episode, t.episode_s, i + 1)?;
            }
        }
        Ok(())
    })?;
    let order = policy_order(contents, policies);
    let results = tables::results(contents, config, &order);
    atomic_write(&directory.join("summary.csv"), tables::per_object(contents, config, &order).to_csv().as_bytes())?;
    atomic_write(&directory.join("timing.md"), tables::timing(contents, &order).to_markdown().as_bytes())?;
    let mut markdown = format!("# Results\n\n{}\n\n", headline(contents, config, &order));
    results.iter().for_each(|table| markdown.push_str(&table.to_markdown()));
    atomic_write(&directory.join("report.md"), markdown.as_bytes())?;
    atomic_write(&directory.join("report.html"), html(contents, config, &order, &results, objects).as_bytes())
}

/// A row of `views.csv` and `views.jsonl`.
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

fn headline(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> String {
    let objects: BTreeSet<&str> = contents.episodes.iter().map(|(r, _)| r.key.object.as_str()).collect();
    format!(
        "{} episodes of {} policies on {} objects ({}), seed {}, {} next views after the first, working distance {} m, \
         {} episodes without a usable first view. Never reached counts {} views. Intervals are 95 %, bootstrapped.",
        contents.episodes.len(),
        policies.len(),
        objects.len(),
        objects.into_iter().collect::<Vec<_>>().join(", "),
        config.seed,
        config.episode.num_views,
        config.episode.working_distance_m,
        contents.skipped.len(),
        config.never,
    )
}

fn html(
    contents: &Contents,
    config: &EvaluateConfig,
    policies: &[String],
    tables: &[Table],
    objects: &[Object],
) -> String {
    let mut page = String::from(include_str!("report/head.html"));
    let _ = write!(page, "<h1>Results</h1><p>{}</p>", table::escape(&headline(contents, config, policies)));
    let _ = write!(page, "<h2>Coverage over views</h2>{}", plots::coverage_curves(contents, config, policies));
    let _ = write!(page, "<h2>Overlap of next views 1 to 3</h2>{}", plots::overlap_boxes(contents, policies));
    if let Some((object, record)) = replay::choose(contents, policies, objects) {
        page.push_str(&replay::html(object, record, config));
    }
    for table in tables {
        page.push_str(&table.to_html());
    }
    page.push_str("</body></html>\n");
    page
}
