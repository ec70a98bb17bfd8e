//! Every reader on mutated files: no panic, and no allocation beyond what the file warrants. A second per
//! reader by default; `FUZZ_SECONDS=600 cargo test --release -p formats --test fuzz -- --nocapture` for longer.

use formats::camera::parse_camera;
use formats::cloud::parse_cloud;
use formats::depth::parse_depth;
use formats::frame_history::parse_frame_history;
use formats::mesh::parse_mesh;
use formats::poses::parse_poses;
use formats::shard::{CloudPrecision, Sample, ShardMetadata, ShardReader, ShardWriter};
use formats::urdf::parse_urdf;
use formats::{ObjectRecord, ObjectStatus, Split};
use geometry::{DepthImage, PinholeCamera, PointCloud, View, rng, undistort_depth};
use nalgebra::{Isometry3, Point3, Vector3};
use planning::reach::Obstacles;
use planning::{CandidateView, Reach, RobotConfig};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Counts what each thread holds.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let held = HELD.get() + bytes;
    HELD.set(held);
    PEAK.set(PEAK.get().max(held));
}

// SAFETY: every call is handed to the system's allocator unchanged; the counters are plain thread-local cells that
// allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes a reader may hold per byte of the file, beside a constant. A text PLY vertex of two bytes is a row of 100,
/// an LZF block grows 90 times, a PNG 1032 times: the constant covers those of the small files used here.
const PER_BYTE: isize = 512;
const CONSTANT: isize = 16 << 20;

fn mutate(seed: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    const WORDS: [&str; 16] = [
        "1000000000000",
        "-1",
        "0",
        "nan",
        "inf",
        "1e999",
        "18446744073709551615",
        "9223372036854775807",
        " ",
        "\n",
        "/",
        "#",
        "4294967295",
        "-9223372036854775808",
        "\u{e9}",
        "\\\n",
    ];
    let mut bytes = seed.to_vec();
    for _ in 0..rng.random_range(1..8) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..24)).min(bytes.len());
        match rng.random_range(0..8) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                let end = if rng.random() { at } else { end };
                bytes.splice(at..end, word.bytes());
            }
            5 => {
                let number: u64 = [u64::MAX, 1 << 40, u64::from(u32::MAX), 0x7fff_ffff, 0][rng.random_range(0..5)];
                let width = [1, 2, 4, 8][rng.random_range(0..4)];
                for (slot, byte) in bytes[at..].iter_mut().zip(&number.to_le_bytes()[..width]) {
                    *slot = *byte;
                }
            }
            6 => {
                let copy = bytes[at..end].to_vec();
                let to = rng.random_range(0..=bytes.len());
                bytes.splice(to..to, copy);
            }
            _ if !other.is_empty() => {
                let from = rng.random_range(0..other.len());
                let until = (from + rng.random_range(0..64)).min(other.len());
                bytes.splice(at..end, other[from..until].iter().copied());
            }
            _ => {}
        }
    }
    bytes
}

