use super::*;
use geometry::{PointCloud, rng::stream};
use nalgebra::{Point3, Vector3};
use planning::candidate_views;

/// A bumpy open sheet of 600 points, seen from above.
fn state() -> ScanState {
    let mut cloud = PointCloud::default();
    for i in 0..600 {
        let (x, y) = (f64::from(i % 30) * 0.003, f64::from(i / 30) * 0.003);
        cloud.points.push(Point3::new(x, y, 0.01 * (40.0 * x).sin() * (30.0 * y).cos()));
        cloud.normals.push(Vector3::new(-0.1 * (x * 50.0).cos(), 0.05, 1.0).normalize());
    }
    ScanState { cloud, num_scans: 2, grid_size: 0.003, working_distance: 0.5, ..ScanState::default() }
}

fn planner(encode: EncodeConfig) -> NetPlanner {
    let config = BenbvNetConfig::tiny();
    let device = Device::flex();
    device.seed(3);
    let info = Checkpoint::new::<BenbvNet>(config.clone(), encode);
    NetPlanner::new(config.init(&device).materialize(), info, NetPlannerConfig::default())
}

#[test]
fn ranks_candidates_best_first_and_repeats() {
    let mut planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
    let rank = |planner: &mut NetPlanner| planner.rank_views(&state(), &mut stream(1, "test")).expect("views");
    let ranked = rank(&mut planner);
    assert!(ranked.len() > 3, "the sheet has a boundary: {}", ranked.len());
    assert!(ranked.windows(2).all(|w| w[0].score >= w[1].score));
    assert!(ranked.iter().all(|r| r.score > 0.0 && r.score < 1.0));
    assert_eq!(ranked, rank(&mut planner), "same stream, same ranking");
}

#[test]
fn what_cannot_be_ranked_is_an_error_that_says_why() {
    let mut planner = planner(EncodeConfig::default());
    let nothing = planner.rank_views(&ScanState::default(), &mut stream(1, "test"));
    assert_eq!(nothing, Err(PlanError::NoBoundary));
    let state = state();
    let candidates =
        candidate_views(&state.cloud, &state.neighborhoods(30), 0.5, &CandidateConfig::default(), &mut stream(1, "t"));
    let mut broken = state;
    broken.cloud.points[7].x = f64::NAN;
    let error = planner.rank(&candidates, &broken, &mut stream(1, "t")).unwrap_err();
    assert_eq!(error.to_string(), "point 7 is not finite; remove such points first");
}

#[test]
fn a_network_that_answers_nan_fails_and_is_not_at_its_end() {
    let mut planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
    planner.net = planner.net.clone().map(&mut Poison);
    let error = planner.rank_views(&state(), &mut stream(1, "test")).expect_err("NaN");
    assert!(!error.is_end(), "{error}");
    assert_eq!(error.to_string(), "planner benbv-net failed: a view was scored NaN");
}

/// Every weight becomes NaN.
struct Poison;

impl burn::module::ModuleMapper for Poison {
    fn map_float<const D: usize>(
        &mut self,
        param: burn::module::Param<burn::tensor::Tensor<D>>,
    ) -> burn::module::Param<burn::tensor::Tensor<D>> {
        param.map(|weights| weights * f32::NAN)
    }
}

#[test]
fn cloud_normalisation_ignores_translation_and_unit() {
    let planner = planner(EncodeConfig { points: 128, ..EncodeConfig::default() });
    let state = state();
    let candidates =
        candidate_views(&state.cloud, &state.neighborhoods(30), 0.5, &CandidateConfig::default(), &mut stream(1, "t"));
    let scores = |scale: f64, shift: Vector3<f64>| {
        let place = |p: &Point3<f64>| Point3::from(p.coords * scale + shift);
        let mut moved = state.clone();
        moved.cloud.points.iter_mut().for_each(|p| *p = place(p));
        let mut candidates = candidates.clone();
        for c in &mut candidates {
            c.view.target = place(&c.view.target);
            c.view.position = place(&c.view.position);
            c.density /= scale;
        }
        let observation = Observation {
            cloud: &moved.cloud,
            candidates: &candidates,
            view_order: 1,
            working_distance: 0.5 * scale,
            cameras: Vec::new(),
        };
        planner.score(&observation, &mut stream(1, "score")).unwrap()
    };
    let still = scores(1.0, Vector3::zeros());
    for (a, b) in still.iter().zip(scores(1000.0, Vector3::new(50.0, -20.0, 7.0))) {
        assert!((a - b).abs() < 1e-5, "{a} became {b}");
    }
}
