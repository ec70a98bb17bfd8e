//! What a simulated camera, its noise and the error of its pose can be set to.

use crate::noise::NoiseConfig;
use crate::pose_error::PoseErrorConfig;
use crate::scene::RenderConfig;
use formats::config::SettingError;

/// Refuses a depth range, a quantum or a noise that no sensor has.
pub(super) fn check_render(render: &RenderConfig) -> Result<(), SettingError> {
    check_from_0(&[
        ("episode.render.near_m", render.near_m),
        ("episode.render.depth_quantum_m", render.depth_quantum_m),
    ])?;
    if !(render.far_m > render.near_m && render.far_m.is_finite()) {
        return Err(SettingError::new("episode.render.far_m", render.far_m, "a length above near_m"));
    }
    // Depths are counted in whole quanta.
    if render.depth_quantum_m > 0.0 && render.far_m / render.depth_quantum_m > f64::from(u32::MAX) {
        let expected = "0 (not rounded), or at least far_m / 4,294,967,295";
        return Err(SettingError::new("episode.render.depth_quantum_m", render.depth_quantum_m, expected));
    }
    render.noise.as_ref().map_or(Ok(()), check_noise)
}

fn check_noise(noise: &NoiseConfig) -> Result<(), SettingError> {
    if !(noise.axial_distance_m > 0.0 && noise.axial_distance_m.is_finite()) {
        let key = "episode.render.noise.axial_distance_m";
        return Err(SettingError::new(key, noise.axial_distance_m, "a length above 0"));
    }
    if !(0.0..=1.0).contains(&noise.edge_dropout) {
        let key = "episode.render.noise.edge_dropout";
        return Err(SettingError::new(key, noise.edge_dropout, "a probability from 0 to 1"));
    }
    check_from_0(&[
        ("episode.render.noise.axial_sigma_m", noise.axial_sigma_m),
        ("episode.render.noise.lateral_sigma_px", noise.lateral_sigma_px),
        ("episode.render.noise.grazing_from_deg", noise.grazing_from_deg),
        ("episode.render.noise.edge_step_m", noise.edge_step_m),
    ])
}

/// Refuses deviations below 0.
pub(super) fn check_pose_error(error: &PoseErrorConfig) -> Result<(), SettingError> {
    check_from_0(&[
        ("episode.pose_error.reach_sigma_m", error.reach_sigma_m),
        ("episode.pose_error.reach_sigma_deg", error.reach_sigma_deg),
        ("episode.pose_error.drift_sigma_m", error.drift_sigma_m),
        ("episode.pose_error.drift_sigma_deg", error.drift_sigma_deg),
    ])
}

fn check_from_0(values: &[(&'static str, f64)]) -> Result<(), SettingError> {
    match values.iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
        Some((key, found)) => Err(SettingError::new(key, found, "a number of 0 or above")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use crate::{EpisodeConfig, NoiseConfig, PoseErrorConfig, RenderConfig};

    fn refused(change: impl FnOnce(&mut EpisodeConfig)) -> String {
        let mut config = EpisodeConfig::default();
        change(&mut config);
        config.validate().expect_err("refused").to_string()
    }

    #[test]
    fn what_no_sensor_measures_is_refused_by_name() {
        let render = |render: RenderConfig| refused(|c| c.render = render);
        let of = RenderConfig::default;
        assert!(render(RenderConfig { near_m: -0.1, ..of() }).starts_with("episode.render.near_m = -0.1"));
        for far_m in [0.01, f64::NAN, f64::INFINITY] {
            assert!(render(RenderConfig { far_m, ..of() }).starts_with("episode.render.far_m = "), "{far_m}");
        }
        for depth_quantum_m in [-0.001, f64::NAN, 1e-10] {
            let text = render(RenderConfig { depth_quantum_m, ..of() });
            assert!(text.starts_with("episode.render.depth_quantum_m = "), "{text}");
        }
        let noise = |noise: NoiseConfig| refused(|c| c.render.noise = Some(noise));
        let of = NoiseConfig::default;
        for (text, key) in [
            (noise(NoiseConfig { axial_sigma_m: -0.001, ..of() }), "axial_sigma_m"),
            (noise(NoiseConfig { axial_distance_m: 0.0, ..of() }), "axial_distance_m"),
            (noise(NoiseConfig { axial_distance_m: f64::NAN, ..of() }), "axial_distance_m"),
            (noise(NoiseConfig { lateral_sigma_px: f64::NAN, ..of() }), "lateral_sigma_px"),
            (noise(NoiseConfig { grazing_from_deg: f64::NAN, ..of() }), "grazing_from_deg"),
            (noise(NoiseConfig { edge_dropout: 1.5, ..of() }), "edge_dropout"),
            (noise(NoiseConfig { edge_step_m: -1.0, ..of() }), "edge_step_m"),
        ] {
            assert!(text.starts_with(&format!("episode.render.noise.{key} = ")), "{text}");
        }
        let error = PoseErrorConfig { drift_sigma_m: f64::NAN, ..PoseErrorConfig::default() };
        assert!(refused(|c| c.pose_error = Some(error)).starts_with("episode.pose_error.drift_sigma_m = NaN"));
    }

    #[test]
    fn the_sensors_of_the_defaults_are_not() {
        let unrounded =
            RenderConfig { depth_quantum_m: 0.0, noise: Some(NoiseConfig::axial(0.001)), ..RenderConfig::paper() };
        let pose_error = Some(PoseErrorConfig::default());
        EpisodeConfig { render: unrounded, pose_error, ..EpisodeConfig::paper() }.validate().expect("in range");
        EpisodeConfig::default().validate().expect("in range");
    }
}