/// Feeds mutations of the seeds to a reader; `read` says whether it took the file.
fn fuzz(name: &str, seeds: &[(PathBuf, Vec<u8>)], mut read: impl FnMut(&Path, &[u8]) -> bool) {
    let seconds = std::env::var("FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(0.5);
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let mut rng = rng::stream(1, &format!("fuzz/{name}"));
    let (mut runs, mut taken, mut worst) = (0u64, 0u64, 0isize);
    for (path, bytes) in seeds {
        assert!(read(path, bytes), "{name}: the unchanged {path:?} must be read");
    }
    while Instant::now() < end {
        let (path, seed) = &seeds[rng.random_range(0..seeds.len())];
        let other = &seeds[rng.random_range(0..seeds.len())].1;
        let bytes = mutate(seed, other, &mut rng);
        let before = HELD.get();
        PEAK.set(before);
        let result = catch_unwind(AssertUnwindSafe(|| read(path, &bytes)));
        let used = PEAK.get() - before;
        let allowed = CONSTANT + PER_BYTE * bytes.len() as isize;
        if result.is_err() || used > allowed {
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR"))
                .join(format!("fuzz-{name}-{runs}.{}", path.extension().unwrap().display()));
            std::fs::write(&kept, &bytes).unwrap();
            panic!("{name}: run {runs} panicked or held {used} of {allowed} bytes; input kept as {kept:?}");
        }
        runs += 1;
        taken += u64::from(result.unwrap_or(false));
        worst = worst.max(used);
    }
    println!("{name}: {runs} files in {seconds} s, {taken} of them readable, {} kB held at most", worst / 1000);
    assert!(runs > 20, "{name}: too few runs to mean anything");
}

/// Small files made here, and those of `../shared/data/awkward` with this ending where present.
fn seeds(extension: &str, made: Vec<Vec<u8>>) -> Vec<(PathBuf, Vec<u8>)> {
    let mut seeds: Vec<_> = made.into_iter().map(|bytes| (PathBuf::from(format!("made.{extension}")), bytes)).collect();
    let directory = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/awkward"));
    let mut real: Vec<PathBuf> =
        std::fs::read_dir(directory).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    real.sort();
    for path in real.into_iter().filter(|p| p.extension().is_some_and(|e| e == extension)) {
        let bytes = std::fs::read(&path).unwrap();
        if bytes.len() < 20_000 {
            seeds.push((path, bytes));
        }
    }
    seeds
}

fn only_readable(seeds: Vec<(PathBuf, Vec<u8>)>, read: impl Fn(&Path, &[u8]) -> bool) -> Vec<(PathBuf, Vec<u8>)> {
    seeds.into_iter().filter(|(path, bytes)| read(path, bytes)).collect()
}

fn is_mesh(path: &Path, bytes: &[u8]) -> bool {
    match parse_mesh(path, bytes) {
        Ok(mesh) => {
            assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.vertices.len()), "index out of range");
            assert!(mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite())), "a vertex is not finite");
            true
        }
        Err(error) => {
            assert_eq!(error.path(), path, "an error must name its file");
            false
        }
    }
}

fn is_cloud(path: &Path, bytes: &[u8]) -> bool {
    parse_cloud(path, bytes).is_ok_and(|file| {
        assert!(file.cloud.points.iter().all(|p| p.iter().all(|x| x.is_finite())), "a point is not finite");
        assert!(file.cloud.normals.is_empty() || file.cloud.has_normals(), "normals for some points only");
        true
    })
}

#[test]
fn off() {
    let text = "OFF4 2 0\n0 0 0\n1 0 0 # c\n0 1 0\n0 0 1\n3 0 1 2\n4 0 1 3 2 255 0 0\n";
    fuzz("off", &only_readable(seeds("off", vec![text.into()]), is_mesh), is_mesh);
}

#[test]
fn obj() {
    let text =
        "v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvn 1 0 0\nf 1//1 2/1/1 3\nf -1//-1 -2 \\\n-3 -4\ng f\n";
    fuzz("obj", &only_readable(seeds("obj", vec![text.into()]), is_mesh), is_mesh);
}

#[test]
fn stl() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let mut binary = vec![b' '; 80];
    binary.extend(2u32.to_le_bytes());
    for k in 0..24 {
        binary.extend((k as f32 * 0.37 % 1.0).to_le_bytes());
        if k % 12 == 11 {
            binary.extend([0, 0]);
        }
    }
    let made = vec![format!("solid a\n{facet}endsolid a\n").into(), binary];
    fuzz("stl", &only_readable(seeds("stl", made), is_mesh), is_mesh);
}

