use super::*;
use geometry::{View, rng};
use nalgebra::Vector3;
use rand::{Rng, RngExt};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A box with outward triangles.
fn cuboid(half: Vector3<f64>) -> Mesh {
    let vertices = (0..8)
        .map(|i| Point3::from(half.map_with_location(|axis, _, h| if i >> axis & 1 == 1 { h } else { -h })))
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    Mesh { vertices, triangles }
}

/// Unconnected random triangles.
fn soup(triangles: usize, size: f64, name: &str) -> Mesh {
    let mut rng = rng::stream(1, name);
    let mut mesh = Mesh::default();
    for i in 0..triangles as u32 {
        let center = Vector3::from_fn(|_, _| rng.random_range(-0.1..0.1));
        for _ in 0..3 {
            mesh.vertices.push(Point3::from(center + Vector3::from_fn(|_, _| rng.random_range(-size..size))));
        }
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

fn random_view(rng: &mut impl Rng, distance: f64) -> View {
    let direction = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0f64)).normalize();
    let target = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-0.05..0.05)));
    View { target, position: target + direction * distance }
}

fn with(renderer: Renderer) -> RenderConfig {
    RenderConfig { renderer, depth_quantum_m: 0.0, ..RenderConfig::default() }
}

/// Pixels where one image has a return and the other none, and where the depths differ by more than `step`.
fn differences(a: &DepthImage, b: &DepthImage, step: f32) -> (usize, usize) {
    let low = [0, 1].map(|k| a.origin[k].min(b.origin[k]));
    let high = [0, 1].map(|k| (a.origin[k] + a.size[k]).max(b.origin[k] + b.size[k]));
    let (mut mask, mut depth) = (0, 0);
    for row in low[1]..high[1] {
        for column in low[0]..high[0] {
            match (a.at(column, row), b.at(column, row)) {
                (Some(x), Some(y)) => depth += usize::from((x - y).abs() > step),
                (None, None) => {}
                _ => mask += 1,
            }
        }
    }
    (mask, depth)
}

fn hits(image: &DepthImage) -> usize {
    image.depth.iter().filter(|z| **z > 0.0).count()
}

#[test]
fn a_facing_wall_has_its_depth_and_size() {
    let scene = Scene::new(cuboid(Vector3::new(0.0503, 0.0307, 0.1)));
    // The camera looks along -z at the box's upper face, 1 m away.
    let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.1) };
    let camera = PinholeCamera::from_fov_y(640, 480, 60f64.to_radians());
    for renderer in [Renderer::Raster, Renderer::Rays] {
        let image = scene.depth_image(&camera, &view.world_from_camera(), &with(renderer));
        // The half edges of 50.3 and 30.7 mm are 20.9 and 12.8 pixels at 415.7 pixels per metre.
        assert_eq!(hits(&image), 41 * 25, "{renderer:?}");
        assert!(image.depth.iter().filter(|z| **z > 0.0).all(|z| (z - 1.0).abs() < 1e-6), "{renderer:?}");
        for p in image.to_points(&camera, &view.world_from_camera()) {
            assert!((p.z - 0.1).abs() < 1e-6 && p.x.abs() < 0.0503 && p.y.abs() < 0.0307, "{p}");
        }
    }
}

#[test]
fn rasteriser_and_rays_agree() {
    let mut rng = rng::stream(2, "views");
    let (mut pixels, mut mask, mut depth) = (0, 0, 0);
    for (mesh, far_from_origin) in
        [(soup(400, 0.03, "a"), 0.0), (soup(20_000, 0.002, "b"), 0.0), (soup(30, 0.1, "c"), 1e4)]
    {
        let offset = Vector3::repeat(far_from_origin);
        let scene = Scene::new(Mesh { vertices: mesh.vertices.iter().map(|v| v + offset).collect(), ..mesh });
        for i in 0..12 {
            let view = random_view(&mut rng, if i % 3 == 0 { 0.3 } else { 1.2 });
            let pose = nalgebra::Translation3::from(offset) * view.world_from_camera();
            let camera = PinholeCamera { cx: 633.3, cy: 361.7, ..PinholeCamera::default() };
            for cull_back_faces in [false, true] {
                let config = |renderer| RenderConfig { cull_back_faces, ..with(renderer) };
                let raster = scene.depth_image(&camera, &pose, &config(Renderer::Raster));
                let rays = scene.depth_image(&camera, &pose, &config(Renderer::Rays));
                let (m, d) = differences(&raster, &rays, 2e-5);
                pixels += hits(&rays);
                mask += m;
                depth += d;
            }
        }
    }
    assert!(pixels > 100_000, "{pixels}");
    // Edges that pass within rounding of a pixel centre.
    assert!(mask + depth <= pixels / 2_000, "{mask} masks and {depth} depths of {pixels} pixels");
}

