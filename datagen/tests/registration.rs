//! Registration of scans of the simulator against another program's: Open3D's point-to-plane ICP with Tukey's weights
//! (tests/reference/registration.py), from the same clouds.

use datagen::{RenderConfig, RenderScratch, Scene, procedural};
use geometry::{Neighborhoods, PointCloud, View, estimate_normals, mean_spacing, orient_normals_toward, rng};
use nalgebra::{Isometry3, Matrix4, Point3, Translation3, UnitQuaternion, Vector3};
use planning::registration::{Icp, Model, Moving, PoseError, Registered, RegistrationConfig, register};
use rand::RngExt;
use std::fmt::Write;

const PAIRS: u64 = 10;
const TOLERANCE: f64 = 0.002;

/// A scan of a made-up object, and a second one from 35 degrees beside it, up to 2 mm and 0.4 degrees per axis off.
fn pair(number: u64) -> (PointCloud, PointCloud) {
    let scene = Scene::new(procedural::mesh(17, number).normalized(0.2));
    let scan = |azimuth: f64| {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let position = Point3::from(1.2 * Vector3::new(0.8 * cos, 0.8 * sin, 0.6));
        let view = View { target: Point3::origin(), position };
        let render = RenderConfig { depth_quantum_m: 0.0, ..RenderConfig::default() };
        let camera = geometry::PinholeCamera::default();
        let mut scratch = RenderScratch::default();
        let depth = scene.render(&camera, &view.world_from_camera(), &render, &mut scratch);
        let points = depth.to_points(&camera, &view.world_from_camera());
        let mut cloud = PointCloud { normals: estimate_normals(&points, &Neighborhoods::of(&points, 20), 20), points };
        orient_normals_toward(&mut cloud, &position);
        cloud
    };
    let mut rng = rng::stream(17, &format!("registration/{number}"));
    let mut even = |most: f64| Vector3::from_fn(|_, _| rng.random_range(-most..most));
    let (shift, turn) = (even(0.002), even(0.4f64.to_radians()));
    let off = Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn));
    (scan(0.0), scan(35.0).transformed(&off))
}

fn ours(model: &PointCloud, scan: &PointCloud) -> Registered {
    let model = Model::new(
        model,
        vec![false; model.len()],
        mean_spacing(&model.points, &Neighborhoods::of(&model.points, 2)),
        TOLERANCE,
    );
    let config = RegistrationConfig { kind: Icp::Plain, prior: false, gate: false, ..Default::default() };
    let error = PoseError { sigma_m: 0.002, sigma_rad: 0.3f64.to_radians(), about: None };
    register(Moving { cloud: scan, footprint_m2: 5.4e-6 }, &model, &error, &config)
}

#[test]
fn ten_pairs_end_where_open3d_ends() {
    let text = include_str!("../../tests/data/registration.json");
    let golden: serde_json::Value = serde_json::from_str(text).expect("JSON");
    let golden = golden["pairs"].as_array().expect("a list");
    assert_eq!(golden.len() as u64, PAIRS);
    let mut converged = 0;
    for (number, golden) in (0..PAIRS).zip(golden) {
        let (model, scan) = pair(number);
        let points = [&model, &scan].map(|cloud| serde_json::json!(cloud.len()));
        assert_eq!(golden["points"], serde_json::json!(points), "pair {number}: other clouds; run the script again");
        let rows: [[f64; 4]; 4] = serde_json::from_value(golden["correction"].clone()).expect("a matrix");
        let theirs: Isometry3<f64> =
            nalgebra::try_convert(Matrix4::from_fn(|r, c| rows[r][c])).expect("a rigid motion");
        let found = ours(&model, &scan);
        let left = found.correction * theirs.inverse();
        let (apart, turned) = (left.translation.vector.norm() * 1e3, left.rotation.angle().to_degrees());
        println!("pair {number}: {apart:.4} mm, {turned:.4} degrees apart, converged: {}", found.converged);
        if found.converged {
            converged += 1;
            assert!(apart < 0.1 && turned < 0.01, "pair {number}: {apart} mm, {turned} degrees apart");
        }
    }
    assert!(converged >= 9, "{converged} of ten");
}

/// Writes the pairs for the script: `REGISTRATION_PAIRS=DIR cargo test -p datagen --test registration -- --ignored`.
#[test]
#[ignore = "writes the input of tests/reference/registration.py"]
fn write_the_pairs() {
    let folder = std::env::var("REGISTRATION_PAIRS").expect("REGISTRATION_PAIRS=DIR");
    for number in 0..PAIRS {
        let (model, scan) = pair(number);
        for (name, cloud) in [("model", &model), ("scan", &scan)] {
            let mut text = String::new();
            for (p, n) in cloud.points.iter().zip(&cloud.normals) {
                let _ = writeln!(text, "{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z);
            }
            std::fs::write(format!("{folder}/{number}-{name}.txt"), text).expect("a folder to write to");
        }
    }
}
