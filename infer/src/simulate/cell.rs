//! The cell of the simulated loop: the table, and what its limits let the camera see.

use datagen::{EpisodeConfig, Scene, visible_from};
use geometry::sphere::{fibonacci, view_at};
use geometry::{Mesh, NeighborGrid};
use nalgebra::{Point3, Vector3};
use planning::constraints::ConstraintsConfig;
use planning::{Session, SessionConfig, Support};
use serde::Serialize;

/// Side and thickness of the table's top, metres; objects have a diagonal of 0.2 m.
const TABLE_M: [f64; 2] = [0.3, 0.01];
/// Views all around that are asked for what they see.
const VIEWS: usize = 200;

/// What the cell's limits let the camera see.
#[derive(Clone, Debug, Serialize)]
pub struct WithinReach {
    /// Share of the views all around that may be taken.
    pub views: f64,
    /// Share of the surface that one of them, or of those taken, sees.
    pub surface: f64,
    /// Share of that surface which was covered.
    pub coverage: f64,
}

impl WithinReach {
    /// A line for the terminal.
    pub fn describe(&self) -> String {
        let [views, surface, coverage] = [self.views, self.surface, self.coverage].map(|share| 100.0 * share);
        format!(
            "within reach: {views:.0} % of the views around the object, which see {surface:.1} % of its surface; {coverage:.1} % of \
             that is covered"
        )
    }
}

/// The object with a table under it, which it touches where it reaches lowest along `up`.
pub fn on_table(mut mesh: Mesh, up: &Vector3<f64>) -> Mesh {
    let [side, thickness] = TABLE_M;
    let lowest = mesh.vertices.iter().map(|v| v.coords.dot(up)).fold(f64::INFINITY, f64::min);
    let across = up.cross(&if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
    let along = up.cross(&across);
    let first = mesh.vertices.len() as u32;
    for corner in 0..8 {
        let sign = |bit: u32| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
        let height = lowest - if corner >> 2 & 1 == 1 { 0.0 } else { thickness };
        mesh.vertices.push(Point3::from(side * (sign(0) * across + sign(1) * along) + height * up));
    }
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in faces.map(|face| face.map(|i| first + i)) {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn is_limited(config: &SessionConfig) -> bool {
    config.support != Support::None
        || config.robot.is_some()
        || config.turntable.is_some()
        || config.constraints != ConstraintsConfig::default()
}

/// Of the true surface that views within the cell's limits see, how much is `covered`.
pub fn within_reach(
    scene: &Scene,
    samples: &[Point3<f64>],
    episode: &EpisodeConfig,
    session: &Session,
    covered: &[Point3<f64>],
) -> Option<WithinReach> {
    if !is_limited(session.config()) {
        return None;
    }
    let given = session.state().given();
    let around = || fibonacci(VIEWS).into_iter().map(|d| view_at(&d, episode.working_distance_m)).collect();
    let views: Vec<_> = if given.is_empty() { around() } else { given };
    let all = views.len();
    let allowed: Vec<_> = views.into_iter().filter(|view| session.place(view).objections.is_empty()).collect();
    let share = allowed.len() as f64 / all as f64;
    let seen = visible_from(scene, samples, episode, allowed);
    let near = NeighborGrid::new(covered, 2.0 * episode.tolerance_m);
    let taken = samples.iter().filter(|p| near.any_within(p, episode.tolerance_m)).count();
    let missed = seen.iter().filter(|p| !near.any_within(p, episode.tolerance_m)).count();
    Some(WithinReach {
        views: share,
        surface: (taken + missed) as f64 / samples.len() as f64,
        coverage: taken as f64 / (taken + missed).max(1) as f64,
    })
}
