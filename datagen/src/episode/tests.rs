use super::*;
use crate::search::{SearchConfig, SearchPlanner};
use crate::testing::{ball, ball_samples};
use formats::sequence::{Sequence, SequenceScan};
use geometry::rng::stream;
use nalgebra::Vector3;

/// Offers the same views again and again.
struct Fixed(Vec<View>);

impl Planner for Fixed {
    fn name(&self) -> &str {
        "fixed"
    }

    fn rank_views(&mut self, _: &ScanState, _: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let ranked = |&view: &View| RankedView::scored(view, 0.0);
        Ok(self.0.iter().map(ranked).collect())
    }
}

fn short(config: EpisodeConfig) -> EpisodeConfig {
    EpisodeConfig { num_views: 6, ..config }
}

#[test]
fn the_search_covers_a_ball_and_repeats() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    for config in [EpisodeConfig::default(), EpisodeConfig::paper()].map(short) {
        let run = || {
            let mut planner = SearchPlanner::new(&scene, &samples, SearchConfig::of(&config, Default::default()));
            run_episode(&scene, &samples, &mut planner, &config, &mut stream(1, "episode")).unwrap()
        };
        let episode = run();
        assert!(episode.final_coverage() > 0.9, "{:?}", episode.coverages);
        assert!(episode.coverages.windows(2).all(|w| w[1] > w[0] - 1e-3), "{:?}", episode.coverages);
        assert_eq!(episode.views.len(), episode.coverages.len());
        assert_eq!(episode.overlaps.len() + 1, episode.views.len());
        assert!(episode.distances.chamfer < 0.001 && episode.distances.hausdorff < 0.05, "{:?}", episode.distances);
        assert_eq!(episode, run(), "same seed, same episode");
    }
}

#[test]
fn threads_do_not_change_an_episode() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let config = short(EpisodeConfig::default());
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut planner = SearchPlanner::new(&scene, &samples, SearchConfig::of(&config, Default::default()));
            run_episode(&scene, &samples, &mut planner, &config, &mut stream(2, "episode")).unwrap()
        })
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn the_same_view_again_adds_nothing_and_overlaps_wholly() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let config = short(EpisodeConfig::default());
    let view = initial_view(&config, &mut {
        let mut rng = stream(3, "episode");
        let _: u64 = rng.random();
        rng
    });
    let mut decisions = Vec::new();
    let episode = run_episode_with(
        &scene,
        &samples,
        &mut Fixed(vec![view]),
        &config,
        &mut stream(3, "episode"),
        |planner, decision| {
            assert_eq!(planner.name(), "fixed");
            assert_eq!(decision.state.num_scans, decision.index + 1);
            assert_eq!(decision.state.scans.len(), decision.index + 1);
            decisions.push(decision.current_coverage);
        },
    )
    .unwrap();
    assert_eq!(episode.views, vec![view; 7]);
    assert_eq!(decisions, episode.coverages[..6]);
    assert!(episode.overlaps.iter().all(|o| o.unwrap() > 0.999), "{:?}", episode.overlaps);
    assert!(episode.final_coverage() < 0.5);
    assert_eq!(episode.views_to(0.9), None);
}

#[test]
fn empty_scans_use_up_a_step_and_no_view_ends() {
    let scene = Scene::new(ball());
    let samples = ball_samples();
    let config = short(EpisodeConfig::default());
    let away = View { target: Point3::new(5.0, 0.0, 0.0), position: Point3::new(1.0, 0.0, 0.0) };
    let nowhere = View { target: Point3::origin(), position: Point3::origin() };
    for view in [away, nowhere] {
        let episode =
            run_episode(&scene, &samples, &mut Fixed(vec![view]), &config, &mut stream(4, "episode")).unwrap();
        assert_eq!(episode.overlaps, vec![None; 6]);
        assert!(episode.coverages.iter().all(|&c| c == episode.coverages[0]));
        assert_eq!(episode.end, End::AllViews);
    }
    let ended = run_episode(&scene, &samples, &mut Fixed(vec![]), &config, &mut stream(4, "episode")).unwrap();
    assert_eq!((ended.end, ended.views.len(), ended.overlaps.len()), (End::NoView, 1, 0));
}

