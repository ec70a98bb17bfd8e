//! What a view sees of a cloud: points in an image, the nearest in each of its cells.

use crate::ScanState;
use geometry::{PointCloud, View};
use nalgebra::Isometry3;

/// Spacings of the cloud that a cell is wide in which points hide each other: hardly any cell of a seen surface is empty.
const CELL: f64 = 1.5;
/// Cells of the table at most.
const MOST_CELLS: f64 = 4e6;
/// Cosine between normal and line of sight from which on a point is seen.
const FACING: f64 = 0.1;
/// The points of a cloud that a view measures from this pose of its camera, each with its area: the nearest of each cell of an image about as
/// fine as the cloud, if the sensor measures it and nothing in the cells beside it hides it. A cell counts its area at the point's depth, square
/// to the line of sight. The camera and its sensor are those of `state`.
pub(crate) fn visible(
    cloud: &PointCloud,
    spacing: f64,
    state: &ScanState,
    view: &View,
    world_from_camera: &Isometry3<f64>,
) -> Vec<(usize, f64)> {
    let camera = &state.camera;
    let mut found = Vec::new();
    if !view.is_valid() || !cloud.has_normals() {
        return found;
    }
    let camera_from_world = world_from_camera.inverse();
    let distance = (view.position - view.target).norm();
    let image = f64::from(camera.width) / camera.fx * f64::from(camera.height) / camera.fy;
    let width = (CELL * spacing / distance).max((image / MOST_CELLS).sqrt());
    // Point, cell and depth of what faces the camera in its image.
    let mut seen: Vec<(u32, [i64; 2], f64)> = Vec::new();
    let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
    for (i, (p, n)) in cloud.points.iter().zip(&cloud.normals).enumerate() {
        let to_camera = view.position - p;
        if to_camera.dot(n) <= FACING * n.norm() * to_camera.norm() {
            continue;
        }
        let local = camera_from_world * p;
        if local.z <= 0.0 {
            continue;
        }
        let pixel = camera.project(&local);
        let inside =
            (0.0..f64::from(camera.width)).contains(&pixel.x) && (0.0..f64::from(camera.height)).contains(&pixel.y);
        if inside {
            let cell = [local.x, local.y].map(|x| (x / local.z / width).floor() as i64);
            for k in 0..2 {
                (low[k], high[k]) = (low[k].min(cell[k]), high[k].max(cell[k]));
            }
            seen.push((i as u32, cell, local.z));
        }
    }
    if seen.is_empty() {
        return found;
    }
    // One cell more on each side, for the cells beside.
    let [columns, rows] = [0, 1].map(|k| (high[k] - low[k] + 3) as usize);
    let index = |cell: &[i64; 2]| (cell[1] - low[1] + 1) as usize * columns + (cell[0] - low[0] + 1) as usize;
    let mut front = vec![(f64::INFINITY, u32::MAX); columns * rows];
    for (i, cell, z) in &seen {
        let nearest = &mut front[index(cell)];
        if *z < nearest.0 {
            *nearest = (*z, *i);
        }
    }
    for (i, cell, z) in &seen {
        let at = index(cell);
        if front[at].1 != *i {
            continue;
        }
        let beside = [
            at - columns - 1,
            at - columns,
            at - columns + 1,
            at - 1,
            at + 1,
            at + columns - 1,
            at + columns,
            at + columns + 1,
        ];
        // Surface at this slant comes nearer by so much in a cell or two.
        let (p, n) = (&cloud.points[*i as usize], &cloud.normals[*i as usize]);
        // What is not measured hides what is behind it all the same.
        if !state.sensor.measures(&view.position, p, n) {
            continue;
        }
        let to_camera = view.position - p;
        let cosine = to_camera.dot(n) / (n.norm() * to_camera.norm());
        let slack = 2.0 * width * z / cosine;
        let hiding = beside.iter().filter(|&&b| front[b].0 < z - slack).count();
        if hiding >= 4 {
            continue;
        }
        found.push((*i as usize, (width * z).powi(2)));
    }
    found
}
