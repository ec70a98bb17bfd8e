//! The cell of docs/robots.md, 'A complete cell, from the first scan to a mesh': an arm, a turntable, a table, with one command.

use formats::mesh::read_mesh;
use formats::urdf::read_urdf;
use geometry::{Mesh, View};
use nalgebra::{Isometry3, Matrix4, Point3};
use planning::{Reach, Session, SessionConfig, TurntableConfig};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

const OBJECT: &str = "procedural:3";

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples").join(name)
}

/// One line per view, and the summary.
fn run(arguments: &[&str]) -> Vec<Value> {
    let output = Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--object", OBJECT, "--views", "12", "--json"])
        .args(arguments)
        .output()
        .expect("infer runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8_lossy(&output.stdout).into_owned();
    lines.lines().map(|line| serde_json::from_str(line).expect("a step")).collect()
}

fn pose(value: &Value) -> Isometry3<f64> {
    let entry = |row: usize, column: usize| value["matrix"][row][column].as_f64().expect("a number");
    nalgebra::try_convert(Matrix4::from_fn(entry)).expect("rigid")
}

/// Edges that one triangle alone has.
fn rim_length(mesh: &Mesh) -> f64 {
    let mut edges: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.iter_mut().for_each(|edge| edge.sort_unstable());
    edges.sort_unstable();
    let ends = edges
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() == 1)
        .map(|same| same[0].map(|i| mesh.vertices[i as usize]));
    ends.map(|[a, b]| (a - b).norm()).sum()
}

#[test]
fn from_an_empty_table_to_a_mesh() {
    let folder = tempfile::tempdir().expect("a folder");
    let mesh_file = folder.path().join("part.ply").display().to_string();
    let [cell, urdf] = ["cell/cell.toml", "robots/ur5e.urdf"].map(|name| sample(name).display().to_string());
    let with_arm = run(&["--config", &cell, "--robot", &urdf, "--tool", "tool0", "--mesh", &mesh_file]);
    let (views, within_reach) = with_arm.split_at(with_arm.len() - 1);

    // What the camera can reach at all is covered.
    let share = |key: &str| within_reach[0][key].as_f64().expect("a share");
    println!(
        "within reach: {:.3} of the views, {:.3} of the surface, {:.4} of it covered",
        share("views"),
        share("surface"),
        share("coverage")
    );
    assert!(share("views") > 0.3 && share("surface") > 0.9 && share("coverage") >= 0.99, "{within_reach:?}");

    // The arm was at every view: by forward kinematics, within its limits, and clear of the object as it really is.
    let text = std::fs::read_to_string(&cell).expect("a file");
    let settings = |arm: &str| -> SessionConfig { toml::from_str(&text.replace("[robot]", arm)).expect("settings") };
    let arm = read_urdf(&sample("robots/ur5e.urdf"), "tool0").expect("an arm").arm;
    let arm = format!("[robot]\narm = {}", toml::Value::try_from(&arm).expect("a table"));
    let config = settings(&arm);
    let (robot, table) = (config.robot.clone().expect("an arm"), config.turntable.clone().expect("a table"));
    let reach = Reach::new(&robot);
    let object = datagen::procedural::mesh(3, 0).normalized(0.2);
    for view in &views[1..] {
        let joints: Vec<f64> =
            view["reached"]["joints"].as_array().expect("joints").iter().filter_map(|j| j["value"].as_f64()).collect();
        let limits = reach.limits().iter().zip(&joints);
        assert!(
            limits.clone().count() == 6 && limits.into_iter().all(|([low, high], q)| low <= q && q <= high),
            "{view}"
        );
        let mut values = reach.home();
        values.iter_mut().zip(&joints).for_each(|(to, from)| *to = *from);
        let cell_from_object = table.cell_from_object(view["table_stop_deg"].as_f64().expect("a stop"));
        let camera = cell_from_object * pose(&view["world_from_camera"]);
        let off = reach.camera(&values);
        assert!((off.translation.vector - camera.translation.vector).norm() < 1e-4, "{view}");
        assert!(off.rotation.angle_to(&camera.rotation) < 1e-3, "{view}");
        for frame in reach.frames(&values) {
            let at = Point3::from(frame.translation.vector);
            let clear =
                object.vertices.iter().map(|v| (cell_from_object * v - at).norm()).fold(f64::INFINITY, f64::min);
            assert!(clear > 0.05, "{clear} m from the object: {view}");
        }
    }

    // The mesh lies on the object, and ends nowhere but where the object stands.
    let mesh = read_mesh(Path::new(&mesh_file)).expect("a mesh");
    let truth = geometry::sampling::poisson_disk_sample(&object, 60_000, &mut geometry::rng::stream(0, "truth"))
        .expect("samples");
    let grid = geometry::NeighborGrid::new(&truth, 0.004);
    let mut off: Vec<f64> =
        mesh.vertices.iter().map(|v| f64::from(grid.nearest(v).expect("a sample").distance2).sqrt()).collect();
    off.sort_by(f64::total_cmp);
    let [median, most] = [off[off.len() / 2], off[off.len() * 99 / 100]];
    println!(
        "mesh: {} triangles, {:.2} mm off in the median, {:.2} mm at the 99th percentile; area {:.4} of {:.4} m2, rim {:.3} m",
        mesh.triangles.len(),
        1e3 * median,
        1e3 * most,
        mesh.area(),
        object.area(),
        rim_length(&mesh)
    );
    assert!(median < 1e-3 && most < 3e-3);
    assert!((mesh.area() / object.area() - 1.0).abs() < 0.06);

    // Without the arm in the loop, it could not get to many of the views.
    let bare = text.lines().filter(|line| {
        !["[robot]", "cell_from_base", "flange_from", "travel_w"].iter().any(|key| line.starts_with(key))
    });
    let without = folder.path().join("without.toml");
    std::fs::write(&without, bare.collect::<Vec<_>>().join("\n")).expect("a file");
    let without = run(&["--config", &without.display().to_string()]);
    let refused = without[1..without.len() - 1].iter().filter(|view| {
        let pose = pose(&view["world_from_camera"]);
        let at = View { target: pose * Point3::new(0.0, 0.0, 0.45), position: Point3::from(pose.translation.vector) };
        let stop = view["table_stop_deg"].as_f64().expect("a stop");
        let table = TurntableConfig { stops_deg: vec![stop], range_deg: None, ..table.clone() };
        let session = Session::new(SessionConfig { turntable: Some(table), ..config.clone() }, None).expect("settings");
        !session.place(&at).objections.is_empty()
    });
    let (refused, proposed) = (refused.count(), without.len() - 2);
    println!("without the arm in the loop: {refused} of {proposed} views that it cannot take");
    assert!(refused * 4 > proposed, "{refused} of {proposed}");
}
