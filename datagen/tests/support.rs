//! The plane that an object stands on, found in one scan of the simulator.

use datagen::{RenderConfig, RenderScratch, Scene};
use geometry::{Mesh, View};
use nalgebra::{Point3, Vector3};
use planning::config::CameraConfig;
use planning::{NoReturn, Scan, Session, SessionConfig, Support};

/// The object on a table of this side, its top at z = `top`.
fn on_table(object: u64, side: f64) -> (Mesh, f64) {
    let mut mesh = datagen::procedural::mesh(object, 0).normalized(0.2);
    let top = mesh.vertices.iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
    if side == 0.0 {
        return (mesh, top);
    }
    let first = mesh.vertices.len() as u32;
    for corner in 0..8 {
        let at = |bit: u32, low: f64, high: f64| if corner >> bit & 1 == 1 { high } else { low };
        mesh.vertices.push(Point3::new(at(0, -0.5, 0.5) * side, at(1, -0.5, 0.5) * side, at(2, top - 0.01, top)));
    }
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    for [a, b, c, d] in faces.map(|face| face.map(|i| first + i)) {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    (mesh, top)
}

/// What `support = "auto"` finds in one scan from this side: the plane's tilt in degrees and its height, metres.
fn found(scene: &Scene, distance: f64, tilt_deg: f64, around: f64) -> Option<(f64, f64)> {
    let (sin, cos) = tilt_deg.to_radians().sin_cos();
    let position = Point3::from(distance * Vector3::new(cos * around.cos(), cos * around.sin(), sin));
    let pose = View { target: Point3::origin(), position }.world_from_camera();
    let camera = CameraConfig { width: 640, height: 360, ..Default::default() };
    let config = SessionConfig { camera, working_distance_m: distance, support: Support::Auto, ..Default::default() };
    let camera = config.camera.camera();
    let depth = scene.render(&camera, &pose, &RenderConfig::default(), &mut RenderScratch::default()).clone();
    let mut session = Session::new(config, None).expect("settings in range");
    session.add_scan(Scan::Depth { camera, depth, world_from_camera: pose, misses: NoReturn::Free }).expect("a scan");
    let plane = session.support()?;
    Some((Vector3::from(plane.normal).angle(&Vector3::z()).to_degrees(), -plane.height(&Point3::origin())))
}

#[test]
fn the_table_under_an_object_is_found_and_no_face_of_the_object_is() {
    for side in [0.0, 0.3, 1.0] {
        for distance in [0.45, 1.2] {
            let (mut right, mut wrong) = (0, 0);
            for object in 0..10u64 {
                let (mesh, top) = on_table(object, side);
                let scene = Scene::new(mesh);
                for tilt in [20.0, 50.0] {
                    match found(&scene, distance, tilt, 0.4 + object as f64) {
                        Some((off, height)) if side > 0.0 && off < 1.0 && (height - top).abs() < 0.002 => right += 1,
                        Some(_) => wrong += 1,
                        None => {}
                    }
                }
            }
            println!("a table of {side} m from {distance} m: {right} found, {wrong} wrong of 20");
            assert!(
                wrong == 0 && (side == 0.0 || right >= 17),
                "{side} from {distance} m: {right} found, {wrong} wrong"
            );
        }
    }
}
