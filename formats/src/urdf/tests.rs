use super::*;
use geometry::{Mesh, Reconstruction};
use nalgebra::{Matrix4, Rotation3};
use planning::pose::Pose;
use planning::reach::{MOST_JOINTS, Reach, RobotConfig, Solution};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::{Duration, Instant};

const ARMS: [(&str, &str); 3] = [("ur5e", "tool0"), ("panda", "panda_link8"), ("six_axis", "flange")];

fn file(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples/robots").join(format!("{name}.urdf"))
}

fn reach(name: &str, tool: &str) -> Reach {
    let read = read_urdf(&file(name), tool).expect("an arm");
    assert!(read.notes.is_empty(), "{:?}", read.notes);
    let config = RobotConfig {
        flange_from_camera: Some(Pose::from(&Isometry3::identity()).matrix),
        arm: read.arm,
        ..Default::default()
    };
    config.check().expect("in range");
    Reach::new(&config)
}

fn drawn(reach: &Reach, rng: &mut ChaCha8Rng) -> [f64; MOST_JOINTS] {
    std::array::from_fn(|k| reach.limits().get(k).map_or(0.0, |[low, high]| rng.random_range(*low..*high)))
}

fn step(x: f64, angle: f64) -> Matrix4<f64> {
    Rotation3::from_axis_angle(&Vector3::x_axis(), angle)
        .to_homogeneous()
        .append_translation(&Vector3::new(x, 0.0, 0.0))
}

fn turn(angle: f64, z: f64) -> Matrix4<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), angle)
        .to_homogeneous()
        .append_translation(&Vector3::new(0.0, 0.0, z))
}

#[test]
fn flanges_are_where_the_published_tables_have_them() {
    let quarter = std::f64::consts::FRAC_PI_2;
    // Denavit and Hartenberg's: d, a, alpha; the base of ROS is half a turn away.
    let ur5e = [
        (0.1625, 0.0, quarter),
        (0.0, -0.425, 0.0),
        (0.0, -0.3922, 0.0),
        (0.1333, 0.0, quarter),
        (0.0997, 0.0, -quarter),
        (0.0996, 0.0, 0.0),
    ];
    // Modified: a and alpha before the turn, d after it.
    let panda = [
        (0.0, 0.0, 0.333),
        (0.0, -quarter, 0.0),
        (0.0, quarter, 0.316),
        (0.0825, quarter, 0.0),
        (-0.0825, -quarter, 0.384),
        (0.0, quarter, 0.0),
        (0.088, quarter, 0.0),
    ];
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..200 {
        let arm = reach("ur5e", "tool0");
        let q = drawn(&arm, &mut rng);
        let of_table =
            |t: Matrix4<f64>, (k, (d, a, alpha)): (usize, &(f64, f64, f64))| t * turn(q[k], *d) * step(*a, *alpha);
        let table: Matrix4<f64> = ur5e.iter().enumerate().fold(turn(std::f64::consts::PI, 0.0), of_table);
        let camera: Matrix4<f64> = arm.camera(&q).to_homogeneous();
        let off = (camera - table).amax();
        assert!(off < 1e-9, "UR5e: {off}");
        let arm = reach("panda", "panda_link8");
        let q = drawn(&arm, &mut rng);
        let of_table = |t: Matrix4<f64>, (k, (a, alpha, d)): (usize, &(f64, f64, f64))| {
            t * step(*a, 0.0) * step(0.0, *alpha) * turn(q[k], *d)
        };
        let table: Matrix4<f64> =
            panda.iter().enumerate().fold(Matrix4::<f64>::identity(), of_table) * turn(0.0, 0.107);
        let camera: Matrix4<f64> = arm.camera(&q).to_homogeneous();
        let off = (camera - table).amax();
        assert!(off < 1e-9, "Panda: {off}");
    }
    // With all joints at zero the six-axis arm stands upright with its wrist out.
    let arm = reach("six_axis", "flange");
    let flange = arm.camera(&[0.0; MOST_JOINTS]).translation.vector;
    assert!((flange - Vector3::new(0.302 + 0.072, 0.0, 0.290 + 0.270 + 0.070)).norm() < 1e-9, "{flange}");
}

