//! Parameters of SEE, given or derived.

use formats::config::SettingError;
use nalgebra::Point3;

/// What a user may set. A zero is derived, as the published code does.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SeeConfig {
    /// Radius r of the density ball, metres; 0: from the spacing of the first scan (`radius_in_spacings`).
    pub radius_m: f64,
    /// Target density rho, points per cubic metre; 0: from the first scan's interior (`fill`).
    pub density_per_m3: f64,
    /// Distance of a proposed view from its frontier point, metres; 0: the working distance.
    pub view_distance_m: f64,
    /// How far in front of a frontier occluders are looked for (psi), metres; 0: half the diagonal of the first cloud.
    pub occlusion_search_m: f64,
    /// Step and radius of the visibility probes (upsilon), metres; 0: the radius r.
    pub probe_step_m: f64,
    /// Frontiers whose views are updated per scan (tau).
    pub updates_per_scan: usize,
    /// r as a multiple of the first scan's point spacing.
    pub radius_in_spacings: f64,
    /// k as a share of the points found in a ball on the first scan's interior.
    pub fill: f64,
    /// Upper bound of the spacing of stored points as a multiple of the first scan's spacing; 0: no bound.
    pub max_thinning: f64,
}

impl Default for SeeConfig {
    fn default() -> Self {
        Self {
            radius_m: 0.0,
            density_per_m3: 0.0,
            view_distance_m: 0.0,
            occlusion_search_m: 0.0,
            probe_step_m: 0.0,
            updates_per_scan: 100,
            radius_in_spacings: 4.0,
            fill: 0.38,
            max_thinning: 0.9,
        }
    }
}

impl SeeConfig {
    /// The published benchmark's `config.json`: far from the regime of the method's authors (k = 56 instead of 4).
    pub fn paper() -> Self {
        Self {
            radius_m: 0.03,
            density_per_m3: 490_738.0,
            view_distance_m: 1.5,
            occlusion_search_m: 0.5,
            probe_step_m: 0.01,
            max_thinning: 0.0,
            ..Self::default()
        }
    }

    /// The best fixed parameters found for objects of 0.2 m.
    pub fn fixed() -> Self {
        Self { radius_m: 0.010, density_per_m3: 4e6, ..Self::default() }
    }

    /// Radius of the density ball for a first scan with this point spacing, metres.
    pub(super) fn radius(&self, spacing: f64) -> f64 {
        if self.radius_m > 0.0 { self.radius_m } else { self.radius_in_spacings * spacing }
    }

    /// Refuses values that cannot be meant.
    ///
    /// # Errors
    /// The key, what was found, and what was expected.
    pub fn validate(&self) -> Result<(), SettingError> {
        let at_least_0 = [
            ("see.radius_m", self.radius_m),
            ("see.density_per_m3", self.density_per_m3),
            ("see.view_distance_m", self.view_distance_m),
            ("see.occlusion_search_m", self.occlusion_search_m),
            ("see.probe_step_m", self.probe_step_m),
            ("see.max_thinning", self.max_thinning),
        ];
        for (key, value) in at_least_0 {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SettingError::new(key, value, "a number of at least 0"));
            }
        }
        for (key, value) in [("see.radius_in_spacings", self.radius_in_spacings), ("see.fill", self.fill)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SettingError::new(key, value, "a number above 0"));
            }
        }
        match self.updates_per_scan {
            0 => Err(SettingError::new("see.updates_per_scan", 0, "at least 1")),
            _ => Ok(()),
        }
    }
}

/// Parameters in use; all lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SeeParams {
    /// Radius of the density ball.
    pub radius: f64,
    /// Points in the ball that make its centre a core point.
    pub k: usize,
    /// Least spacing of stored points.
    pub spacing: f64,
    /// Distance of a view from its frontier point.
    pub distance: f64,
    /// How far in front of a frontier occluders matter (psi).
    pub occlusion: f64,
    /// Step and radius of visibility probes (upsilon).
    pub probe: f64,
    /// Frontiers updated per scan (tau).
    pub updates: usize,
}

/// Points that the target density puts into the ball: (4/3) pi r^3 rho.
fn ball_count(radius: f64, density: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * density
}

/// The published spacing of stored points: (3 r / (2 pi rho))^(1/3).
fn published_spacing(radius: f64, density: f64) -> f64 {
    (3.0 * radius / (2.0 * std::f64::consts::PI * density)).cbrt()
}

impl SeeParams {
    /// Parameters for a first scan with this point spacing, from the configuration and, where it leaves a zero, by the
    /// automatic rule. `None` when the density asks for fewer than 3 points per ball.
    pub fn resolve(config: &SeeConfig, scan: &[Point3<f64>], spacing: f64, working_distance: f64) -> Option<Self> {
        let radius = config.radius(spacing);
        let k = if config.density_per_m3 > 0.0 {
            ball_count(radius, config.density_per_m3).ceil()
        } else {
            (config.fill * interior_count(scan, radius)).round()
        };
        if k.is_nan() || k < 3.0 || radius <= 0.0 {
            return None;
        }
        let density = if config.density_per_m3 > 0.0 { config.density_per_m3 } else { k / ball_count(radius, 1.0) };
        let mut thinning = published_spacing(radius, density);
        if config.max_thinning > 0.0 {
            thinning = thinning.min(config.max_thinning * spacing);
        }
        let given = |value: f64, derived: f64| if value > 0.0 { value } else { derived };
        Some(Self {
            radius,
            k: k as usize,
            spacing: thinning,
            distance: given(config.view_distance_m, working_distance),
            occlusion: given(config.occlusion_search_m, 0.5 * diagonal(scan)),
            probe: given(config.probe_step_m, radius),
            updates: config.updates_per_scan,
        })
    }
}

fn diagonal(points: &[Point3<f64>]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let (low, high) = points.iter().fold((*first, *first), |(l, h), p| (l.inf(p), h.sup(p)));
    (high - low).norm()
}

/// Median number of points in a ball of this radius over the points that lie near the centroid of their ball; a point
/// on a straight edge lies 0.42 r from it.
fn interior_count(points: &[Point3<f64>], radius: f64) -> f64 {
    let mut grid = super::grid::PointGrid::new(radius);
    for (i, p) in points.iter().enumerate() {
        grid.insert(i as u32, *p);
    }
    let mut counts: Vec<usize> = points
        .iter()
        .filter_map(|p| {
            let (mut sum, mut count) = (nalgebra::Vector3::zeros(), 0usize);
            grid.within(p, radius, |_, q, _| {
                sum += q - p;
                count += 1;
                true
            });
            ((sum / count as f64).norm() < 0.2 * radius).then_some(count)
        })
        .collect();
    counts.sort_unstable();
    counts.get(counts.len() / 2).copied().unwrap_or(0) as f64
}

#[cfg(test)]
mod tests;
