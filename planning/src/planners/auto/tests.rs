use super::*;
use crate::PastScan;

fn state(seen: Vec<Seen>, num_scans: usize) -> ScanState {
    let scans = seen
        .into_iter()
        .map(|seen| {
            PastScan { world_from_camera: Default::default(), seen, pose: Default::default(), veil: None }.into()
        })
        .collect();
    ScanState { scans, num_scans, ..Default::default() }
}

fn depth(misses: NoReturn) -> Seen {
    Seen::Depth { camera: Default::default(), depth: Default::default(), misses }
}

#[test]
fn the_weakest_scan_decides() {
    let free = || depth(NoReturn::Free);
    assert_eq!(Evidence::of(&state(vec![free(), free()], 2)), Evidence::DepthWithBackground, "all carve");
    assert_eq!(Evidence::of(&state(vec![free(), depth(NoReturn::Unknown)], 2)), Evidence::Depth, "one is unsure");
    assert_eq!(Evidence::of(&state(vec![Seen::Points(vec![]), free()], 2)), Evidence::CameraPositions, "points");
    assert_eq!(Evidence::of(&state(vec![free()], 2)), Evidence::Unplaced, "one camera is unknown");
    assert_eq!(Evidence::of(&state(vec![], 1)), Evidence::Unplaced, "no camera is known");
}

#[test]
fn auto_takes_the_best_and_says_why() {
    let auto = |evidence, network| choose(PlannerName::Auto, evidence, network).expect("auto always finds one");
    for evidence in [Evidence::DepthWithBackground, Evidence::Depth, Evidence::CameraPositions, Evidence::Clouds] {
        for network in [false, true] {
            assert_eq!(auto(evidence, network).planner, PlannerName::Volumetric, "{evidence:?}");
        }
    }
    assert_eq!(
        auto(Evidence::Unplaced, true).planner,
        PlannerName::BenbvNet,
        "no camera can be estimated: the network"
    );
    let fallback = auto(Evidence::Unplaced, false);
    assert_eq!(fallback.planner, PlannerName::Farthest, "no weights: directions");
    assert!(fallback.why.contains("no network"), "{}", fallback.why);
}

#[test]
fn what_cannot_work_is_refused_with_the_way_out() {
    let refused = |asked, evidence, network| choose(asked, evidence, network).expect_err("must refuse").to_string();
    assert!(refused(PlannerName::Volumetric, Evidence::Unplaced, true).contains("--from"));
    assert!(refused(PlannerName::BenbvNet, Evidence::Depth, false).contains("--weights"));
    let choice = choose(PlannerName::Farthest, Evidence::Depth, true).expect("farthest always works");
    assert_eq!(choice.planner, PlannerName::Farthest, "what is asked for is taken");
}