#[test]
fn ply() {
    let head = "element vertex 3\nproperty float x\nproperty double y\nproperty float z\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n";
    let text = format!("ply\nformat ascii 1.0\ncomment c\n{head}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    let mut made = vec![text.into_bytes()];
    for big in [false, true] {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{head}").into_bytes();
        let mut put = |mut value: Vec<u8>| {
            if big {
                value.reverse();
            }
            bytes.extend(value);
        };
        for [x, y, z] in [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            put(x.to_le_bytes().into());
            put(f64::from(y).to_le_bytes().into());
            put(z.to_le_bytes().into());
        }
        put(vec![3]);
        (0..3i32).for_each(|i| put(i.to_le_bytes().into()));
        made.push(bytes);
    }
    let both = |path: &Path, bytes: &[u8]| is_mesh(path, bytes) | is_cloud(path, bytes);
    fuzz("ply", &only_readable(seeds("ply", made), both), both);
}

#[test]
fn pcd() {
    let head = |kind: &str| {
        format!(
            "# .PCD v.7\nVERSION .7\nFIELDS x y z _ normal_x normal_y normal_z\nSIZE 4 4 4 1 4 4 8\nTYPE F F F U F F F\n\
             COUNT 1 1 1 4 1 1 1\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 1 1 0 0 0\nPOINTS 4\nDATA {kind}\n"
        )
        .into_bytes()
    };
    let mut ascii = head("ascii");
    (0..4).for_each(|i| ascii.extend(format!("{i} 0.5 {} 0 0 0 0 nan 0 1\n", i * i).bytes()));
    let record: Vec<u8> = (0..32u8).collect();
    let mut binary = head("binary");
    (0..4).for_each(|_| binary.extend(&record));
    let mut packed = head("binary_compressed");
    packed.extend((4 * 33u32).to_le_bytes());
    packed.extend((4 * 32u32).to_le_bytes());
    for _ in 0..4 {
        packed.push(31); // a literal run of 32
        packed.extend(&record);
    }
    fuzz("pcd", &seeds("pcd", vec![ascii, binary, packed]), is_cloud);
}

#[test]
fn xyz() {
    let made =
        vec![b"x y z nx ny nz\n1 2 3 0 0 1\n4,5,6,1,0,0\n".to_vec(), b"2\n1 2 3 // c\n5600000.25;1;2 label\n".to_vec()];
    fuzz("xyz", &seeds("xyz", made), is_cloud);
}

fn npy(descr: &str, fortran: &str, shape: &str, size: usize) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..size).map(|i| i as u8 % 60));
    bytes
}

#[test]
fn npy_clouds() {
    let made = vec![
        npy("<f8", "False", "(4, 6)", 192),
        npy(">f4", "True", "(5, 3)", 60),
        npy("|u1", "False", "(2, 3, 3)", 18),
    ];
    fuzz("npy", &seeds("npy", made), is_cloud);
}

#[test]
fn depth() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.png");
    let image = DepthImage { origin: [0, 0], size: [4, 3], depth: (0..12).map(|i| i as f32 * 0.1).collect() };
    formats::depth::write_depth(&path, &image, 8, 6, 0.001).unwrap();
    let is_depth = |path: &Path, bytes: &[u8]| {
        parse_depth(path, bytes, None).is_ok_and(|file| {
            file.image.depth.len() as u64 == u64::from(file.image.size[0]) * u64::from(file.image.size[1])
        })
    };
    fuzz("png", &seeds("png", vec![std::fs::read(&path).unwrap()]), is_depth);
    fuzz(
        "npy-depth",
        &seeds("npy", vec![npy("<u2", "False", "(3, 4)", 24), npy("<f4", "False", "(3, 4)", 48)]),
        is_depth,
    );
}

fn sample() -> Sample {
    let view = View { target: Point3::new(0.1, 0.0, 0.0), position: Point3::new(0.0, 0.0, 1.2) };
    Sample {
        object: "a".into(),
        scan_index: 1,
        cloud: PointCloud { points: vec![Point3::new(0.1, 0.2, 0.3); 5], normals: vec![Vector3::z(); 5] },
        candidates: vec![CandidateView { view, density: 1.0 }; 3],
        coverage: vec![0.5; 3],
        overlap: vec![0.5; 3],
        scores: vec![0.5; 3],
        current_coverage: 0.4,
        working_distance: 1.2,
        cameras: vec![Isometry3::identity(); 2],
    }
}

#[test]
fn frame_history() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.bin");
    let Sample { cloud, candidates, .. } = sample();
    let view = candidates[0].view;
    let frame = formats::frame_history::Frame {
        cloud,
        current: view,
        next: view,
        candidates: vec![view; 20],
        scores: vec![0.5; 20],
    };
    formats::frame_history::write_frame_history(&path, &vec![frame; 3]).unwrap();
    let made = vec![std::fs::read(&path).unwrap()];
    fuzz("frame-history", &seeds("bin", made), |path, bytes| parse_frame_history(path, bytes).is_ok());
}

