//! Settings that a run does not use: whoever gave them expects something of them.

use crate::config::EvaluateConfig;
use crate::config::differences::between;
use crate::policies::Policy;
use datagen::EpisodeConfig;
use datagen::dataset::DatasetName;
use planning::VolumetricConfig;

/// What to tell of settings that have no effect with these policies.
pub(crate) fn note(config: &EvaluateConfig, policies: &[Policy]) -> Option<String> {
    let any = |family: &str| policies.iter().any(|policy| policy.name().starts_with(family));
    if config.dataset.name == DatasetName::Sequences {
        let idle = on_recordings(config, any("auto"));
        return (!idle.is_empty()).then(|| format!("no effect on recorded sequences: {}", idle.join(", ")));
    }
    (config.volumetric != VolumetricConfig::default() && !any("volumetric")).then(|| {
        "[volumetric] has no effect: it is of the policy `volumetric`; `auto` plans as robots do, with its own settings"
            .to_owned()
    })
}

/// Keys of settings that are of the simulator, or of policies that do not run on recordings. Only sessions that plan rank.
fn on_recordings(config: &EvaluateConfig, plans: bool) -> Vec<String> {
    let EvaluateConfig { volumetric, episode, .. } = EvaluateConfig::default();
    let used = EvaluateConfig {
        episode: EpisodeConfig {
            tolerance_m: config.episode.tolerance_m,
            num_views: config.episode.num_views,
            stop_at_full_coverage: config.episode.stop_at_full_coverage,
            ..episode
        },
        volumetric: VolumetricConfig { gain_only: config.volumetric.gain_only && plans, ..volumetric },
        dataset: config.dataset.clone(),
        only: config.only.clone(),
        policies: config.policies.clone(),
        baseline: config.baseline.clone(),
        episodes: config.episodes,
        seed: config.seed,
        views_if_unreached: config.views_if_unreached,
        resamples: config.resamples,
        robot: config.robot.clone(),
        sequences: config.sequences.clone(),
        ..EvaluateConfig::default()
    };
    between(&used, config).into_iter().map(|difference| difference.key).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_recordings_do_not_use_is_named() {
        let of = |set: &[&str], policies: &[&str]| {
            let set: Vec<String> = ["dataset.name=sequences"].iter().chain(set).map(|s| (*s).to_owned()).collect();
            let config: EvaluateConfig = formats::config::load(None, &set, &[]).expect("settings");
            let policies: Vec<Policy> = policies.iter().map(|name| name.parse().expect("a policy")).collect();
            note(&config, &policies)
        };
        let registration = "episode.registration={sigma_t_m=0.01}";
        let simulator =
            ["episode.evidence=depth", registration, "table={}", "episode.working_distance_m=0.5", "seed=3"];
        assert_eq!(
            of(&simulator, &["auto"]).as_deref(),
            Some(
                "no effect on recorded sequences: episode.evidence, episode.registration, episode.working_distance_m, table"
            )
        );
        let gain = ["volumetric.gain_only=true"];
        assert_eq!(of(&gain, &["random", "auto:depth"]), None, "sessions rank by it");
        assert!(of(&gain, &["random"]).is_some_and(|note| note.ends_with(": volumetric.gain_only")));
        let others = of(&["volumetric.novelty=0.5", "volumetric.gain_only=true"], &["auto"]);
        assert!(others.is_some_and(|note| note.ends_with(": volumetric.novelty")));
        let used = ["episode.num_views=7", "episode.tolerance_m=0.001", "sequences.a.tolerance_m=0.002", "resamples=9"];
        assert_eq!(of(&used, &["auto"]), None);
    }

    #[test]
    fn in_the_simulator_volumetric_settings_are_of_volumetric() {
        let config: EvaluateConfig =
            formats::config::load(None, &["volumetric.gain_only=true".to_owned()], &[]).expect("settings");
        let named = |name: &str| -> Policy { name.parse().expect("a policy") };
        assert_eq!(note(&config, &[named("see"), named("volumetric:true")]), None);
        assert!(note(&config, &[named("auto")]).is_some_and(|note| note.starts_with("[volumetric] has no effect")));
    }
}