#[test]
fn an_object_that_is_not_seen_is_void_and_says_so() {
    let config = EpisodeConfig { max_draws: 4, ..EpisodeConfig::default() };
    let void = run_episode(
        &Scene::new(ball().normalized(0.001)),
        &ball_samples(),
        &mut Fixed(vec![]),
        &config,
        &mut stream(5, "episode"),
    )
    .unwrap_err();
    let EpisodeError::Void(void) = void else { panic!("{void}") };
    assert_eq!(void.draws, 4);
    assert!(void.to_string().contains("wanted 50"), "{void}");
    assert!(
        run_episode(&Scene::new(Default::default()), &[], &mut Fixed(vec![]), &config, &mut stream(5, "e")).is_err()
    );
}

#[test]
fn more_points_than_the_reference_are_void_as_published_alone() {
    let (scene, samples) = (Scene::new(ball()), ball_samples());
    // So near that pixels are closer together than the samples.
    let near = |config| EpisodeConfig { num_views: 1, max_draws: 3, working_distance_m: 0.18, ..config };
    let run =
        |config: &EpisodeConfig| run_episode(&scene, &samples, &mut Fixed(vec![]), config, &mut stream(6, "episode"));
    let episode = run(&near(EpisodeConfig::default())).unwrap();
    assert!(episode.scan_points[0] > episode.num_reference && episode.coverages[0] > 0.05, "{:?}", episode.coverages);
    let text = run(&near(EpisodeConfig::paper())).expect_err("void").to_string();
    assert!(text.contains("more points than the reference") && text.contains("raise surface_samples"), "{text}");
}

#[test]
fn configurations_refuse_unknown_keys() {
    let text = toml::to_string(&EpisodeConfig::paper()).unwrap();
    assert_eq!(toml::from_str::<EpisodeConfig>(&text).unwrap(), EpisodeConfig::paper());
    assert!(toml::from_str::<EpisodeConfig>("working_distance = 1.0").is_err());
}

/// Strips of a plane side by side, each scanned from above its middle; the last one is the first again.
fn strips() -> Recording {
    let scan = |i: usize| {
        let x = 0.01 * (i % 3) as f64;
        let points = (0..400).map(|k| Point3::new(x + 0.0005 * f64::from(k % 20), 0.0005 * f64::from(k / 20), 0.0));
        let position = Point3::new(x + 0.005, 0.005, 1.0);
        let view = View { target: Point3::new(position.x, position.y, 0.0), position };
        SequenceScan { points: points.collect(), world_from_camera: view.world_from_camera(), image: None }
    };
    Recording::new(
        Sequence {
            up: Vector3::y(),
            working_distance_m: 1.0,
            tolerance_m: Some(0.0006),
            region_m: None,
            background: None,
            scans: (0..4).map(scan).collect(),
        },
        0.002,
    )
}

#[test]
fn a_recording_is_scanned_once_each_and_covered_by_all() {
    let recording = strips();
    let views = recording.views().to_vec();
    let config = EpisodeConfig { num_views: 9, ..EpisodeConfig::default() };
    let run = |start, evidence| {
        let stage = Stage::Recorded { recording: &recording, start, evidence };
        let session = Session::new(recording.session_config(EpisodeEvidence::CameraPositions), None).unwrap();
        // Whatever is best first, and a view of nobody's before all.
        let foreign = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 2.0) };
        let decide = |_: &mut Session, _: &Progress, _: &mut ChaCha8Rng| {
            let all = [foreign].into_iter().chain(views.iter().copied());
            Ok(all.map(|view| RankedView::scored(view, 0.0)).collect())
        };
        run_session(stage, session, &config, &mut stream(1, "recorded"), decide).unwrap()
    };
    for evidence in [None, Some(EpisodeEvidence::CameraPositions), Some(EpisodeEvidence::Clouds)] {
        let (episode, session) = run(1, evidence);
        // The second strip, then the first, the first again, and the third.
        assert_eq!(episode.views, [views[1], views[0], views[3], views[2]]);
        assert_eq!((episode.end, episode.final_coverage()), (End::NoView, 1.0));
        let expected = [1.0, 2.0, 2.0, 3.0].map(|n| n / 3.0);
        for (found, expected) in episode.coverages.iter().zip(expected) {
            assert!((found - expected).abs() < 0.04, "{:?}", episode.coverages);
        }
        assert!(episode.overlaps[0].unwrap() < 0.1 && episode.overlaps[1] == Some(1.0), "{:?}", episode.overlaps);
        assert_eq!(session.num_scans(), if evidence.is_some() { 4 } else { 0 }, "the session is told what it may know");
    }
    assert!(!recording.has(EpisodeEvidence::Depth) && recording.has(EpisodeEvidence::Clouds));
}
