use super::*;
use crate::testing::{ball, ball_samples};
use crate::{Episode, EpisodeConfig, RenderConfig, Scene, procedural, run_episode};
use geometry::rng::stream;
use geometry::sampling::poisson_disk_sample;
use nalgebra::{UnitQuaternion, Vector3};
use planning::planners::farthest::Distance;
use planning::{FarthestPlanner, PlanError, Planner, RankedView};
use rand_chacha::ChaCha8Rng;

fn config(registration: EpisodeRegistration) -> EpisodeConfig {
    let render = RenderConfig { depth_quantum_m: 1e-4, ..RenderConfig::default() };
    EpisodeConfig { num_views: 5, render, registration: Some(registration), ..EpisodeConfig::default() }
}

fn ungated() -> EpisodeRegistration {
    EpisodeRegistration { gate: false, prior: false, ..Default::default() }
}

/// Goes to the other side of the object, where nothing known is in view.
fn run(scene: &Scene, samples: &[Point3<f64>], config: &EpisodeConfig) -> Episode {
    let direction = |i: u32| {
        let (z, turn) = (1.0 - (2.0 * f64::from(i) + 1.0) / 40.0, 2.4 * f64::from(i));
        Vector3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
    };
    let directions = (0..40).map(direction).collect();
    let mut planner = FarthestPlanner::on_sphere("farthest", directions, Distance::Beyond(0.0), Point3::origin());
    run_episode(scene, samples, &mut planner, config, &mut stream(6, "registration")).expect("an episode")
}

fn lump() -> (Scene, Vec<Point3<f64>>) {
    let mesh = procedural::mesh(5, 2).normalized(0.2);
    let samples = poisson_disk_sample(&mesh, 10_000, &mut stream(1, "samples")).expect("samples");
    (Scene::new(mesh), samples)
}

#[test]
fn errors_are_drawn_by_view_and_the_first_scan_has_none() {
    let mut errors = Displacements::new(EpisodeRegistration::default(), 9);
    let all: Vec<_> = (0..4).map(|_| errors.next()).collect();
    assert_eq!(all[0], Isometry3::identity());
    assert_ne!(all[1], all[2]);
    errors.restart();
    assert_eq!((0..4).map(|_| errors.next()).collect::<Vec<_>>(), all);
    assert_ne!(Displacements::new(EpisodeRegistration::default(), 10).next_two(), all[1]);
    let squared: f64 = (0..300)
        .map(|key| Displacements::new(EpisodeRegistration::default(), key).next_two().translation.vector.norm_squared())
        .sum();
    assert!(((squared / 300.0 / 3.0).sqrt() / 0.002 - 1.0).abs() < 0.1, "2 mm per axis");
}

impl Displacements {
    fn next_two(&mut self) -> Isometry3<f64> {
        self.next();
        self.next()
    }
}

#[test]
fn scans_with_something_to_hold_them_come_back() {
    let (scene, samples) = lump();
    let config = config(ungated());
    let episode =
        || run_episode(&scene, &samples, &mut Round, &config, &mut stream(6, "registration")).expect("an episode");
    let outcome = episode().registration.expect("registered");
    assert_eq!(outcome.views.len(), 5);
    for (view, overlap) in outcome.views.iter().zip(&episode().overlaps) {
        assert!(view.given_m > 5e-4, "it was off: {view:?}");
        assert!(view.like_overlap <= overlap.expect("not empty") + 1e-9, "{view:?}");
        let left = view.left_m.expect("merged");
        assert!(view.lambda > 12.0 && left < 8e-4, "held well: {view:?}");
        // Of the whole surface, where `left_m` is of what the scan shows.
        let squared = |p: &Point3<f64>| (view.placed_from_true * p - p).norm_squared();
        let all = (samples.iter().map(squared).sum::<f64>() / samples.len() as f64).sqrt();
        assert!((0.6..1.7).contains(&(all / left)), "{all} of all, {left} of the scan");
    }
    assert!(outcome.left_m < 8e-4 && outcome.off_share == 0.0, "{outcome:?}");
    assert_eq!(episode(), episode(), "the same again");
}

