//! From a cloud in memory to the pose, warm: `cargo bench -p infer --bench latency [-- CHECKPOINT_DIR]`
//! (without one: the bundled weights).
//!
//! The published code takes 0.39 s per decision at about 5,000 points and 0.8 s at 10,000 (recorded, same task).
#![allow(missing_docs)]

use geometry::{PointCloud, rng};
use nalgebra::{Point3, Vector3};
use planning::{Network, PlannerName, Scan, Session, SessionConfig};
use rand::RngExt;
use std::time::Instant;

/// What a camera at +z sees of a bumpy ball of 0.2 m.
fn cloud(count: usize) -> Vec<Point3<f64>> {
    let mut rng = rng::stream(1, "bench/cloud");
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let v = Vector3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(0.0..1.0f64));
        if (0.1..1.0).contains(&v.norm()) {
            let n = v.normalize();
            points.push(Point3::from(n * (0.1 + 0.01 * (5.0 * n.x).sin() * (4.0 * n.y).cos())));
        }
    }
    points
}

/// Seconds of processor time so far, all threads, in steps of 10 ms (Linux; 0 elsewhere): on a shared machine the only
/// time that means anything.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}

fn main() {
    let weights = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let planner = match &weights {
        Some(directory) => model::NetPlanner::load(directory.as_ref(), Default::default()).expect("a checkpoint"),
        None => model::NetPlanner::bundled(Default::default()).expect("the bundled weights"),
    };
    let network = Network::new(planner);
    println!("{:<12} {:>8} {:>12} {:>12} {:>12}", "planner", "points", "median ms", "worst ms", "mean CPU ms");
    for planner in [PlannerName::Farthest, PlannerName::Volumetric, PlannerName::BenbvNet] {
        for count in [5_000, 10_000, 300_000] {
            let points = cloud(count);
            let from = Some(Point3::new(0.0, 0.0, 1.2));
            let config = SessionConfig { planner, ..Default::default() };
            let inputs: Vec<_> = (0..9).map(|_| points.clone()).collect();
            let cpu = cpu_seconds();
            let mut times: Vec<f64> = inputs
                .into_iter()
                .map(|points| {
                    let cloud = PointCloud { points, normals: Vec::new() };
                    let mut session = Session::new(config.clone(), Some(network.clone())).expect("defaults");
                    let clock = Instant::now();
                    session.add_scan(Scan::Cloud { cloud, from }).expect("a scan");
                    let answer = session.next_view().expect("an answer");
                    assert!(answer.next.is_some(), "a view");
                    1000.0 * clock.elapsed().as_secs_f64()
                })
                .collect();
            let cpu = 1000.0 * (cpu_seconds() - cpu) / times.len() as f64;
            times.sort_by(f64::total_cmp);
            let (median, worst) = (times[times.len() / 2], times[times.len() - 1]);
            println!("{:<12} {count:>8} {median:>12.1} {worst:>12.1} {cpu:>12.1}", planner.as_str());
        }
    }
}
