//! From the bytes of damaged files to a pose: whatever is read is planned on, and nothing panics or takes long.
//! `TO_POSE_FILES=20000 cargo test --workspace --bin infer to_pose -- --nocapture` for more.

use super::super::*;
use geometry::rng;
use planning::{Session, SessionConfig};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::time::{Duration, Instant};

/// A decision on a few points takes some milliseconds.
const LONGEST: Duration = Duration::from_secs(20);

/// Points of a bent sheet of 12 x 9 cm, as a camera at the origin sees it, row by row.
fn sheet() -> Vec<[f32; 3]> {
    let at = |i: usize| {
        let (x, y) = ((i % 12) as f32 * 0.01 - 0.06, (i / 12) as f32 * 0.01 - 0.045);
        let z = 0.4 + x * x;
        [x * z / 0.4, y * z / 0.4, z]
    };
    (0..108).map(at).collect()
}

fn lines(separator: &str) -> String {
    let line = |p: [f32; 3]| p.map(|x| x.to_string()).join(separator) + "\n";
    sheet().into_iter().map(line).collect()
}

fn npy(descr: &str, shape: &str, values: impl Iterator<Item = u8>) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes().chain(values));
    bytes
}

/// A small file of every format that clouds and depth images come in.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let floats = || sheet().into_iter().flatten().flat_map(f32::to_le_bytes);
    let ply = |format: &str, body: Vec<u8>| {
        let head = format!(
            "ply\nformat {format} 1.0\ncomment made\nelement vertex 108\nproperty float x\nproperty float y\n\
             property float z\nend_header\n"
        );
        [head.into_bytes(), body].concat()
    };
    let pcd = |data: &str, body: Vec<u8>| {
        let head = format!(
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 12\nHEIGHT 9\nVIEWPOINT 0 0 0 1 0 0 0\n\
             POINTS 108\nDATA {data}\n"
        );
        [head.into_bytes(), body].concat()
    };
    let literal: Vec<u8> =
        floats().collect::<Vec<_>>().chunks(32).flat_map(|r| [&[r.len() as u8 - 1], r].concat()).collect();
    let sizes = [(literal.len() as u32).to_le_bytes(), 1296u32.to_le_bytes()].concat();
    let millimetres = |i: usize| 400 + (i % 12) as u16;
    let mut png = vec![];
    let image = geometry::DepthImage {
        origin: [0, 0],
        size: [12, 9],
        depth: (0..108).map(|i| f32::from(millimetres(i)) * 1e-3).collect(),
    };
    let directory = tempfile::tempdir().expect("a temporary folder");
    let path = directory.path().join("d.png");
    formats::depth::write_depth(&path, &image, 12, 9, 0.001).expect("written");
    png.extend(formats::file::read(&path).expect("read"));
    vec![
        ("a.xyz", lines(" ").into_bytes()),
        (
            "a.csv",
            ("t,x,y,z\n".to_owned() + &lines(",").lines().map(|l| format!("1,{l}\n")).collect::<String>()).into_bytes(),
        ),
        ("b.csv", ("x;y;z\n".to_owned() + &lines(";").replace('.', ",")).into_bytes()),
        ("a.ply", ply("ascii", lines(" ").into_bytes())),
        ("b.ply", ply("binary_little_endian", floats().collect())),
        ("a.pcd", pcd("ascii", lines(" ").into_bytes())),
        ("b.pcd", pcd("binary", floats().collect())),
        ("c.pcd", pcd("binary_compressed", [sizes, literal].concat())),
        ("a.npy", npy("<f4", "(108, 3)", floats())),
        ("b.npy", npy("<f4", "(9, 12, 3)", floats())),
        ("depth.npy", npy("<u2", "(9, 12)", (0..108).flat_map(|i| millimetres(i).to_le_bytes()))),
        ("depth.png", png),
    ]
}

fn damage(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    const WORDS: [&str; 14] =
        ["nan", "1e30", "-1e5", "1e-320", "0", "\n", ",", ";", " ", "99999999999", "-1", "\u{feff}", "\"", "#"];
    for _ in 0..rng.random_range(1..5) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..16)).min(bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.drain(at..end)),
            3 => drop(bytes.splice(at..end, WORDS[rng.random_range(0..WORDS.len())].bytes())),
            4 => bytes.extend_from_within(at..end),
            _ if rng.random_range(0..8) == 0 => bytes.truncate(at),
            _ => {}
        }
    }
}

/// A file as a scan, and the view that it leads to; `None` where it is refused on the way.
fn next_view(name: &str, bytes: &[u8]) -> Option<[f64; 3]> {
    let camera = DepthCamera { intrinsics: [40.0, 40.0, 6.0, 4.5], lens: Lens::Pinhole, size: None };
    let loaded = match name.starts_with("depth") {
        true => depth_bytes(name, bytes, None)
            .and_then(|file| from_depth_file(file, &camera, Isometry3::identity(), NoReturn::Unknown)),
        false => cloud_bytes(name, bytes, None, Some([0.0, 0.0, 0.0])),
    };
    let mut session = Session::new(SessionConfig::default(), None).expect("the defaults");
    let loaded = loaded.ok()?;
    session.add_scan_within(loaded.scan, loaded.reading, &planning::Budget::default()).ok()?;
    let next = session.next_view().ok()?.next?;
    let numbers = next.world_from_camera.matrix.iter().flatten().chain(&next.position_m);
    assert!(numbers.clone().all(|x| x.is_finite()), "{name}: a pose that is none: {numbers:?}");
    Some(next.position_m)
}

#[test]
fn damaged_files_lead_to_a_pose_or_a_refusal() {
    let count = std::env::var("TO_POSE_FILES").ok().and_then(|n| n.parse().ok()).unwrap_or(240);
    let files = files();
    for (name, bytes) in &files {
        assert!(next_view(name, bytes).is_some(), "{name}: an open sheet has a next view");
    }
    let mut rng = rng::stream(1, "test/to_pose");
    let mut poses = 0;
    for i in 0..count {
        let (name, bytes) = &files[i % files.len()];
        let mut bytes = bytes.clone();
        damage(&mut bytes, &mut rng);
        let start = Instant::now();
        let outcome = std::panic::catch_unwind(|| next_view(name, &bytes).is_some());
        if outcome.is_err() || start.elapsed() > LONGEST {
            let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
            let kept = target.join(format!("to_pose-{i}-{name}"));
            std::fs::write(&kept, &bytes).expect("kept");
            panic!("{name}, file {i}: panicked or took {:?}; kept as {kept:?}", start.elapsed());
        }
        poses += usize::from(outcome.unwrap_or(false));
    }
    println!("{poses} of {count} damaged files lead to a pose");
    assert!(10 * poses > count, "damage is not so great that nothing is read: {poses} of {count}");
}