#[test]
fn a_camera_inside_sees_the_walls_behind_and_before_it() {
    let scene = Scene::new(cuboid(Vector3::repeat(0.5)));
    let view = View { target: Point3::new(0.5, 0.0, 0.0), position: Point3::origin() };
    let camera = PinholeCamera::from_fov_y(64, 48, 60f64.to_radians());
    let image = scene.depth_image(&camera, &view.world_from_camera(), &with(Renderer::Raster));
    assert_eq!(hits(&image), 64 * 48, "the walls surround the camera");
    assert!((image.at(32, 24).unwrap() - 0.5).abs() < 1e-6);
    let culled = RenderConfig { cull_back_faces: true, ..with(Renderer::Auto) };
    assert_eq!(hits(&scene.depth_image(&camera, &view.world_from_camera(), &culled)), 0, "all walls face away");
}

#[test]
fn an_object_beyond_the_image_is_cut_at_its_border() {
    let scene = Scene::new(cuboid(Vector3::new(5.0, 5.0, 0.01)));
    let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.0) };
    let camera = PinholeCamera::from_fov_y(64, 48, 60f64.to_radians());
    for renderer in [Renderer::Raster, Renderer::Rays] {
        let image = scene.depth_image(&camera, &view.world_from_camera(), &with(renderer));
        assert_eq!((image.origin, image.size, hits(&image)), ([0, 0], [64, 48], 64 * 48), "{renderer:?}");
    }
    let beside = View { target: Point3::new(50.0, 0.0, 0.0), position: Point3::new(50.0, 0.0, 1.0) };
    assert_eq!(hits(&scene.depth_image(&camera, &beside.world_from_camera(), &with(Renderer::Auto))), 0);
    assert_eq!(
        hits(&Scene::new(Mesh::default()).depth_image(&camera, &beside.world_from_camera(), &with(Renderer::Auto))),
        0
    );
}

#[test]
fn depth_is_quantised_downwards_and_cut_at_far() {
    let scene = Scene::new(cuboid(Vector3::new(0.1, 0.1, 0.0004)));
    let view = View { target: Point3::origin(), position: Point3::new(0.0, 0.0, 1.2) };
    let camera = PinholeCamera::default();
    let image = scene.depth_image(&camera, &view.world_from_camera(), &RenderConfig::default());
    assert!(image.depth.iter().all(|&z| z == 0.0 || z == 1.199), "1.1996 m is 1,199 whole millimetres");
    let near_sighted = RenderConfig { far_m: 1.0, ..RenderConfig::default() };
    assert_eq!(hits(&scene.depth_image(&camera, &view.world_from_camera(), &near_sighted)), 0);
}

fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).join(path);
    path.exists().then_some(path)
}

/// A tensor's values, each of `N` bytes.
fn values<const N: usize, T>(bytes: &[u8], name: &str, read: impl Fn([u8; N]) -> T) -> Vec<T> {
    let tensors = safetensors::SafeTensors::deserialize(bytes).unwrap();
    let tensor = tensors.tensor(name).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(tensor.data().len(), N * tensor.shape().iter().product::<usize>(), "{name}");
    tensor.data().as_chunks().0.iter().map(|b| read(*b)).collect()
}

