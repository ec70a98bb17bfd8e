//! The planner's areas against parry's rays, which share no code with it: samples of a box, a ball and a torus, each of which
//! stands for the same area, are in a view where the ray from its camera to them meets nothing before.

mod rays;

use datagen::{RenderConfig, RenderScratch, Scene};
use geometry::sampling::sample_surface;
use geometry::{Mesh, PinholeCamera, PointCloud, View, rng};
use nalgebra::{Point3, Vector3};
use planning::config::CameraConfig;
use planning::{NoReturn, Scan, Session, SessionConfig, VolumetricPlanner};
use rays::{hit, seen};

const SAMPLES: usize = 20_000;

/// A box of 20 x 14 x 10 cm.
fn cuboid() -> Mesh {
    let vertex = |i: usize| Point3::new([-0.1, 0.1][i & 1], [-0.07, 0.07][i >> 1 & 1], [-0.05, 0.05][i >> 2 & 1]);
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { vertices: (0..8).map(vertex).collect(), triangles }
}

/// A ball of 18 cm.
fn ball() -> Mesh {
    let (around, down) = (96u32, 48u32);
    let angle = |i: u32, n: u32| std::f64::consts::PI * f64::from(i) / f64::from(n);
    let vertex = |(i, j): (u32, u32)| {
        let (a, b) = (2.0 * angle(i, around), angle(j, down));
        Point3::new(0.09 * b.sin() * a.cos(), 0.09 * b.sin() * a.sin(), 0.09 * b.cos())
    };
    let at = |i: u32, j: u32| i % around * (down + 1) + j;
    let faces = |(i, j): (u32, u32)| {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        [[a, b, c], [a, c, d]]
    };
    let all = |rows: u32| (0..around).flat_map(move |i| (0..rows).map(move |j| (i, j)));
    Mesh { vertices: all(down + 1).map(vertex).collect(), triangles: all(down).flat_map(faces).collect() }
}

/// A torus with radii of 8 and 3 cm, lying flat.
fn torus() -> Mesh {
    let (around, across) = (96u32, 48u32);
    let angle = |i: u32, n: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let vertex = |(i, j): (u32, u32)| {
        let (a, b) = (angle(i, around), angle(j, across));
        let r = 0.08 + 0.03 * b.cos();
        Point3::new(r * a.cos(), r * a.sin(), 0.03 * b.sin())
    };
    let all = || (0..around).flat_map(|i| (0..across).map(move |j| (i, j)));
    let at = |i: u32, j: u32| i % around * across + j % across;
    let faces = |(i, j): (u32, u32)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    Mesh { vertices: all().map(vertex).collect(), triangles: all().flat_map(faces).collect() }
}

fn view(direction: [f64; 3], distance: f64) -> View {
    View { target: Point3::origin(), position: Point3::from(distance * Vector3::from(direction).normalize()) }
}

#[test]
fn known_areas_are_those_of_independent_rays() {
    for (name, mesh) in [("box", cuboid()), ("ball", ball()), ("torus", torus())] {
        let samples = sample_surface(&mesh, SAMPLES, &mut rng::stream(1, name));
        let each = mesh.area() / SAMPLES as f64;
        let rays = rays::surface(&mesh);
        let scene = Scene::new(mesh);
        for (distance, (width, height, fov_y_deg)) in
            [(0.5, (640, 480, 50.0)), (1.2, (1280, 720, 50.0)), (2.0, (1920, 1080, 30.0))]
        {
            let camera_config = CameraConfig { width, height, fov_y_deg, intrinsics: None };
            let camera: PinholeCamera = camera_config.camera();
            let config =
                SessionConfig { working_distance_m: distance, camera: camera_config, ..SessionConfig::default() };
            let mut session = Session::new(config, None).expect("settings in range");
            let mut known = vec![false; SAMPLES];
            for direction in [[0.7, 0.5, 1.0], [1.0, -0.9, 0.7]] {
                let view = view(direction, distance);
                let pose = view.world_from_camera();
                let depth =
                    scene.render(&camera, &pose, &RenderConfig::default(), &mut RenderScratch::default()).clone();
                let scan = Scan::Depth { camera, depth, world_from_camera: pose, misses: NoReturn::Free };
                session.add_scan(scan).expect("a scan");
                known.iter_mut().zip(seen(&rays, &samples, &view.position)).for_each(|(k, s)| *k |= s);
            }
            let views =
                [[0.7, 0.5, 1.0], [-0.6, 0.9, 0.8], [1.0, 1.0, 0.6], [0.5, -1.0, 0.6]].map(|d| view(d, distance));
            session.set_given_views(views.iter().map(View::world_from_camera).collect());
            let forecasts = VolumetricPlanner::default().forecast(session.state(), &mut rng::stream(1, "forecast"));
            for (view, forecast) in views.iter().zip(&forecasts.views) {
                let shown = seen(&rays, &samples, &view.position);
                let area = each * known.iter().zip(&shown).filter(|(k, s)| **k && **s).count() as f64;
                let ratio = forecast.known_m2 / area;
                println!("{name} from {distance} m: {:.4} m2, true {area:.4}: {ratio:.3}", forecast.known_m2);
                assert!((0.9..1.1).contains(&ratio), "{name} from {distance} m, {:?}: {ratio}", view.position);
            }
            let all = each * known.iter().filter(|k| **k).count() as f64;
            let ratio = forecasts.surface.known_m2 / all;
            println!("{name} from {distance} m, all: {ratio:.3}");
            assert!((ratio - 1.0).abs() < 0.1, "{name} from {distance} m, all that was measured: {ratio}");
        }
    }
}