#[test]
fn shards() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("a.safetensors");
    let record =
        ObjectRecord { object: "a".into(), category: "c".into(), split: Split::Train, status: ObjectStatus::Missing };
    let mut writer =
        ShardWriter::new(ShardMetadata { objects: vec![record], ..Default::default() }, CloudPrecision::F32);
    (0..3).for_each(|_| writer.push(&sample()).unwrap());
    let made = vec![writer.to_bytes().unwrap()];
    fuzz("shard", &seeds("safetensors", made), |_, bytes| {
        // Behind the checksum, which would refuse all of them.
        let mut bytes = bytes.to_vec();
        formats::checksum::seal(&mut bytes, formats::shard::CHECKSUM);
        std::fs::write(&file, bytes).unwrap();
        let Ok(reader) = ShardReader::open(&file) else { return false };
        (0..reader.len()).for_each(|i| drop(reader.sample(i)));
        reader.verify().is_ok()
    });
}

/// Calibrations in every dialect that is read.
mod calibrations {
    pub const ROS: &str = "image_width: 640
image_height: 480
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0., 320.25, 0., 501, 239, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 1.0e-3, -0.002, 0.05]
projection_matrix:
  rows: 3
  cols: 4
  data: [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.]
";

    pub const MESSAGE: &str = "header:\n  stamp:\n    sec: 3\n  frame_id: optical\nheight: 480\nwidth: 640\n\
distortion_model: rational_polynomial\nd:\n- 0.1\n- -0.2\n- 0.001\n- -0.002\n- 0.05\n- 0.3\n- 0.4\n- 0.5\n\
k:\n- 500.5\n- 0.0\n- 320.25\n- 0.0\n- 501.0\n- 239.0\n- 0.0\n- 0.0\n- 1.0\n\
binning_x: 0\nbinning_y: 0\nroi:\n  x_offset: 0\n  y_offset: 0\n  do_rectify: false\n---\n";

    pub const OPENCV: &str = "%YAML:1.0
---
calibration_time: \"Sat Nov 28\"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.0050000000000000e+02, 0., 3.2025000000000000e+02, 0.,
       501., 239., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.0000000000000001e-01, -2.0000000000000001e-01, 1.e-03, -2.e-03, 5.e-02 ]
";

    pub const KALIBR: &str = "cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]
  distortion_model: equidistant
  intrinsics: [500.5, 501.0, 320.25, 239.0]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.2, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [500.5, 501.0, 320.25, 239.0]
  resolution: [640, 480]
";

    pub const REALSENSE: &str = r#"{"width": 640, "height": 480, "ppx": 320.25, "ppy": 239.0, "fx": 500.5, "fy": 501.0,
    "model": "distortion.brown_conrady", "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05]}"#;

    pub const OPEN3D: &str =
        r#"{"width": 640, "height": 480, "intrinsic_matrix": [500.5, 0, 0, 0, 501.0, 0, 320.25, 239.0, 1]}"#;
}

/// Through the lens to the points that a planner would see.
#[test]
fn cameras() {
    use calibrations::{KALIBR, MESSAGE, OPEN3D, OPENCV, REALSENSE, ROS};
    let yaml = [ROS, MESSAGE, OPENCV, KALIBR].map(|text| (PathBuf::from("made.yaml"), text.as_bytes().to_vec()));
    let json = [REALSENSE, OPEN3D].map(|text| (PathBuf::from("made.json"), text.as_bytes().to_vec()));
    let seeds: Vec<_> = yaml.into_iter().chain(json).collect();
    let image = DepthImage { origin: [0, 0], size: [16, 12], depth: vec![0.7; 192] };
    fuzz("cameras", &seeds, |path, bytes| {
        let Ok(file) = parse_camera(path, bytes, None).or_else(|_| parse_camera(path, bytes, Some("cam0"))) else {
            return false;
        };
        let [fx, fy, cx, cy] = file.intrinsics;
        assert!(file.intrinsics.iter().all(|x| x.is_finite()) && fx > 0.0 && fy > 0.0, "{:?}", file.intrinsics);
        // Of the size of the image, for speed: the lens is what it is of.
        let camera = PinholeCamera { width: 16, height: 12, fx, fy, cx, cy };
        let seen = undistort_depth(&image, &camera, &file.lens);
        let points = seen.image.to_points(&seen.camera, &Isometry3::identity());
        assert!(points.iter().all(|p| p.iter().all(|x| x.is_finite())), "a point that is not finite");
        true
    });
}

