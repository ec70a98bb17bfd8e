//! The answer as one self-contained page: what the next view is good for, the object with what is missing of it and the
//! candidates, to be turned, and what the view will see (nothing is loaded from elsewhere).

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use formats::html::{VIEWER, escape};
use geometry::{BoundaryConfig, NeighborGrid, boundary_points};
use nalgebra::{Point3, Vector3};
use planning::pose::Pose;
use planning::{Answer, Candidate, ScanState, Seen, Session};
use serde_json::json;

/// What the page shows beside the answer.
#[derive(Clone, Copy)]
pub struct ReportInput<'a> {
    /// Title: the object or the files.
    pub title: &'a str,
    /// What was planned on.
    pub session: &'a Session,
    /// Coverage after each view, in [0, 1], where there is ground truth (closed loop in the simulator).
    pub coverage: &'a [f64],
}

/// The page. Every text in it is escaped, whatever the title or the reasons contain.
pub fn report_html(answer: &Answer, input: &ReportInput) -> String {
    // JSON in a script element: only `<` could end it.
    let data = page_data(answer, input).to_string().replace('<', "\\u003c");
    let values = [
        ("title", &*escape(input.title)),
        ("style", include_str!("report/page.css")),
        ("side", &side(answer, input.coverage)),
        ("text", &escape(&answer.to_text())),
        ("data", &data),
        ("viewer", VIEWER),
        ("program", include_str!("report/page.js")),
    ];
    fill(include_str!("report/page.html"), &values)
}

fn page_data(answer: &Answer, input: &ReportInput) -> serde_json::Value {
    let cloud = input.session.cloud();
    let (low, high) = cloud.bounding_box();
    let center = nalgebra::center(&low, &high);
    // The expected surface reaches beyond what was measured.
    let scale = (high - low).amax().max(1e-9) / 32_000.0;
    let quantized = |points: &mut dyn Iterator<Item = Point3<f64>>| {
        let bytes = |p: Point3<f64>| [0, 1, 2].map(|i| ((p[i] - center[i]) / scale).round() as i16);
        STANDARD.encode(points.flat_map(bytes).flat_map(i16::to_le_bytes).collect::<Vec<u8>>())
    };
    let directions = |normals: &mut dyn Iterator<Item = Vector3<f64>>| {
        let bytes = |n: Vector3<f64>| n.try_normalize(0.0).unwrap_or_default().map(|x| (127.0 * x).round() as i8 as u8);
        STANDARD.encode(normals.flat_map(|n| <[u8; 3]>::from(bytes(n))).collect::<Vec<u8>>())
    };
    let expected = input.session.expected_surface(answer);
    let config = BoundaryConfig::default();
    let near = input.session.state().neighborhoods(config.neighbors);
    let mut boundary = vec![0u8; cloud.len()];
    for i in boundary_points(cloud, &near, &config) {
        boundary[i] = 1;
    }
    let candidates: Vec<_> = answer
        .candidates
        .iter()
        .map(|c| {
            json!({
                "pose": c.world_from_camera.matrix, "target": c.target_m, "score": c.score,
                "at": c.position_in_cell(), "stop": c.table.as_ref().map(|table| table.stop_deg),
                "gain": c.expected_gain, "overlap": c.expected_overlap,
                "why": c.objections.iter().map(|o| &o.reason).collect::<Vec<_>>(),
            })
        })
        .collect();
    let state = input.session.state();
    let past: Vec<_> = state
        .scans
        .iter()
        .zip(before(state))
        .map(|(camera, scan)| json!({ "pose": Pose::from(&camera.world_from_camera).matrix, "scan": scan }))
        .collect();
    let camera = &state.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let corner = |x: f64, y: f64| camera.unproject(x, y, 1.0);
    let (first, last): (Point3<f64>, Point3<f64>) = (corner(0.0, 0.0), corner(width, height));
    json!({
        "points": quantized(&mut cloud.points.iter().copied()),
        "normals": directions(&mut (0..cloud.len()).map(|i| cloud.normals.get(i).copied().unwrap_or_default())),
        "boundary": STANDARD.encode(boundary),
        "expected": quantized(&mut expected.iter().map(|e| e.0)), "outwards": directions(&mut expected.iter().map(|e| e.1)),
        "born": STANDARD.encode(first_scans(input.session).into_iter().flat_map(u32::to_le_bytes).collect::<Vec<u8>>()),
        "scans": answer.cloud.scans, "coverage": input.coverage,
        "center": [center.x, center.y, center.z], "scale": scale,
        "radius": 0.5 * (high - low).norm(), "spacing": answer.cloud.spacing_m,
        "candidates": candidates, "past": past,
        "next": answer.next.as_ref().map_or(-1, |next| next.rank as i64),
        // Left, right, top, bottom of the image at unit depth.
        "image": [first.x, last.x, first.y, last.y], "up": input.session.config().constraints.up,
    })
}

/// For each camera of the state the number of scans before the one that it is of: a line scan has several, a merged cloud too.
fn before(state: &ScanState) -> Vec<usize> {
    let numbers: Vec<usize> = (0..state.scans.len()).map(|k| state.number(k)).collect();
    let mut scans = numbers.clone();
    scans.sort_unstable();
    scans.dedup();
    numbers.iter().map(|number| scans.partition_point(|scan| scan < number)).collect()
}

