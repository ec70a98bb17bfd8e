//! One episode as a cloud that grows from view to view.

use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::objects::{Body, Object};
use crate::record::EpisodeRecord;
use base64::Engine;
use datagen::RenderConfig;
use formats::html::{VIEWER, escape};
use nalgebra::{Point3, Vector3};
use std::fmt::Write;

/// The episode shown: the first policy's first on the first object.
pub fn choose<'a>(
    contents: &'a Contents,
    policies: &[String],
    objects: &'a [Object],
) -> Option<(&'a Object, &'a EpisodeRecord)> {
    let policy = policies.first()?;
    objects.iter().find_map(|object| {
        let of = |r: &&EpisodeRecord| r.key.policy == *policy && r.key.object == object.name;
        Some((object, contents.episodes.iter().map(|(r, _)| r).find(of)?))
    })
}

/// The page's part: canvas, slider, data and program. Scans are made again from the views, without noise.
pub fn html(object: &Object, record: &EpisodeRecord, config: &EvaluateConfig) -> String {
    let camera = config.episode.image.camera();
    let render = RenderConfig { noise: None, ..config.episode.render.clone() };
    let (mut points, mut scans) = (Vec::new(), Vec::new());
    for view in &record.views {
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
    let coverages: Vec<String> = record.coverages.iter().map(|c| format!("{:.1}", 100.0 * c)).collect();
    let mut text = String::new();
    let _ = write!(
        text,
        "<h2>One episode: {} on {}</h2><p>Points are coloured by scan, rays point to the cameras. Drag or arrow keys turn, wheel \
         or + and - zoom.</p><canvas id=\"replay\"></canvas><p><button id=\"play\">play</button> <input id=\"step\" type=\"range\" \
         min=\"1\" max=\"{}\" value=\"{}\" style=\"width:60%\" aria-label=\"views shown\"> <span id=\"caption\"></span></p>\
         <script>const DATA={{points:\"{data}\",extent:{extent},spacing:{spacing},ends:{scans:?},cameras:[{}],coverages:[{}]}};\n{}\n{}</script>",
        escape(&record.key.policy),
        escape(&object.name),
        record.views.len(),
        record.views.len(),
        cameras.join(","),
        coverages.join(","),
        VIEWER,
        include_str!("replay.js")
    );
    text
}