/// Goes round the object in steps of 25 degrees, from where it was scanned last.
struct Round;

impl Planner for Round {
    fn name(&self) -> &str {
        "round"
    }

    fn rank_views(&mut self, state: &ScanState, _: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let last = state.scans.last().expect("a scan").world_from_camera.translation.vector;
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 25f64.to_radians()) * last;
        let view = View { target: Point3::origin(), position: Point3::from(turned) };
        Ok(vec![RankedView::scored(view, 0.0)])
    }
}

#[test]
fn without_registration_nothing_is_recorded_or_drawn() {
    let (scene, samples) = lump();
    let plain = run(&scene, &samples, &EpisodeConfig { registration: None, ..config(ungated()) });
    assert_eq!(plain.registration, None);
    let json = serde_json::to_string(&plain).expect("JSON");
    assert!(!json.contains("registration"), "the record is what it was");
    let text = toml::to_string(&EpisodeConfig::default()).expect("TOML");
    assert!(!text.contains("registration"), "and so are the settings, and their hash");
    let registered = run(&scene, &samples, &config(ungated()));
    assert_eq!(registered.views[0], plain.views[0], "both start from the same view");
}

#[test]
fn a_ball_registers_nothing_and_the_gate_says_so() {
    // Every turn about the centre is free, and two degrees of it are too much: what is refused costs its view.
    let scene = Scene::new(ball());
    let registration = EpisodeRegistration { sigma_theta_deg: 2.0, ..Default::default() };
    let gated = run(&scene, &ball_samples(), &config(registration));
    let outcome = gated.registration.expect("registered");
    assert!(outcome.views.iter().all(|v| v.refused.is_some() && v.left_m.is_none()), "{outcome:?}");
    assert!(outcome.views.iter().all(|v| v.lambda < 0.5 && v.expected_lambda < 0.5), "{outcome:?}");
    assert!(gated.coverages.iter().all(|&c| c == gated.coverages[0]));
    assert_eq!((outcome.left_m, outcome.off_share), (0.0, 0.0), "nothing wrong was merged");
    let apart = |a: &View, b: &View| (a.position - b.position).norm();
    assert!(gated.views[1..].windows(2).all(|w| apart(&w[0], &w[1]) > 0.15), "no view is tried twice in a row");
}

#[test]
fn a_rule_on_lambda_keeps_scans_registrable() {
    let (scene, samples) = lump();
    let least = |rule| {
        let registration = EpisodeRegistration { registrability: rule, ..ungated() };
        let outcome = run(&scene, &samples, &config(registration)).registration.expect("registered");
        outcome.views.iter().map(|v| v.expected_lambda).fold(f64::INFINITY, f64::min)
    };
    let (free, kept) = (least(Registrability::Off), least(Registrability::Lambda));
    assert!(kept > free, "{kept} against {free}");
}

#[test]
fn settings_that_contradict_each_other_are_refused() {
    let wrong = |change: fn(&mut EpisodeConfig)| {
        let mut config = config(EpisodeRegistration::default());
        change(&mut config);
        config.validate().expect_err("contradicts").to_string()
    };
    assert!(wrong(|c| c.pose_error = Some(Default::default())).contains("episode.registration"));
    assert!(wrong(|c| c.accumulate = Accumulate::Matched).contains("as measured"));
    assert!(wrong(|c| c.evidence = crate::EpisodeEvidence::Merged).contains("as measured"));
    let zero = Some(EpisodeRegistration { sigma_t_m: 0.0, ..Default::default() });
    assert!(wrong_with(zero).contains("sigma_t_m"));
}

fn wrong_with(registration: Option<EpisodeRegistration>) -> String {
    EpisodeConfig { registration, ..EpisodeConfig::default() }.validate().expect_err("no error at all").to_string()
}