/// For each point of the cloud the first scan, from 0, that measured something there.
fn first_scans(session: &Session) -> Vec<u32> {
    let (state, cloud) = (session.state(), session.cloud());
    let reach = 0.75 * state.grid_size;
    let mut first = vec![None; cloud.len()];
    let mut scans: Vec<_> = before(state).into_iter().zip(&state.scans).collect();
    // One that was kept aside comes after later ones.
    scans.sort_by_key(|(k, _)| *k);
    for (k, scan) in scans {
        let measured = match &scan.seen {
            Seen::Depth { camera, depth, .. } => &depth.to_points(camera, &scan.world_from_camera),
            Seen::Points(points) => points,
        };
        if measured.is_empty() {
            continue;
        }
        let near = NeighborGrid::new(measured, reach);
        for (first, p) in first.iter_mut().zip(&cloud.points).filter(|(first, _)| first.is_none()) {
            *first = near.any_within(p, reach).then_some(k as u32);
        }
    }
    first.into_iter().map(|k| k.unwrap_or_default()).collect()
}

fn side(answer: &Answer, coverage: &[f64]) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut html = format!("<p class=\"lead\">{}</p><dl class=\"facts\">", escape(&answer.reason()));
    let next = answer.next.as_ref();
    let missing = answer.missing.as_ref();
    let out_of_reach = missing.map(|m| m.out_of_reach_share).filter(|share| *share > 0.0);
    let facts = [
        Some(("new surface", next.and_then(|n| n.expected_gain).map(percent))),
        Some(("overlap", next.and_then(|n| n.expected_overlap).map(percent))),
        Some(("missing", missing.map(|m| percent(m.share)))),
        out_of_reach.map(|share| ("out of reach", Some(percent(share)))),
        Some(("distance", next.map(|n| planning::answer::length(n.working_distance_m)))),
    ];
    for (name, value) in facts.into_iter().flatten() {
        html += &format!("<div><dt>{name}</dt><dd>{}</dd></div>", value.as_deref().unwrap_or("not known"));
    }
    html += "</dl>";
    for warning in &answer.warnings {
        html += &format!("<div class=\"warn\">{}</div>", escape(warning));
    }
    if let Some(next) = next {
        html += &placed(next);
    }
    if coverage.len() > 1 {
        html += &format!("<h2>Coverage after each view, %</h2>{}", coverage_curve(coverage));
    }
    if let Some(missing) = answer.missing.as_ref().filter(|m| !m.holes.is_empty()) {
        html += "<h2>Missing surface</h2><table><thead><tr><th>share</th><th>size</th><th class=\"text\">why not seen yet</th>\
                 <th>in reach</th></tr></thead>";
        for hole in missing.holes.iter().take(8) {
            html += &format!(
                "<tr><td>{}</td><td>{}</td><td class=\"text\">{}</td><td>{:.0} %</td></tr>",
                percent(hole.share),
                planning::answer::length(hole.size_m),
                hole.unseen.describe(),
                100.0 * hole.within_reach
            );
        }
        html += "</table>";
    }
    html
}

/// What a robot is driven by: the pose in the frame that does not turn, with the stop of a turntable and the joints of an arm.
fn placed(next: &Candidate) -> String {
    let mut html = String::new();
    let (name, pose) = match &next.table {
        Some(table) => {
            html += &format!("<h2>Turntable</h2><pre>turn the table to {} degrees</pre>", table.stop_deg);
            ("cell_from_camera", &table.cell_from_camera)
        }
        None => ("world_from_camera", &next.world_from_camera),
    };
    let rows = pose.matrix.map(|r| r.map(|x| format!("{x:10.6}")).join(" ")).join("\n");
    html += &format!("<h2>{name}, +X right, +Y down, +Z forward, metres</h2><pre>{rows}</pre>");
    if let Some(reached) = &next.reached {
        let joints: Vec<String> =
            reached.joints.iter().map(|joint| format!("{} {:.4}", escape(&joint.name), joint.value)).collect();
        html += &format!("<h2>Joints, rad, of sliding ones m</h2><pre>{}</pre>", joints.join("\n"));
    }
    html
}

fn coverage_curve(coverage: &[f64]) -> String {
    let x = |i: usize| 34.0 + 340.0 * i as f64 / (coverage.len() - 1) as f64;
    let y = |c: f64| 102.0 - 92.0 * c.clamp(0.0, 1.0);
    let points: Vec<String> = coverage.iter().enumerate().map(|(i, &c)| format!("{:.1},{:.1}", x(i), y(c))).collect();
    let grid: String = [0.0, 0.5, 0.9, 1.0]
        .iter()
        .map(|&c| {
            let (y, percent) = (y(c), 100.0 * c);
            format!(
                "<line x1=\"34\" x2=\"374\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text x=\"30\" y=\"{:.1}\" font-size=\"9\" text-anchor=\"end\">{percent:.0}</text>",
                y + 3.0
            )
        })
        .collect();
    let last = 100.0 * coverage[coverage.len() - 1];
    format!(
        "<svg viewBox=\"0 0 384 118\">{grid}<polyline points=\"{}\" fill=\"none\" stroke=\"#4c8dff\" stroke-width=\"2\"/>\
         <text x=\"374\" y=\"115\" font-size=\"9\" text-anchor=\"end\">{} views, {last:.1} %</text></svg>",
        points.join(" "),
        coverage.len()
    )
}

/// Replaces each `{{name}}` once, in one pass, so that a value is never searched for names.
fn fill(page: &str, values: &[(&str, &str)]) -> String {
    let mut filled = String::with_capacity(page.len() + values.iter().map(|(_, v)| v.len()).sum::<usize>());
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("{{") {
        filled.push_str(before);
        let known = after
            .split_once("}}")
            .and_then(|(name, rest)| values.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value, rest)));
        match known {
            Some((value, after)) => {
                filled.push_str(value);
                rest = after;
            }
            None => {
                filled.push_str("{{");
                rest = after;
            }
        }
    }
    filled + rest
}

#[cfg(test)]
mod tests;