/// `IK_POSES=10000 cargo test -p formats --lib -- urdf --nocapture` for the full count.
#[test]
fn inverse_kinematics_come_back_by_forward_kinematics() {
    let poses: usize = std::env::var("IK_POSES").ok().and_then(|n| n.parse().ok()).unwrap_or(200);
    for (name, tool) in ARMS {
        let arm = reach(name, tool);
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let (mut solved, mut elsewhere, mut time) = (0usize, 0usize, [Duration::ZERO; 2]);
        let holds = |solution: &Solution, target: &Isometry3<f64>| {
            let off = arm.camera(&solution.joints).inverse() * target;
            let within = |(value, [low, high]): (&f64, &[f64; 2])| value >= low && value <= high;
            assert!(off.translation.vector.norm() < 2e-5 && off.rotation.angle() < 2e-4, "{name}: {off}");
            assert!(solution.joints.iter().zip(arm.limits()).all(within), "{name}: beyond its limits");
        };
        let first = |target: &Isometry3<f64>| (0..24).find_map(|seed| arm.solve(target, seed));
        for _ in 0..poses {
            let target = arm.camera(&drawn(&arm, &mut rng));
            let clock = Instant::now();
            let found = first(&target);
            time[0] += clock.elapsed();
            if let Some(solution) = found {
                holds(&solution, &target);
                solved += 1;
            }
            // Anywhere in 3 m, mostly out of reach.
            let at = Vector3::from_fn(|_, _| rng.random_range(-1.5..1.5));
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| rng.random_range(-3.0..3.0)));
            let target = Isometry3::from_parts(at.into(), rotation);
            let clock = Instant::now();
            let found = first(&target);
            time[1] += clock.elapsed();
            if let Some(solution) = found {
                holds(&solution, &target);
                elsewhere += 1;
            }
        }
        let each = time.map(|t| t / poses as u32);
        println!(
            "{name}: {solved} of {poses} reachable poses solved ({:?} each), {elsewhere} of {poses} anywhere in 3 m ({:?} each)",
            each[0], each[1]
        );
        assert!(solved as f64 >= 0.985 * poses as f64, "{name}: {solved} of {poses}");
        assert!(elsewhere < poses / 2, "{name}: most are out of reach");
    }
}

fn refused(text: &str, tool: &str, says: &str) {
    let error = parse_urdf(Path::new("arm.urdf"), text.as_bytes(), tool).expect_err(says).to_string();
    assert!(error.contains("arm.urdf") && error.contains(says), "{says}: {error}");
}

