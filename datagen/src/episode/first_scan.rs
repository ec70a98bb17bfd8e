//! The first scan of an episode.

use super::{EpisodeConfig, VoidEpisode};
use crate::world::{ScanCamera, World};
use geometry::View;
use nalgebra::{Point3, Vector3};
use planning::{Accumulate, Session};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// The first view whose scan is usable, and how many before it were not.
pub(super) fn first_scan(
    camera: &mut ScanCamera,
    world: &mut World,
    config: &EpisodeConfig,
    rng: &mut ChaCha8Rng,
) -> Result<(View, usize), VoidEpisode> {
    let (mut most_points, mut best_coverage, mut ruled_out, mut crowded) = (0, 0f64, None, None);
    for void_draws in 0..config.max_draws {
        let view = match first_in_reach(&world.session, config, rng) {
            Ok(view) => view,
            Err(reason) => {
                ruled_out = Some(reason);
                continue;
            }
        };
        camera.restart();
        let shot = world.shoot(camera, &view);
        let points = shot.points.len();
        most_points = most_points.max(points);
        if points < config.min_first_points.max(2) {
            continue;
        }
        if world.begin(shot).is_err() {
            continue;
        }
        best_coverage = best_coverage.max(world.covered);
        // As published: a scan with more points than the reference is void too, where it is matched with it; those of a table
        // do not count.
        let too_many = config.accumulate == Accumulate::Matched
            && world.session.support().is_none()
            && points > world.reference().len();
        if too_many {
            crowded = Some((points, world.reference().len()));
        }
        if world.covered < config.min_first_coverage || too_many {
            continue;
        }
        return Ok((view, void_draws));
    }
    Err(VoidEpisode {
        draws: config.max_draws,
        points: most_points,
        min_points: config.min_first_points,
        coverage: best_coverage,
        min_coverage: config.min_first_coverage,
        ruled_out,
        crowded,
    })
}

/// A first view that the session's cell allows: one of those given, where views are.
///
/// # Errors
/// What spoke against the last one drawn.
fn first_in_reach(session: &Session, config: &EpisodeConfig, rng: &mut ChaCha8Rng) -> Result<View, String> {
    const DRAWS: usize = 100;
    let given = session.state().given();
    let mut reason = String::new();
    for _ in 0..DRAWS {
        let view = if given.is_empty() { initial_view(config, rng) } else { given[rng.random_range(0..given.len())] };
        match session.place(&view).objections.into_iter().next() {
            None => return Ok(view),
            Some(objection) => reason = objection.reason,
        }
    }
    Err(reason)
}

/// The first view: camera on the upper half of a sphere around the origin, polar angle uniform in [0, 90) degrees,
/// azimuth in [0, 360), looking at the origin.
pub fn initial_view(config: &EpisodeConfig, rng: &mut ChaCha8Rng) -> View {
    let (polar, azimuth) = if config.initial_whole_degrees {
        (f64::from(rng.random_range(0..90)), f64::from(rng.random_range(0..360)))
    } else {
        (rng.random_range(0.0..90.0), rng.random_range(0.0..360.0))
    };
    let (polar, azimuth) = (f64::to_radians(polar), f64::to_radians(azimuth));
    let direction = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let distance = config.initial_distance_m.unwrap_or(config.working_distance_m);
    View { target: Point3::origin(), position: Point3::from(distance * direction) }
}