/// What a line scanner measures on its way along x past an object, in planes across it, by parry's rays: lines and points 1.5 mm apart.
fn lines(surface: &parry3d::shape::TriMesh, [first, last]: &[Point3<f64>; 2]) -> PointCloud {
    let count = ((last - first).norm() / 0.0015) as u32;
    let (inward, across) = (-Vector3::new(0.0, first.y, first.z).normalize(), Vector3::x());
    let tilt = inward.cross(&across);
    let measure = |i: u32| {
        let eye = first + (last - first) * (f64::from(i) / f64::from(count));
        let reach = 0.2 / Vector3::new(0.0, first.y, first.z).norm();
        let ray = move |j: i32| inward + tilt * (f64::from(j) * 0.0075 * reach);
        (-133..=133).filter_map(move |j| hit(surface, &eye, &ray(j)))
    };
    PointCloud { points: (0..=count).flat_map(measure).collect(), normals: Vec::new() }
}

#[test]
fn what_a_line_scanner_knows_is_what_independent_rays_from_its_path_meet() {
    // From 0.85 and 0.92 m, and from 0.28 and 0.31 m.
    for nearer in [1.0, 1.0 / 3.0] {
        let paths = [[-0.6, 0.6], [0.6, 0.7]].map(|[y, z]| [-0.3, 0.3].map(|x| Point3::new(x, nearer * y, nearer * z)));
        for (name, mesh) in [("box", cuboid()), ("ball", ball()), ("torus", torus())] {
            check_lines(name, &mesh, &paths);
        }
    }
}

fn check_lines(name: &str, mesh: &Mesh, paths: &[[Point3<f64>; 2]]) {
    let samples = sample_surface(mesh, SAMPLES, &mut rng::stream(1, name));
    let each = mesh.area() / SAMPLES as f64;
    let rays = rays::surface(mesh);
    let mut session = Session::new(SessionConfig::default(), None).expect("settings in range");
    let mut known = vec![false; SAMPLES];
    for &path in paths {
        session.add_scan(Scan::Lines { cloud: lines(&rays, &path), path }).expect("a scan");
        // Abreast of each sample.
        for (known, p) in known.iter_mut().zip(&samples) {
            let eye = Point3::new(p.x, path[0].y, path[0].z);
            *known |= seen(&rays, std::slice::from_ref(p), &eye)[0];
        }
    }
    let views = [[0.0, -1.0, 1.0], [0.0, 0.6, 0.8], [1.0, 1.0, 0.6], [0.5, 1.0, -0.6], [-0.8, 0.5, -1.0]];
    let views = views.map(|d| view(d, 1.2));
    session.set_given_views(views.iter().map(View::world_from_camera).collect());
    let forecasts = VolumetricPlanner::default().forecast(session.state(), &mut rng::stream(1, "forecast"));
    for (view, forecast) in views.iter().zip(&forecasts.views) {
        let shown = seen(&rays, &samples, &view.position);
        let share = |new: bool| known.iter().zip(&shown).filter(|(k, s)| **k != new && **s).count() as f64;
        let (area, gain) = (each * share(false), share(true) / SAMPLES as f64);
        let (told, ratio) = (forecast.reported_gain, forecast.known_m2 / area);
        println!(
            "{name}, path at {:.2} m: {:.4} m2, true {area:.4}: {ratio:.3}; gain {told:.3}, true {gain:.3}",
            paths[0][0].coords.yz().norm(),
            forecast.known_m2
        );
        // The limb of a ball is met flat both times.
        assert!((0.85..1.15).contains(&ratio), "{name}, {:?}: {ratio}", view.position);
        match gain {
            0.15.. => assert!((0.6..1.25).contains(&(told / gain)), "{name}, {:?}: {told}, {gain}", view.position),
            _ => assert!(told < gain + 0.02, "{name}, {:?}: {told}, {gain}", view.position),
        }
    }
}