#[test]
fn what_is_no_serial_arm_is_refused_by_name() {
    let text = std::fs::read_to_string(file("ur5e")).expect("a sample");
    refused(&text, "gripper", "no link \"gripper\"");
    refused(&text, "base_link", "no joint that moves");
    refused(&text.replace("elbow_joint\" type=\"revolute", "elbow_joint\" type=\"planar"), "tool0", "elbow_joint");
    refused(&text.replacen("<limit ", "<limits ", 1), "tool0", "shoulder_pan_joint");
    refused(&text.replacen("radius=\"0.08\"", "radius=\"wide\"", 1), "tool0", "base_link");
    refused(&text.replacen("</robot>", "", 1), "tool0", "<robot> that is never closed");
    refused(&text.replacen("</link>", "</lnk>", 1), "tool0", "line 7");
    refused("<robot xmlns:xacro=\"x\"><xacro:arm/></robot>", "tool0", "run xacro");
    refused(&text.replacen("<sphere ", "<sphere xacro:if=\"a\" ", 1), "tool0", "run xacro");
    refused(&text.replacen("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>", 1), "tool0", "an axis that is none");
    refused("plain text", "tool0", "no element");
    let twice = |element: &str| text.replacen("</robot>", &format!("{element}</robot>"), 1);
    let second = "<joint name=\"weld\" type=\"fixed\"><parent link=\"base_link\"/><child link=\"tool0\"/></joint>";
    refused(&twice(second), "tool0", "joint \"weld\": found a second joint that moves link \"tool0\"");
    refused(&twice("<link name=\"upper_arm_link\"/>"), "tool0", "no link \"upper_arm_link\", or more than one");
    refused(&text.replacen(" lower=", " low=", 1), "tool0", "found no limits, expected <limit lower=");
    let meshed = text.replacen("<sphere radius=\"0.08\"/>", "<mesh filename=\"package://x.stl\"/>", 1);
    let read = parse_urdf(Path::new("arm.urdf"), meshed.as_bytes(), "tool0").expect("an arm");
    assert!(read.notes[0].contains("shoulder_link") && read.notes[0].contains("x.stl"), "{:?}", read.notes);
}

#[test]
fn collision_meshes_are_found_in_their_package_and_held_by_balls() {
    let folder = tempfile::tempdir().expect("a folder");
    let package = folder.path().join("some_description");
    std::fs::create_dir_all(package.join("urdf")).expect("a folder");
    std::fs::create_dir_all(package.join("meshes")).expect("a folder");
    // A box of 300 x 60 x 40 mm, in millimetres.
    let corner = |i: usize| Point3::new([0.0, 300.0][i & 1], [-30.0, 30.0][i >> 1 & 1], [0.0, 40.0][i >> 2]);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = Mesh { vertices: (0..8).map(corner).collect(), triangles };
    let surface = Reconstruction { normals: vec![Vector3::z(); 8], rim: vec![false; 8], mesh };
    crate::mesh::write_surface(&package.join("meshes/arm.stl"), &surface).expect("written");

    let text = std::fs::read_to_string(file("ur5e")).expect("a sample");
    let path = package.join("urdf/arm.urdf");
    for name in ["package://some_description/meshes/arm.stl", "../meshes/arm.stl"] {
        let mesh = format!("<mesh filename=\"{name}\" scale=\"0.001 0.001 0.001\"/>");
        let text = text.replacen("<sphere radius=\"0.08\"/>", &mesh, 1);
        let read = parse_urdf(&path, text.as_bytes(), "tool0").expect("an arm");
        assert!(read.notes.is_empty(), "{:?}", read.notes);
        let link = read.arm.joints.iter().map(|j| &j.link).find(|link| link.name == "shoulder_link").expect("a link");
        assert!((20..200).contains(&link.balls_m.len()), "{}", link.balls_m.len());
        let truth = Mesh {
            vertices: surface.mesh.vertices.iter().map(|v| v * 0.001).collect(),
            triangles: surface.mesh.triangles.clone(),
        };
        let rng = &mut geometry::rng::stream(1, "mesh");
        let samples = geometry::sampling::poisson_disk_sample(&truth, 3000, rng).expect("samples");
        let distance = |p: &Point3<f64>, [x, y, z, r]: &[f64; 4]| (p - Point3::new(*x, *y, *z)).norm() - r;
        for p in &samples {
            let off = link.balls_m.iter().map(|ball| distance(p, ball)).fold(f64::INFINITY, f64::min);
            assert!(off <= 0.0, "{p} is {off} m outside of all balls");
        }
        // And not much more: 35 mm off the box nothing is touched.
        for p in [Point3::new(0.15, 0.065, 0.02), Point3::new(0.15, 0.0, 0.08), Point3::new(-0.04, 0.0, 0.02)] {
            assert!(link.balls_m.iter().all(|ball| distance(&p, ball) > 0.0), "{p}");
        }
    }
    let other = "<mesh filename=\"package://other/meshes/arm.stl\" scale=\"0.001 0.001 0.001\"/>";
    let other = text.replacen("<sphere radius=\"0.08\"/>", other, 1);
    let read = parse_urdf(&path, other.as_bytes(), "tool0").expect("an arm");
    assert!(read.notes[0].contains("link shoulder_link: no folder of the package \"other\""), "{:?}", read.notes);
    let far = text.replacen("<sphere radius=\"0.08\"/>", "<mesh filename=\"../meshes/arm.stl\"/>", 1);
    let read = parse_urdf(&path, far.as_bytes(), "tool0").expect("an arm");
    assert!(read.notes[0].contains("is its scale right"), "{:?}", read.notes);
    let collada = text.replacen("<sphere radius=\"0.08\"/>", "<mesh filename=\"arm.urdf\"/>", 1);
    std::fs::write(&path, "<robot/>").expect("written");
    let read = parse_urdf(&path, collada.as_bytes(), "tool0").expect("an arm");
    assert!(read.notes[0].contains("cannot be read") && read.notes[0].contains(".stl"), "{:?}", read.notes);
}

