//! Real and awkward files beside the checkout, skipped in words where absent, and a frame history of `tests/data`.

use formats::frame_history::{parse_frame_history, write_frame_history};
use formats::{FormatError, cloud, mesh, read_cloud, read_mesh};
use geometry::Mesh;
use nalgebra::Vector3;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

fn shared(path: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).join(path);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {path:?} is absent");
    None
}

fn files(directory: &Path, extension: &str) -> Vec<PathBuf> {
    let all = std::fs::read_dir(directory).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = all.filter(|p| p.extension().is_some_and(|e| e == extension)).collect();
    files.sort();
    files
}

#[test]
fn awkward_meshes_are_read_right() {
    let Some(directory) = shared("data/awkward") else { return };
    // Triangles as counted by hand in the files; the OFF cubes have edges of 2 x 1.632993 / sqrt 2.
    let off = Some(6.0 * 2.0 * 1.632993f64.powi(2));
    for (name, triangles, area) in [
        ("comments.off", 12, off),
        ("whitespace.off", 12, off),
        ("negative_indices.obj", 12, Some(24.0)),
        ("polygonfaces.obj", 3, None),
        ("nancolor.obj", 12, Some(6.0)),
        ("cube_compressed.obj", 12, Some(24.0)),
        ("cube_blender_uv.ply", 12, Some(6.0)),
        ("fixed_top.ply", 4772, None),
        ("two_objects_mixed_case_names.stl", 24, Some(12.0)),
        ("soup.stl", 100, None),
        ("20mm-xyz-cube.stl", 260, None),
        ("obj_with_no_face_in_chunk.obj", 1, None),
        ("notenoughindices.obj", 1, Some(250_000.0)),
    ] {
        let mesh = read_mesh(&directory.join(name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(mesh.triangles.len(), triangles, "{name}");
        if let Some(area) = area {
            assert!((mesh.area() - area).abs() < 1e-4 * area, "{name}: {} for {area}", mesh.area());
        }
        well_formed(name, &mesh);
    }
    let (low, high) = read_mesh(&directory.join("20mm-xyz-cube.stl")).unwrap().bounding_box();
    assert!((high - low - Vector3::repeat(20.0)).amax() < 0.1, "{low} {high}");
}

fn well_formed(name: &str, mesh: &Mesh) {
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.vertices.len()), "{name}: index out of range");
    assert!(mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite())), "{name}: not finite");
}

#[test]
fn empty_and_broken_files_end_in_a_clear_error() {
    let Some(directory) = shared("data/awkward") else { return };
    for name in [
        "empty.obj",
        "empty.ply",
        "empty.stl",
        "emptyIO_ply_empty_header.ply",
        "emptyIO_stl_empty_ascii.stl",
        "face_in_group_name.obj",
    ] {
        let error = read_mesh(&directory.join(name)).expect_err(name);
        assert!(matches!(error, FormatError::Empty { .. }), "{name}: {error:?}");
        assert!(error.to_string().contains(name), "{error}");
    }
    for name in ["empty.ply", "emptyIO_ply_empty_header.ply"] {
        let error = read_cloud(&directory.join(name)).expect_err(name);
        assert!(matches!(error, FormatError::Empty { .. }), "{name}: {error:?}");
    }
}