/// Through the settings' check to joint values.
#[test]
fn arms() {
    let robots = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../samples/robots"));
    let tools = [("ur5e.urdf", "tool0"), ("panda.urdf", "panda_link8"), ("six_axis.urdf", "flange")];
    let tool = |path: &Path| tools.iter().find(|(name, _)| path.ends_with(name)).map_or("tool0", |(_, tool)| tool);
    let seeds: Vec<_> = tools
        .iter()
        .map(|(name, _)| (robots.join(name), std::fs::read(robots.join(name)).expect("a sample")))
        .collect();
    fuzz("arms", &seeds, |path, bytes| {
        let Ok(read) = parse_urdf(path, bytes, tool(path)) else { return false };
        let pose = Isometry3::translation(0.3, 0.1, 0.4);
        let hand_eye = planning::pose::Pose::from(&Isometry3::identity()).matrix;
        let robot = RobotConfig { arm: read.arm, flange_from_camera: Some(hand_eye), ..RobotConfig::default() };
        if robot.check().is_err() {
            return true;
        }
        let reach = Reach::new(&robot);
        let nothing = Obstacles { measured: None, expected: None, boxes: &[], floor: None };
        if let Ok(reached) = reach.to(&pose, &nothing, &Isometry3::identity()) {
            assert!(reached.joints.iter().all(|joint| joint.value.is_finite()), "{reached:?}");
        }
        true
    });
}

#[test]
fn poses() {
    let row = |x: f64| format!("1 0 0 {x}\n0 0 -1 0.5\n0 1 0 0.25\n0 0 0 1\n");
    let made = [
        ("a.txt", row(1.0) + &row(2.0)),
        ("kitti.txt", "1 0 0 1 0 0 -1 0.5 0 1 0 0.25\n1 0 0 2 0 1 0 0 0 0 1 0 0 0 0 1\n".to_owned()),
        (
            "euroc.csv",
            "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n\
             15,0.1,0.2,0.3,1,0,0,0\n"
                .to_owned(),
        ),
        ("a.tum", "1.5 0.1 0.2 0.3 0 0 0 1\n2.5 0.1 0.2 0.3 0.7071068 0 0 0.7071068\n".to_owned()),
        ("a.log", format!("0 0 1\n{}1 1 2\n{}", row(1.0), row(2.0))),
        ("images.txt", "# Image list\n#   IMAGE_ID, QW, ...\n1 1 0 0 0 1 2 3 1 a.png\n10.5 20.5 -1\n".to_owned()),
        (
            "a.conf",
            "camera -0.01 0 0.75 0 0 0 1\nbmesh bun000.ply 0 0 0 0 0 0 1\nbmesh b.ply 0.1 0 0 0 1 0 0\n".to_owned(),
        ),
        ("a.json", "[[[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]]]".to_owned()),
        (
            "scene_gt.json",
            "{\"0\": [{\"cam_R_m2c\": [0, -1, 0, 1, 0, 0, 0, 0, 1], \"cam_t_m2c\": [1000, 2000, 3000]}]}".to_owned(),
        ),
    ];
    let seeds: Vec<_> = made.into_iter().map(|(name, text)| (PathBuf::from(name), text.into_bytes())).collect();
    let seeds = only_readable(seeds, |path, bytes| parse_poses(path, bytes).is_ok());
    assert!(seeds.len() >= 6, "{seeds:?}");
    fuzz("poses", &seeds, |path, bytes| match parse_poses(path, bytes) {
        Ok(file) => {
            let rigid = |pose: &Isometry3<f64>| pose.to_homogeneous().iter().all(|x| x.is_finite());
            assert!(file.poses.iter().all(|named| rigid(&named.world_from_camera)), "a pose that is not finite");
            true
        }
        Err(_) => false,
    });
}
