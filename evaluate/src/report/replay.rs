//! One episode as a cloud that grows from view to view.

use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::objects::{Body, Object};
use crate::record::EpisodeRecord;
use base64::Engine;
use datagen::RenderConfig;
use datagen::registration::{Refused, ViewRegistration};
use formats::html::{VIEWER, escape};
use nalgebra::{Point3, Vector3};
use std::fmt::Write;

/// The episode shown: the first policy's first on the first object; where scans were registered, the first of any policy in which
/// one failed.
pub fn choose<'a>(
    contents: &'a Contents,
    policies: &[String],
    objects: &'a [Object],
) -> Option<(&'a Object, &'a EpisodeRecord)> {
    let find = |of: &dyn Fn(&EpisodeRecord) -> bool| {
        policies.iter().find_map(|policy| {
            let of =
                |r: &EpisodeRecord, object: &Object| r.key.policy == *policy && r.key.object == object.name && of(r);
            let records = || contents.episodes.iter().map(|(r, _)| r);
            objects.iter().find_map(|object| Some((object, records().find(|r| of(r, object))?)))
        })
    };
    let failed = |r: &EpisodeRecord| r.registration.iter().flat_map(|outcome| &outcome.views).any(|view| view.failed);
    find(&failed).or_else(|| find(&|_| true))
}

/// How view `i` was registered, the first scan being 0.
fn registered(record: &EpisodeRecord, i: usize) -> Option<&ViewRegistration> {
    record.registration.as_ref()?.views.get(i.checked_sub(1)?)
}

/// The same in words; empty where nothing was registered.
fn note(record: &EpisodeRecord, i: usize) -> String {
    let Some(found) = registered(record, i) else { return String::new() };
    let fate = match (found.left_m, found.refused) {
        (Some(left), _) if found.failed => format!("failed, {:.1} mm off", 1e3 * left),
        (Some(left), _) => format!("registered, {:.1} mm off", 1e3 * left),
        (None, Some(Refused::Empty)) => "shows nothing".to_owned(),
        (None, Some(Refused::TooFewPairs)) => "rejected: too little overlap".to_owned(),
        (None, Some(Refused::TooFar)) => "rejected: farther off than the robot can be".to_owned(),
        (None, _) => "rejected: its place is not sure".to_owned(),
    };
    let waited = match found.waited {
        0 => String::new(),
        1 => " (a view later)".to_owned(),
        n => format!(" ({n} views later)"),
    };
    let overlap = record.overlaps[i - 1].map_or(String::new(), |o| format!("overlap {:.0} %, ", 100.0 * o));
    format!(
        "; {fate}{waited}; {overlap}lambda {:.1} (expected {:.1}), given {:.1} mm off{}",
        found.lambda,
        found.expected_lambda,
        1e3 * found.given_m,
        if found.bridge { "; taken to connect a rejected scan" } else { "" }
    )
}

/// The page's part: canvas, slider, data and program. Scans are made again from the views, without noise, and put where they were
/// registered.
pub fn html(object: &Object, record: &EpisodeRecord, config: &EvaluateConfig) -> String {
    let camera = config.episode.image.camera();
    let render = RenderConfig { noise: None, ..config.episode.render.clone() };
    let (mut points, mut scans) = (Vec::new(), Vec::new());
    for (i, view) in record.views.iter().enumerate() {
        let first = points.len();
        match &object.body {
            Body::Mesh(mesh) if view.is_valid() => {
                let pose = view.world_from_camera();
                points.extend(mesh.scene.depth_image(&camera, &pose, &render).to_points(&camera, &pose));
            }
            Body::Mesh(_) => {}
            Body::Recorded(recording) => {
                let scan = recording.views().iter().position(|v| v == view);
                points.extend(scan.map_or(&[][..], |scan| recording.points(scan)));
            }
        }
        match registered(record, i) {
            Some(found) if found.left_m.is_some() => {
                points[first..].iter_mut().for_each(|p: &mut Point3<f64>| *p = found.placed_from_true * *p);
            }
            Some(_) => points.truncate(first),
            None => {}
        }
        scans.push(points.len());
    }
    if let Body::Recorded(recording) = &object.body {
        // Meshes are centred; recordings are where they are.
        let sum: Vector3<f64> = recording.reference().iter().map(|p| p.coords).sum();
        points.iter_mut().for_each(|p: &mut Point3<f64>| p.coords -= sum / recording.reference().len().max(1) as f64);
    }
    let extent = points.iter().map(|p| p.coords.amax()).fold(1e-9, f64::max);
    let quantized: Vec<u8> = points
        .iter()
        .flat_map(|p| p.coords.iter().map(|x| (x / extent * 32_767.0) as i16).collect::<Vec<_>>())
        .flat_map(i16::to_le_bytes)
        .collect();
    let spacing = config.episode.image.camera().pixel_size(config.episode.working_distance_m);
    let data = base64::engine::general_purpose::STANDARD.encode(quantized);
    let cameras: Vec<String> = record
        .views
        .iter()
        .map(|v| {
            let d = v.direction();
            format!("[{:.4},{:.4},{:.4}]", d.x, d.y, d.z)
        })
        .collect();
    let notes: Vec<String> = (0..record.views.len()).map(|i| note(record, i)).collect();
    let failed: Vec<bool> =
        (0..record.views.len()).map(|i| registered(record, i).is_some_and(|found| found.failed)).collect();
    let coverages: Vec<String> = record.coverages.iter().map(|c| format!("{:.1}", 100.0 * c)).collect();
    let mut text = String::new();
    let _ = write!(
        text,
        "<h2>One episode: {} on {}</h2><p>Points are coloured by scan{}, rays point to the cameras. Drag or arrow keys turn, wheel \
         or + and - zoom.</p><canvas id=\"replay\"></canvas><p><button id=\"play\">play</button> <input id=\"step\" type=\"range\" \
         min=\"1\" max=\"{}\" value=\"{}\" style=\"width:60%\" aria-label=\"views shown\"> <span id=\"caption\"></span></p>\
         <script>const DATA={{points:\"{data}\",extent:{extent},spacing:{spacing},ends:{scans:?},cameras:[{}],coverages:[{}],notes:{},failed:{failed:?}}};\n{}\n{}</script>",
        escape(&record.key.policy),
        escape(&object.name),
        if record.registration.is_some() { ", where they were registered; scans that failed are red" } else { "" },
        record.views.len(),
        record.views.len(),
        cameras.join(","),
        coverages.join(","),
        serde_json::json!(notes),
        VIEWER,
        include_str!("replay.js")
    );
    text
}