/// The camera, the mesh and a way to the images of `tests/data/depth.safetensors`.
fn recorded_rays() -> (PinholeCamera, Scene, Vec<u8>) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/depth.safetensors");
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{path}: {e}; tests/reference/make_depth.py makes it"));
    let vertices = values(&bytes, "vertices", f32::from_le_bytes);
    let triangles = values(&bytes, "triangles", u32::from_le_bytes);
    let mesh = Mesh {
        vertices: vertices.chunks_exact(3).map(|v| Point3::new(v[0], v[1], v[2]).cast()).collect(),
        triangles: triangles.as_chunks().0.to_vec(),
    };
    let [width, height, f] = values(&bytes, "width_height_focal", f64::from_le_bytes)[..] else { panic!("three") };
    let camera =
        PinholeCamera { width: width as u32, height: height as u32, fx: f, fy: f, cx: width / 2.0, cy: height / 2.0 };
    (camera, Scene::new(mesh), bytes)
}

fn recorded_image(bytes: &[u8], name: &str) -> DepthImage {
    let window = values(bytes, &format!("{name}_window"), u32::from_le_bytes);
    let depth = values(bytes, name, f32::from_le_bytes);
    DepthImage { origin: [window[0], window[1]], size: [window[2], window[3]], depth }
}

#[test]
fn depth_images_equal_those_of_independent_rays() {
    let (camera, scene, bytes) = recorded_rays();
    for pose in 0..3 {
        let point =
            |field: &str| Point3::from_slice(&values(&bytes, &format!("pose{pose}.{field}"), f64::from_le_bytes));
        let view = View { target: point("target"), position: point("camera") };
        let pose_matrix = view.world_from_camera();
        for (name, cull_back_faces) in [("depth", false), ("front_depth", true)] {
            let expected = recorded_image(&bytes, &format!("pose{pose}.{name}"));
            assert!(hits(&expected) > 800);
            for renderer in [Renderer::Raster, Renderer::Rays] {
                let what = format!("pose {pose} {name} {renderer:?}");
                let config = RenderConfig { cull_back_faces, ..with(renderer) };
                let ours = scene.depth_image(&camera, &pose_matrix, &config);
                assert_eq!(differences(&ours, &expected, 5e-6), (0, 0), "{what}");
                // The published shift looks through the pixel below.
                let config = RenderConfig { pixel_shift: true, ..config };
                let shifted = scene.depth_image(&camera, &pose_matrix, &config);
                let moved = DepthImage { origin: [expected.origin[0], expected.origin[1] - 1], ..expected.clone() };
                assert_eq!(differences(&shifted, &moved, 5e-6), (0, 0), "{what}, shifted");
                // Whole millimetres, downwards; not where the depth is within rounding of one.
                let config = RenderConfig { pixel_shift: false, depth_quantum_m: 0.001, ..config };
                let coarse = scene.depth_image(&camera, &pose_matrix, &config);
                let mut floor = expected.clone();
                floor.depth.iter_mut().for_each(|z| *z = ((f64::from(*z) * 1e3).floor() / 1e3) as f32);
                let (mask, depth) = differences(&coarse, &floor, 1e-6);
                assert!(mask == 0 && depth * 500 < hits(&expected), "{what}: {depth} whole millimetres differ");
            }
        }
    }
}

/// The distinct (position, normal) corners of an OBJ file.
fn read_obj(path: &Path) -> Mesh {
    let options = tobj::LoadOptions { triangulate: true, single_index: false, ..Default::default() };
    let (models, _) = tobj::load_obj(path, &options).unwrap();
    let mut mesh = Mesh::default();
    let mut ids = HashMap::new();
    for model in &models {
        let m = &model.mesh;
        let corners: Vec<u32> = (0..m.indices.len())
            .map(|i| {
                let p = m.indices[i] as usize * 3;
                let position = [0, 1, 2].map(|k| m.positions[p + k] as f32);
                let normal = m
                    .normal_indices
                    .get(i)
                    .map(|&n| [0, 1, 2].map(|k| (m.normals[n as usize * 3 + k] as f32).to_bits()));
                *ids.entry((position.map(f32::to_bits), normal)).or_insert_with(|| {
                    mesh.vertices.push(Point3::from(position.map(f64::from)));
                    mesh.vertices.len() as u32 - 1
                })
            })
            .collect();
        mesh.triangles.extend(corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]));
    }
    mesh
}

