//! Which of an object's surface cameras see at all.

use crate::{EpisodeConfig, RenderConfig, Scene};
use geometry::{NeighborGrid, View};
use nalgebra::Point3;

/// The samples that some of these views sees, to the tolerance of the episode.
pub fn visible_from(
    scene: &Scene,
    samples: &[Point3<f64>],
    episode: &EpisodeConfig,
    views: impl IntoIterator<Item = View>,
) -> Vec<Point3<f64>> {
    let camera = episode.image.camera();
    let render = RenderConfig { noise: None, ..episode.render.clone() };
    let mut seen = Vec::new();
    for view in views {
        let pose = view.world_from_camera();
        seen.extend(scene.depth_image(&camera, &pose, &render).to_points(&camera, &pose));
    }
    let grid = NeighborGrid::new(&seen, 2.0 * episode.tolerance_m);
    samples.iter().copied().filter(|p| grid.any_within(p, episode.tolerance_m)).collect()
}
