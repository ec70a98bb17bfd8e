//! The answer as one self-contained page: cloud, boundary, candidates coloured by score, the chosen view, to be
//! turned with the mouse (WebGL 1 by hand; no library, nothing loaded from elsewhere).

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geometry::{BoundaryConfig, PinholeCamera, PointCloud, boundary_points};
use nalgebra::{Isometry3, Point3};
use planning::Answer;
use planning::pose::Pose;
use serde_json::json;

const PAGE: &str = include_str!("report.html");

/// What the page shows beside the answer.
#[derive(Clone, Debug)]
pub struct ReportInput<'a> {
    /// Title: the object or the files.
    pub title: &'a str,
    /// The cloud planned on.
    pub cloud: &'a PointCloud,
    /// The camera whose frustum is drawn.
    pub camera: PinholeCamera,
    /// Poses of the past scans (`world_from_camera`), where known.
    pub past: Vec<Isometry3<f64>>,
    /// The direction that is up.
    pub up: [f64; 3],
    /// Coverage after each view, in [0, 1], where there is ground truth (closed loop in the simulator).
    pub coverage: &'a [f64],
}

/// The page. Every text in it is escaped, whatever the title or the reasons contain.
pub fn report_html(answer: &Answer, input: &ReportInput) -> String {
    // JSON in a script element: only `<` could end it.
    let data = page_data(answer, input).to_string().replace('<', "\\u003c");
    fill(PAGE, &[("title", &escape(input.title)), ("side", &side(answer, input.coverage)), ("data", &data)])
}

fn page_data(answer: &Answer, input: &ReportInput) -> serde_json::Value {
    let cloud = input.cloud;
    let (low, high) = cloud.bounding_box();
    let center = nalgebra::center(&low, &high);
    let half = (0.5 * (high - low).amax()).max(1e-9);
    let scale = half / 32_000.0;
    let points: Vec<u8> = cloud
        .points
        .iter()
        .flat_map(|p| [0, 1, 2].map(|i| ((p[i] - center[i]) / scale).round() as i16))
        .flat_map(i16::to_le_bytes)
        .collect();
    let normals: Vec<u8> = (0..cloud.len())
        .flat_map(|i| {
            let n = cloud.normals.get(i).and_then(|n| n.try_normalize(0.0)).unwrap_or_default();
            [n.x, n.y, n.z].map(|x| (127.0 * x).round() as i8 as u8)
        })
        .collect();
    let mut boundary = vec![0u8; cloud.len()];
    for i in boundary_points(cloud, &BoundaryConfig::default()) {
        boundary[i] = 1;
    }
    let candidates: Vec<_> = answer
        .candidates
        .iter()
        .map(|c| {
            json!({
                "pose": c.world_from_camera.matrix, "target": c.target_m, "score": c.score,
                "gain": c.expected_gain, "overlap": c.expected_overlap,
                "why": c.objections.iter().map(|o| &o.reason).collect::<Vec<_>>(),
            })
        })
        .collect();
    let past: Vec<_> = input.past.iter().map(|pose| json!({ "pose": Pose::from(pose).matrix })).collect();
    let camera = &input.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let corner = |x: f64, y: f64| camera.unproject(x, y, 1.0);
    let (first, last): (Point3<f64>, Point3<f64>) = (corner(0.0, 0.0), corner(width, height));
    json!({
        "points": STANDARD.encode(points), "normals": STANDARD.encode(normals), "boundary": STANDARD.encode(boundary),
        "center": [center.x, center.y, center.z], "scale": scale,
        "radius": 0.5 * (high - low).norm(), "reach": (high - low).norm(), "spacing": answer.cloud.spacing_m,
        "candidates": candidates, "past": past, "next": answer.next.as_ref().map_or(-1, |next| next.rank as i64),
        // Left, right, top, bottom of the image at unit depth.
        "image": [first.x, last.x, first.y, last.y], "up": input.up,
    })
}

fn side(answer: &Answer, coverage: &[f64]) -> String {
    let mut html = String::new();
    for warning in &answer.warnings {
        html += &format!("<div class=\"warn\">{}</div>", escape(warning));
    }
    // The warnings stand above already.
    let text = Answer { warnings: Vec::new(), ..answer.clone() }.to_text();
    html += &format!("<pre>{}</pre>", escape(&text));
    if coverage.len() > 1 {
        html += &format!("<h2>Coverage after each view</h2>{}", coverage_curve(coverage));
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
                "<line x1=\"34\" x2=\"374\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"30\" y=\"{:.1}\" font-size=\"9\" text-anchor=\"end\">{percent:.0}</text>",
                y + 3.0
            )
        })
        .collect();
    let last = 100.0 * coverage[coverage.len() - 1];
    format!(
        "<svg viewBox=\"0 0 384 118\">{grid}<polyline points=\"{}\" fill=\"none\" stroke=\"#2166ac\" stroke-width=\"2\"/>\
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

/// Text as HTML.
fn escape(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut html, c| {
        match c {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            '"' => html.push_str("&quot;"),
            '\'' => html.push_str("&#39;"),
            c => html.push(c),
        }
        html
    })
}

#[cfg(test)]
mod tests;
