//! Occlusion of a frontier point from a view, and the proactive answer to it.

use super::optimise::clearest_direction;
use super::state::Surface;
use nalgebra::{Point3, Vector3};

/// Steps along the normal after which the search for free space ends.
const MAX_STEPS: usize = 10_000;

impl Surface {
    /// Steps along the normal until no stored point lies within a step; at least 1, the point itself is stored.
    fn offset(&self, i: u32) -> f64 {
        let stored = &self.points[i as usize];
        (1..MAX_STEPS)
            .find(|&s| {
                let probe = stored.position + s as f64 * self.params.probe * stored.normal;
                !self.grid.any_within(&probe, self.params.probe)
            })
            .unwrap_or(MAX_STEPS) as f64
    }

    /// Whether the first psi metres from frontier `i` towards a view position are free of stored points.
    pub(super) fn visible(&self, i: u32, view: &Point3<f64>, offset: f64) -> bool {
        let p = self.points[i as usize].position;
        let direction = (view - p).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let step = self.params.probe;
        let probes = (self.params.occlusion / step).ceil().max(1.0) as usize;
        (0..probes).all(|s| !self.grid.any_within(&(p + (offset + s as f64) * step * direction), step))
    }

    /// Turns the view of an occluded frontier to where it is clear of occluders, or gives the frontier up.
    pub(super) fn update_view(&mut self, i: u32) {
        let offset = self.offset(i);
        let stored = &self.points[i as usize];
        let p = stored.position;
        if self.visible(i, &stored.view, offset) {
            return;
        }
        let observed = (stored.observed_from - p).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let origin = p + offset * self.params.probe * observed;
        let reach = self.params.occlusion * self.params.occlusion;
        let occluders: Vec<Vector3<f64>> = self
            .sparse
            .iter()
            .filter(|s| (*s - p).norm_squared() <= reach)
            .filter_map(|s| (s - origin).try_normalize(0.0))
            .collect();
        let Some(direction) = clearest_direction(&occluders, &observed) else { return };
        let view = p + self.params.distance * direction;
        let stored = &mut self.points[i as usize];
        stored.looking = -direction;
        stored.view = view;
        if !self.visible(i, &view, offset) {
            self.free(i);
        }
    }

    /// Draws the arcs of a frontier anew: to every frontier, among those with views near its own, that its view sees.
    pub(super) fn update_arcs(&mut self, i: u32) {
        let view = self.points[i as usize].view;
        let seen: Vec<u32> = self
            .frontiers_by_view(&view, self.params.updates)
            .into_iter()
            .filter(|&j| j != i && self.visible(j, &view, self.offset(j)))
            .collect();
        self.graph.set_arcs(i, seen);
    }
}

#[cfg(test)]
mod tests {
    use super::super::params::{SeeConfig, SeeParams};
    use super::super::state::Surface;
    use nalgebra::Point3;

    /// A square plate of 40 mm at a height, spacing 2 mm.
    fn plate(height: f64) -> Vec<Point3<f64>> {
        (0..=20)
            .flat_map(|i| {
                (0..=20).map(move |j| Point3::new(0.002 * f64::from(i - 10), 0.002 * f64::from(j - 10), height))
            })
            .collect()
    }

    #[test]
    fn a_plate_above_hides_the_plate_below() {
        let config = SeeConfig {
            radius_m: 0.006,
            density_per_m3: 2.4e7,
            occlusion_search_m: 0.1,
            probe_step_m: 0.004,
            ..SeeConfig::default()
        };
        let params = SeeParams::resolve(&config, &[], 0.002, 1.2).expect("valid");
        let mut below = Surface::new(params.clone());
        below.update(&plate(0.0), Point3::new(0.0, 0.0, 1.2));
        let edge = *below.frontiers.first().expect("the plate has an edge");
        let above = below.points[edge as usize].position + nalgebra::Vector3::new(0.0, 0.0, 1.2);
        let offset = below.offset(edge);
        assert!(below.visible(edge, &above, offset), "nothing is above the lower plate");
        let mut both = Surface::new(params);
        both.update(&[plate(0.0), plate(0.05)].concat(), Point3::new(0.0, 0.0, 1.2));
        let position = below.points[edge as usize].position;
        let same = both.points.iter().position(|s| s.position == position).expect("stored") as u32;
        assert!(!both.visible(same, &above, offset), "the upper plate is in the way");
        let outside = position + 1.2 * nalgebra::Vector3::new(position.x, position.y, 0.0).normalize();
        assert!(both.visible(same, &outside, offset), "sideways out of the gap is free");
    }
}