#[test]
fn bonus_depth_images_of_the_published_simulator() {
    let Some(file) = shared("golden/e_depth.safetensors") else {
        println!("bonus test skipped: depth images of the published simulator are not beside this checkout");
        return;
    };
    let bytes = std::fs::read(file).unwrap();
    let f64s = |name: &str| values(&bytes, name, f64::from_le_bytes);
    let i32s = |name: &str| values(&bytes, name, i32::from_le_bytes);
    let point = |v: Vec<f64>| Point3::new(v[0], v[1], v[2]);
    let camera = PinholeCamera::default();
    for object in ["bunny", "teapot"] {
        let mesh = read_obj(&shared(&format!("data/repository3d/{object}.obj")).unwrap());
        let center = point(f64s(&format!("{object}.mesh_center")));
        let scale = f64s(&format!("{object}.mesh_scale"))[0];
        assert!((mesh.center() - center).norm() * scale < 1e-6, "{object}: centre {} and {center}", mesh.center());
        let scene = Scene::new(mesh.normalized(0.2));
        for pose in 0..3 {
            let name = |field: &str| format!("{object}.pose{pose}.{field}");
            let view = View { target: point(f64s(&name("target"))), position: point(f64s(&name("camera"))) };
            let image = scene.depth_image(&camera, &view.world_from_camera(), &RenderConfig::paper());
            let crop: Vec<u32> = i32s(&name("crop_row0_row1_col0_col1")).iter().map(|&x| x as u32).collect();
            let golden = i32s(&name("depth_mm_crop"));
            let (mut mask, mut quantum, mut more, mut i) = (0, 0, 0, 0);
            for row in crop[0]..crop[1] {
                for column in crop[2]..crop[3] {
                    let theirs = (golden[i] < 3900).then_some(golden[i]);
                    let ours = image.at(column, row).map(|z| (z * 1000.0).round() as i32);
                    i += 1;
                    match (ours, theirs) {
                        (Some(a), Some(b)) if a == b => {}
                        (Some(a), Some(b)) if (a - b).abs() == 1 => quantum += 1,
                        (Some(_), Some(_)) => more += 1,
                        (None, None) => {}
                        _ => mask += 1,
                    }
                }
            }
            let foreground = golden.iter().filter(|&&z| z < 3900).count();
            println!("{object} pose {pose}: {foreground} pixels, mask {mask}, one quantum {quantum}, more {more}");
            assert!(mask * 200 < foreground && more == 0 && quantum * 100 < foreground, "{object} pose {pose}");
            if mask == 0 {
                let points = image.to_points(&camera, &view.world_from_camera());
                let golden = f64s(&name("world_points"));
                for (p, g) in points.iter().zip(golden.chunks_exact(3)) {
                    assert!((p - Point3::new(g[0], g[1], g[2])).norm() < 1.1e-3 * 1.1, "{p}");
                }
            }
        }
    }
}

#[test]
fn bonus_real_meshes_look_the_same_both_ways() {
    let Some(folder) = shared("data/repository3d") else {
        println!("bonus test skipped: the 3D Repository's meshes are not beside this checkout");
        return;
    };
    let mut rng = rng::stream(3, "views");
    let camera = PinholeCamera::default();
    for object in ["teapot", "bunny", "armadillo", "statue_of_liberty"] {
        let scene = Scene::new(read_obj(&folder.join(format!("{object}.obj"))).normalized(0.2));
        let (mut pixels, mut mask, mut depth) = (0, 0, 0);
        for _ in 0..10 {
            let pose = random_view(&mut rng, 1.2).world_from_camera();
            let raster = scene.depth_image(&camera, &pose, &with(Renderer::Auto));
            let rays = scene.depth_image(&camera, &pose, &with(Renderer::Rays));
            let (m, d) = differences(&raster, &rays, 1e-5);
            (pixels, mask, depth) = (pixels + hits(&rays), mask + m, depth + d);
        }
        println!("{object}: {pixels} pixels, mask {mask}, depth {depth}");
        assert!(mask + depth <= pixels / 2_000, "{object}: {mask} masks and {depth} depths of {pixels}");
    }
}