#[test]
fn awkward_clouds_are_read_right() {
    let Some(directory) = shared("data/awkward") else { return };
    for (name, points) in [
        ("points_ascii.ply", 5),
        ("points_ascii_with_lists.ply", 5),
        ("points_bin.ply", 5),
        ("points_emptyascii.ply", 12),
        ("points_agisoft.xyz", 100),
        ("points_cloudcompare.xyz", 101),
    ] {
        let file = read_cloud(&directory.join(name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((file.cloud.len(), file.dropped, file.cloud.has_normals()), (points, 0, false), "{name}");
    }
    let survey = read_cloud(&directory.join("points_agisoft.xyz")).unwrap().cloud;
    assert_eq!(survey.points[0].y, 5_648_349.895_035, "survey coordinates must keep their digits");
}

#[test]
fn real_scans_are_read_right() {
    let Some(directory) = shared("data/scans") else { return };
    for (name, points, dropped) in
        [("bun000.ply", 40_256, 0), ("bun045.ply", 40_097, 0), ("milk.pcd", 13_704, 0), ("cturtle.pcd", 167_198, 0)]
    {
        let file = read_cloud(&directory.join(name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((file.cloud.len(), file.dropped), (points, dropped), "{name}");
    }
    let file = read_cloud(&directory.join("milk_cartoon_all_small_clorox.pcd")).unwrap();
    let grid = file.grid.expect("an organised cloud");
    assert_eq!((grid.width, grid.height, grid.pixels.len()), (640, 480, file.cloud.len()));
    assert_eq!(file.cloud.len() + file.dropped, 640 * 480);
    assert!(file.dropped > 10_000, "a Kinect image has holes: {}", file.dropped);
    assert!(read_cloud(&directory.join("rops_cloud.pcd")).unwrap().cloud.len() > 1000);
}

#[test]
fn golden_centres_and_scales() {
    let (Some(directory), Some(golden)) = (shared("data/repository3d"), shared("golden/e_depth.safetensors")) else {
        return;
    };
    let bytes = std::fs::read(golden).unwrap();
    let golden = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let values = |name: &str| -> Vec<f64> {
        let tensor = golden.tensor(name).unwrap();
        tensor.data().chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
    };
    for name in ["bunny", "teapot"] {
        let mesh = read_mesh(&directory.join(name).with_extension("obj")).unwrap();
        let (low, high) = mesh.bounding_box();
        let scale = 0.2 / (high - low).norm();
        let (center, expected) = (mesh.center(), values(&format!("{name}.mesh_center")));
        let off = (center.coords - Vector3::from_column_slice(&expected)).norm() * scale;
        let expected_scale = values(&format!("{name}.mesh_scale"))[0];
        println!("{name}: centre off by {off:.1e} m, scale by {:.1e}", scale / expected_scale - 1.0);
        assert!(off < 1e-8, "{name}: {center} for {expected:?}");
        assert!((scale / expected_scale - 1.0).abs() < 1e-6, "{name}: {scale} for {expected_scale}");
    }
}

#[test]
fn objects_agree_with_an_independent_reader() {
    for folder in ["data/objects", "data/repository3d"] {
        let Some(directory) = shared(folder) else { return };
        let small = |p: &PathBuf| std::fs::metadata(p).unwrap().len() < 2_000_000;
        for path in files(&directory, "obj").into_iter().filter(small) {
            let mesh = read_mesh(&path).unwrap_or_else(|e| panic!("{e}"));
            well_formed(&path.display().to_string(), &mesh);
            let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
            let (models, _) = tobj::load_obj(&path, &options).unwrap();
            let mut corners = HashSet::new();
            let mut area = 0.0;
            for m in models.iter().map(|m| &m.mesh) {
                let at = |list: &[f64], i: u32| Vector3::from_column_slice(&list[3 * i as usize..3 * i as usize + 3]);
                let bits = |v: Vector3<f64>| [v.x, v.y, v.z].map(|x| (x as f32 + 0.0).to_bits());
                for (k, &i) in m.indices.iter().enumerate() {
                    let normal = m.normal_indices.get(k).map(|&n| bits(at(&m.normals, n)));
                    corners.insert((bits(at(&m.positions, i)), normal));
                }
                for t in m.indices.chunks_exact(3) {
                    let [a, b, c] = [t[0], t[1], t[2]].map(|i| at(&m.positions, i));
                    area += 0.5 * (b - a).cross(&(c - a)).norm();
                }
            }
            assert_eq!(mesh.vertices.len(), corners.len(), "{path:?}: distinct corners");
            assert!((mesh.area() / area - 1.0).abs() < 1e-3, "{path:?}: {} for {area}", mesh.area());
        }
    }
}

#[test]
fn an_independently_written_frame_history_both_ways() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data"));
    frame_history_both_ways(&data.join("frame_history.bin"), &data.join("frame_history.safetensors"));
}

#[test]
fn bonus_golden_frame_history_both_ways() {
    if let (Some(path), Some(golden)) =
        (shared("golden/h_frame_history_teapot_3scans.bin"), shared("golden/h_frame_history_teapot_3scans.safetensors"))
    {
        frame_history_both_ways(&path, &golden);
    }
}

fn frame_history_both_ways(path: &Path, golden: &Path) {
    let read = |path: &Path| {
        std::fs::read(path).unwrap_or_else(|e| panic!("{path:?}: {e}; tests/reference/make_frame_history.py makes it"))
    };
    let bytes = read(path);
    let frames = parse_frame_history(path, &bytes).unwrap();
    assert_eq!(frames.len(), 3);
    let golden = read(golden);
    let golden = safetensors::SafeTensors::deserialize(&golden).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        let values = |name: &str| -> Vec<f64> {
            let tensor = golden.tensor(&format!("frame{i}.{name}")).unwrap();
            tensor.data().chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect()
        };
        let cloud = frame.cloud.points.iter().zip(&frame.cloud.normals);
        assert_eq!(cloud.flat_map(|(p, n)| [p.x, p.y, p.z, n.x, n.y, n.z]).collect::<Vec<_>>(), values("points"));
        let numbers =
            |v: &geometry::View| [v.target.x, v.target.y, v.target.z, v.position.x, v.position.y, v.position.z];
        assert_eq!(numbers(&frame.current).to_vec(), values("current_view_target_camera"));
        assert_eq!(numbers(&frame.next).to_vec(), values("next_view_target_camera"));
        assert_eq!(frame.candidates.iter().flat_map(numbers).collect::<Vec<_>>(), values("nbv_list"));
        assert_eq!(frame.scores, values("score"));
    }
    let written = tempfile::tempdir().unwrap().path().join("a.bin");
    write_frame_history(&written, &frames).unwrap();
    assert!(std::fs::read(&written).unwrap() == bytes, "the bytes that were read must be written");
}

#[test]
fn other_endings_are_refused_by_name() {
    let text = mesh::parse_mesh(Path::new("a.fbx"), b"").expect_err("no mesh").to_string();
    assert!(text.contains(".fbx") && text.contains(".off, .obj, .ply or .stl"), "{text}");
    let text = cloud::parse_cloud(Path::new("a.las"), b"").expect_err("no cloud").to_string();
    assert!(text.contains(".las") && text.contains(".pcd"), "{text}");
    let text = read_mesh(Path::new("/no/such/file.off")).expect_err("no file").to_string();
    assert!(text.contains("/no/such/file.off") && text.contains("cannot read"), "{text}");
}