#[test]
fn a_mesh_is_that_of_its_package_wherever_that_lies() {
    let folder = tempfile::tempdir().expect("a folder");
    let put = |path: &str| {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(&path, "solid").expect("written");
        path
    };
    let urdf = put("src/cell/urdf/cell.urdf");
    let prefixes = [folder.path().join("opt")];
    let find = |name: &str| mesh::find(&urdf, name, &prefixes);
    let missing = find("package://gripper/meshes/base.stl").expect_err("nowhere");
    assert!(
        missing.contains("package://gripper/meshes/base.stl") && missing.contains("AMENT_PREFIX_PATH"),
        "{missing}"
    );
    let missing = find("../meshes/base.stl").expect_err("nowhere");
    assert!(missing.contains("expected it at") && missing.contains("base.stl"), "{missing}");
    let own = put("src/cell/meshes/base.stl");
    assert_eq!(find("package://cell/meshes/base.stl"), Ok((own.clone(), None)));
    assert_eq!(find("../meshes/base.stl").map(|(_, note)| note), Ok(None));
    let (path, note) = find("package://gripper/meshes/base.stl").expect("that of another package");
    assert!(path == own && note.is_some_and(|note| note.contains("\"gripper\"") && note.contains("was used instead")));
    // From the last place to the first.
    for place in ["opt/share/gripper", "gripper/share/gripper", "src/gripper"] {
        let path = put(&format!("{place}/meshes/base.stl"));
        assert_eq!(find("package://gripper/meshes/base.stl"), Ok((path, None)), "{place}");
    }
}

#[test]
fn what_exporters_leave_behind_is_read() {
    let text = std::fs::read_to_string(file("ur5e")).expect("a sample");
    let arm = |bytes: &[u8]| parse_urdf(Path::new("arm.urdf"), bytes, "tool0").unwrap_or_else(|e| panic!("{e}")).arm;
    let plain = arm(text.as_bytes());
    let fixed = "<joint name=\"wrist_3-tool0\" type=\"fixed\">";
    assert!(text.contains(fixed));
    let no_axis = text.replacen(fixed, &format!("{fixed}<axis xyz=\"0 0 0\"/>"), 1);
    assert_eq!(arm(no_axis.as_bytes()), plain);
    let commented = text.replacen("<robot ", "<!-- made from <xacro:arm/> --><robot xmlns:xacro=\"x\" ", 1);
    assert_eq!(arm(commented.as_bytes()), plain);
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    assert_eq!(arm(&wide), plain);
    assert_eq!(arm(&[b"<!-- f\xfcr alle -->", text.as_bytes()].concat()), plain);
    assert_eq!(arm(text.replace("0.1625", "1.625D-01").as_bytes()), plain);
}
